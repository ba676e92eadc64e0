"""The file of `synth --materials`: what each material of a mesh is truly made of, by name. Checked on reading.

[[materials]]
name = "lid"                    # the mesh's `usemtl` name
type = "metal"                  # metal, glossy, matte
metal = "Au"                    # or n = [0.1, 0.4, 1.4] and k = [3.6, 2.3, 1.9]
alpha = 0.2                     # Mitsuba's width; or roughness = 0.3, the viewer's

[[materials]]
name = "body"
type = "glossy"
color = [0.6, 0.1, 0.1]
reflectance = [0.04, 0.04, 0.04]
alpha = 0.1
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

from pydantic import Field, Strict

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.toml import load_toml
from fit_material.renderer.files.validation import Checked, Vector, check, known_name
from fit_material.renderer.materials.bsdf import Distribution
from fit_material.renderer.materials.ground_truth import TRUE_TYPES, ShadingModel, TrueMaterial, require_shadable
from fit_material.renderer.materials.material_arguments import shading_model, true_material
from fit_material.shaders.materials.kinds import MaterialType


class TrueMaterialSpec(Checked):
    """`[[materials]]`: the keys of `true_material`, by the mesh's material name."""

    name: str
    type: Annotated[MaterialType, known_name(lambda: TRUE_TYPES)]
    metal: str | None = None
    n: Vector | None = None
    k: Vector | None = None
    color: Vector | None = None
    reflectance: Vector | None = None
    alpha: float | None = None
    roughness: float | None = None
    distribution: Distribution = "ggx"


class MaterialFile(Checked):
    """The whole file."""

    materials: Annotated[tuple[TrueMaterialSpec, ...], Strict(False), Field(min_length=1)]


def read_materials(path: Path, asked: ShadingModel | None = None) -> tuple[dict[str, TrueMaterial], ShadingModel]:
    """The materials of a file by name, and the model that shows them.

    Args:
        asked: the requested model; where None, what the materials' alpha or roughness calls for.

    Raises:
        InputError: about the first thing that is wrong: file, field, value and what was expected.
    """
    specs = check(MaterialFile, load_toml(path, "file of materials"), path).materials
    materials: dict[str, TrueMaterial] = {}
    for index, spec in enumerate(specs):
        if spec.name in materials:
            raise InputError(path, f"materials[{index}].name", f'"{spec.name}"', "a name that is not taken before")
        with _told_of(path, index):
            materials[spec.name] = true_material(**spec.model_dump(exclude={"name"}))
    model = shading_model(asked, *materials.values())
    for index, material in enumerate(materials.values()):
        with _told_of(path, index):
            require_shadable(material, model)
    return materials, model


@contextmanager
def _told_of(path: Path, index: int) -> Iterator[None]:
    """An error about a command-line option, as one about the key in the file."""
    try:
        yield
    except InputError as error:
        key = error.file.removeprefix("--")
        raise InputError(path, f"materials[{index}].{key}", error.value, error.expected) from None
