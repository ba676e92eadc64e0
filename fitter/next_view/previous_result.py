"""A `result.json` that further work starts from: whether it is whole, and of the scene that it is used with."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from fit_material.fitter.observations.scene_data import Loaded
from fit_material.fitter.result.schema import FittedMaterial, InputFile, Result, read_result
from fit_material.renderer.errors.input_error import InputError
from fit_material.shaders.materials.kinds import KINDS
from fit_material.shaders.materials.quantities import ALPHA, Quantity
from fit_material.shaders.materials.types import Material, made_of
from fit_material.shaders.materials.widths import Microfacet


def read_earlier_result(path: Path) -> Result:
    """A result that has materials, with all their numbers.

    Raises:
        InputError: it cannot be read, or something is missing.
    """
    result = read_result(path)
    if not result.materials:
        raise InputError(path, "materials", "[]", "the materials that were fitted; fit again")
    for index, material in enumerate(result.materials):
        kind = KINDS[material.type]
        for quantity in (*kind.stored, *((ALPHA,) if kind.mirrors else ())):
            _require_numbers(material, quantity, path, f"materials[{index}].{quantity.name}")
    return result


def _require_numbers(material: FittedMaterial, quantity: Quantity, path: Path, field: str) -> None:
    value: float | tuple[float, ...] | None = getattr(material, quantity.name)
    low, high = quantity.domain
    numbers = value if isinstance(value, tuple) else (value,)
    for number in numbers:
        if number is None or not low <= number <= high:
            shown = "null" if value is None else value
            raise InputError(path, field, shown, f"numbers from {low:g} to {high:g}, as a fit writes them")


def require_of_scene(result: Result, path: Path, loaded: Loaded, scene_file: Path) -> None:
    """Refuse a result of another scene, or of one that has changed since.

    Raises:
        InputError: the result has a material that the scene does not have, or was fitted from other files.
    """
    for index, material in enumerate(result.materials):
        if material.name not in loaded.materials:
            expected = f"the name of a material of {scene_file}: {', '.join(loaded.materials)}"
            raise InputError(path, f"materials[{index}].name", material.name, expected)
    changed = _not_among(loaded.inputs, result.inputs)
    if changed:
        expected = f"{changed} as it was when it was fitted; fit again, or leave --result out"
        raise InputError(path, "inputs", "of other files", expected)
    gone = _not_among(result.inputs, loaded.inputs)
    if gone:
        expected = f"only files that {scene_file} reads; fit again, or leave --result out"
        raise InputError(path, "inputs", f"with {gone}", expected)


def _not_among(files: tuple[InputFile, ...], others: tuple[InputFile, ...]) -> str | None:
    """The first file whose content none of the others has."""
    known = {other.sha256 for other in others}
    return next((file.path for file in files if file.sha256 not in known), None)


def material_of(fitted: FittedMaterial) -> Material:
    """What was found, as the shading model has it by microfacets, float64."""

    def number(quantity: Quantity) -> Tensor:
        return torch.tensor(getattr(fitted, quantity.name), dtype=torch.float64)

    return made_of(fitted.type, number, lambda: Microfacet(number(ALPHA)))
