"""What a fit needs to know of a type of material, in one place for each type."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.forward.pixel_model import PixelModel
from fit_material.fitter.materials.coordinates import Coordinates, WidthInterval
from fit_material.fitter.options.fidelity import Fidelity
from fit_material.shaders.materials.kinds import Kind, MaterialType
from fit_material.shaders.materials.material import AbstractMaterial
from fit_material.shaders.materials.quantities import Quantity
from fit_material.shaders.materials.widths import Width


@dataclass(frozen=True)
class Fittable:
    """A type of material that can be fitted.

    Attributes:
        kind: the type, as data.
        coordinates: determines the unknowns from a start, the interval of the lobe's width (None where the model
            has no light table), and the fidelity.
        start: determines where a search begins, from the model of the pixels, what they show, [p, 3], and the weights
            of these, [p, 3].
        half_reflecting: makes a material that reflects about half of the light, of a width.
        examples: makes named materials of a width, for a plan made before one is found.
        essential: quantities that must be determined for a fit to have a usable material; alpha stands for ρ where
            the model is the viewer's.
        decisive: quantities whose errors a further photograph is to shrink.
        foreseen: determines the unknowns that the errors of a further photograph are foreseen for.
        darkest: quantity, and value below which the material is so dark that stray light changes it; None where
            nothing is known of that.
    """

    kind: Kind
    coordinates: Callable[[Any, Any, Fidelity], Coordinates]
    start: Callable[[PixelModel, Float[Tensor, "p 3"], Float[Tensor, "p 3"]], AbstractMaterial]
    half_reflecting: Callable[[Any], AbstractMaterial]
    examples: Callable[[Width], Mapping[str, AbstractMaterial]]
    essential: tuple[Quantity, ...]
    decisive: tuple[Quantity, ...]
    foreseen: Callable[[WidthInterval], Coordinates]
    darkest: tuple[Quantity, float] | None = None

    @property
    def name(self) -> MaterialType:
        """Of the type."""
        return self.kind.name
