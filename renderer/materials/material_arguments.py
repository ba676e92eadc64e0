"""The materials of a synthetic object: options of `synth`, or a file of materials by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fit_material.renderer.materials.bsdf import Distribution
from fit_material.renderer.materials.ground_truth import (
    TRUE_TYPES,
    ShadingModel,
    TrueGlossy,
    TrueMaterial,
    TrueMatte,
    TrueMetal,
    require,
)
from fit_material.shaders.materials.quantities import COLOR, INDEX, REFLECTANCE

DEFAULT_ALPHA = 0.2


def true_material(type: str = "auto", distribution: Distribution = "ggx", **described: Any) -> TrueMaterial:
    """The material that is described.

    Args:
        type: "auto" takes a metal's parameters for a metal, colour with reflectance for glossy, else matte.
        distribution: of the microfacets' normals.
        described: quantities by their names, as `renderer.materials.ground_truth` has them, and `metal`, a name of the
            catalogue in the place of `n` and `k`; None is one that is not given.

    Raises:
        InputError: too many or too few numbers are given for one material, or a value is out of its range; names the
            command-line option.
    """
    given = {key: value for key, value in described.items() if value is not None}
    made = TRUE_TYPES[_type_of(given) if type == "auto" else type]
    for key, value in given.items():
        expected = f"no {key} for a {made.name} material, which has {', '.join(made.options())}"
        require(f"--{key}", value, key in made.options(), expected)
    return made.of_options(given, distribution)


def _type_of(given: Mapping[str, Any]) -> str:
    if given.keys() & {TrueMetal.name, *INDEX}:
        return TrueMetal.name
    require("synth", "without a material", COLOR.name in given, "--metal NAME, --n and --k, or --color")
    return TrueGlossy.name if REFLECTANCE.name in given else TrueMatte.name


def shading_model(asked: ShadingModel | None, *materials: TrueMaterial) -> ShadingModel:
    """The requested model; else the viewer's where a material has its roughness, else Mitsuba's."""
    if asked is not None:
        return asked
    return "viewer" if any(getattr(material, "roughness", None) is not None for material in materials) else "mitsuba"


def with_default_alpha(material: TrueMaterial, model: ShadingModel) -> TrueMaterial:
    """The material, with a width where Mitsuba's needs one and none was given."""
    if model != "mitsuba" or not material.mirrors or material.alpha is not None:
        return material
    return material.with_alpha(DEFAULT_ALPHA)
