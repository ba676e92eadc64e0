"""What a user says a synthetic object is made of: options of `synth`, or a file of materials by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Literal

from fit_material.renderer.materials.catalogue import metal as known_metal
from fit_material.renderer.materials.ground_truth import (
    Channels,
    Distribution,
    ShadingModel,
    TrueGlossy,
    TrueMaterial,
    TrueMatte,
    TrueMetal,
    require,
)

MaterialType = Literal["auto", "metal", "glossy", "matte"]

DEFAULT_ALPHA = 0.2
_KEYS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "metal": ("metal", "n", "k", "alpha", "roughness"),
        "glossy": ("color", "reflectance", "alpha", "roughness"),
        "matte": ("color", "reflectance"),
    }
)


def true_material(
    type: MaterialType = "auto",
    *,
    metal: str | None = None,
    n: Channels | None = None,
    k: Channels | None = None,
    color: Channels | None = None,
    reflectance: Channels | None = None,
    alpha: float | None = None,
    roughness: float | None = None,
    distribution: Distribution = "ggx",
) -> TrueMaterial:
    """The material that is described; None is what was not said.

    Args:
        type: "auto" takes a metal's parameters for a metal, colour with reflectance for glossy, else matte.
        metal: a name of the catalogue, in the place of `n` and `k`.
        n, k, color, reflectance, alpha, roughness, distribution: as `renderer.materials.ground_truth` has them.

    Raises:
        InputError: too much or too little is said for one material, or a value is out of its range; names the
            command-line option.
    """
    values = {
        "metal": metal,
        "n": n,
        "k": k,
        "color": color,
        "reflectance": reflectance,
        "alpha": alpha,
        "roughness": roughness,
    }
    given = {key: value for key, value in values.items() if value is not None}
    kind = _type_of(given) if type == "auto" else type
    for key, value in given.items():
        belonging = ", ".join(_KEYS[kind])
        require(f"--{key}", value, key in _KEYS[kind], f"no {key} for a {kind} material, which has {belonging}")
    return _MAKERS[kind](given, distribution)


def _metal(given: Mapping[str, Any], distribution: Distribution) -> TrueMetal:
    finish: dict[str, Any] = {"alpha": given.get("alpha"), "roughness": given.get("roughness")}
    return TrueMetal(**_indices(given), **finish, distribution=distribution)


def _glossy(given: Mapping[str, Any], distribution: Distribution) -> TrueGlossy:
    _require_given(given, "glossy", "color", "reflectance")
    return TrueGlossy(**given, distribution=distribution)


def _matte(given: Mapping[str, Any], distribution: Distribution) -> TrueMatte:
    _require_given(given, "matte", "color")
    return TrueMatte(**given)


_MAKERS: Mapping[str, Callable[[Mapping[str, Any], Distribution], TrueMaterial]] = MappingProxyType(
    {"metal": _metal, "glossy": _glossy, "matte": _matte}
)


def _require_given(given: Mapping[str, Any], kind: str, *keys: str) -> None:
    for key in keys:
        require(f"--{key}", "", key in given, f"three numbers here: a {kind} material has a {key}")


def _type_of(given: Mapping[str, Any]) -> str:
    if given.keys() & {"metal", "n", "k"}:
        return "metal"
    require("synth", "without a material", "color" in given, "--metal NAME, --n and --k, or --color")
    return "glossy" if "reflectance" in given else "matte"


def _indices(given: Mapping[str, Any]) -> dict[str, Any]:
    """n, k and where they come from."""
    found = [key for key in ("metal", "n", "k") if key in given]
    if "n" not in given and "k" not in given and found:
        known = known_metal(given["metal"])
        return {"n": known.n, "k": known.k, "metal": known.name, "source": known.source}
    told = " and ".join(found) or "without a metal"
    require("--metal", told, found == ["n", "k"], "either a metal's name, or n and k")
    return {"n": given["n"], "k": given["k"]}


def shading_model(asked: ShadingModel | None, *materials: TrueMaterial) -> ShadingModel:
    """The model that was asked for; else the viewer's where a material has its roughness, else Mitsuba's."""
    if asked is not None:
        return asked
    return "viewer" if any(getattr(material, "roughness", None) is not None for material in materials) else "mitsuba"


def with_default_alpha(material: TrueMaterial, model: ShadingModel) -> TrueMaterial:
    """The material, with a width where Mitsuba's needs one and none was said."""
    if model != "mitsuba" or not material.mirrors or material.alpha is not None:
        return material
    return replace(material, alpha=DEFAULT_ALPHA)
