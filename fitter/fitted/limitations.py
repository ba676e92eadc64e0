"""What of a scene was left out or replaced, and what the errors of its fit do not count, a sentence each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from fit_material.fitter.fitted.part import FittedPart
from fit_material.fitter.materials.registry import FITTABLE
from fit_material.fitter.observations.scene_data import Loaded
from fit_material.fitter.options.fidelity import Fidelity
from fit_material.fitter.result.schema import FittedMaterial
from fit_material.shaders.materials.kinds import KINDS

NAMED = 3  # photographs, at most
"""What no material of a type has less of; a glossy one may have a black body."""


def caveats(loaded: Loaded, parts: Sequence[FittedPart], fidelity: Fidelity) -> list[str]:
    """What of the input was left out or replaced, and what the model cannot follow.

    Args:
        loaded: the scene.
        parts: the fits of its materials.
        fidelity: of these.
    """
    return [*_on_pixels(loaded, parts), *_on_what_is_left_out(loaded, parts), *_on_the_model(parts, fidelity)]


def _on_pixels(loaded: Loaded, parts: Sequence[FittedPart]) -> Iterator[str]:
    seen = loaded.photographs.thumbnails
    clipped, nonfinite = (sum(getattr(each, key) for each in seen) for key in ("clipped", "nonfinite"))
    if loaded.environment.repaired:
        count = loaded.environment.repaired
        yield f"{count} texels of the environment were negative or not finite and were replaced."
    if clipped:
        bounded = sum(int(part.observed.bounded.sum()) for part in parts if part.observed.bounded is not None)
        bounds = f"; of {bounded} of them the fit knows that they are white at least" if bounded else ""
        yield f"{clipped} clipped pixels of the photographs, or beside such, were not fitted{bounds}."
    if nonfinite:
        yield f"{nonfinite} pixels of the photographs were not finite and were left out."
    if any(part.observed.lossy for part in parts):
        yield "JPEG darkens dark, noisy pixels, by up to some per cent, which the errors do not count."


def _on_what_is_left_out(loaded: Loaded, parts: Sequence[FittedPart]) -> Iterator[str]:
    again = [loaded.photographs.thumbnails[index].name for index in sorted(loaded.repeated)]
    if again:
        named = ", ".join(again[:NAMED]) + (f" and {len(again) - NAMED} more" if len(again) > NAMED else "")
        yield f"Photographs that repeat an earlier one were left out: {named}."
    fitted = {part.index for part in parts}
    unseen = [name for index, name in enumerate(loaded.materials) if index not in fitted]
    if unseen:
        yield f"No photograph shows {', '.join(unseen)}: the result leaves it out."


def _on_the_model(parts: Sequence[FittedPart], fidelity: Fidelity) -> Iterator[str]:
    for part in parts:
        if is_too_dark(part.material):
            yield (
                f"{part.material.name} returns less light than any {part.material.type} material:"
                " exposures or the environment's scale are wrong."
            )
    if fidelity.blurs and any(KINDS[part.material.type].mirrors for part in parts):
        yield (
            "The viewer's blur follows no real lobe closely: F0 and roughness make up for the difference, which their"
            " errors do not count."
        )


def is_too_dark(material: FittedMaterial) -> bool:
    """Whether no material of that type is as dark."""
    darkest = FITTABLE[material.type].darkest
    if darkest is None:
        return False
    quantity, least = darkest
    found = getattr(material, quantity.name)
    return found is not None and max(found) < least
