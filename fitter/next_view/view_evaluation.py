"""How much narrower a material's intervals would be with each of many further photographs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.forward.pixel_model import central
from fit_material.fitter.least_squares.jacobian import jacobian
from fit_material.fitter.least_squares.noise import relative_weight
from fit_material.fitter.materials.coordinates import Coordinates, WidthInterval
from fit_material.fitter.materials.registry import FITTABLE
from fit_material.fitter.next_view.expected_gain import ExpectedGain, Ratios
from fit_material.fitter.next_view.fisher_information import covariance, foreseen_noise, told_by
from fit_material.fitter.next_view.previous_result import material_of
from fit_material.fitter.observations.photograph import Photograph
from fit_material.fitter.observations.view_sampling import View, sampled_views
from fit_material.fitter.options.fidelity import MICROFACET_RANGE, PRESETS
from fit_material.fitter.options.progress import Progress
from fit_material.fitter.result.schema import FittedMaterial
from fit_material.fitter.uncertainty.estimates import reported_quantities, value_of
from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer, Tracer
from fit_material.shaders.materials.widths import alpha_of

WIDTH = WidthInterval(*MICROFACET_RANGE, logarithmic=True)
PIXELS = 192  # of each imagined picture and material: by the choice of pixels, ratios of errors scatter by 2 %
FULL = 1024  # of each photograph at most
TAKEN_PIXELS = 4096  # of all photographs together: their noise is measured with them
SAMPLES = 64  # directions of each imagined pixel; a derivative needs few, for all levels of alpha share them
LEVELS, SPAN = 3, 1.1  # of alpha around the one found
FOOTPRINT = 4  # rays along each side of a pixel, at most
FARTHEST = 30.0  # of a free number, where its domain ends to working precision
TINY = 1e-100  # an error below is none, and its square still a number

Picture = tuple[Camera, Bool[Tensor, "h w"] | None]
"""Where from, and which pixels count; None for one that was not taken, of which all do."""


@dataclass(frozen=True)
class Observer:
    """Who looks at an object from everywhere.

    Attributes:
        trace: of the object.
        lighting: the light, and the fidelity of the fit whose intervals are to shrink.
        photographs: those that there are.
        materials: names of the object's materials.
        progress: called with the stage and the fraction of it done.
    """

    trace: Tracer
    lighting: Lighting
    photographs: Sequence[Photograph]
    materials: Sequence[str]
    progress: Progress

    def prospects(self, found: Sequence[FittedMaterial], cameras: Sequence[Camera]) -> list[ExpectedGain]:
        """How the errors of each material found would shrink by a photograph of each camera."""
        most = max(PIXELS // 2, min(FULL, TAKEN_PIXELS // len(self.photographs)))
        pictures = ((photograph.camera, photograph.mask) for photograph in self.photographs)
        taken = self._sampled(pictures, len(self.photographs), most)
        imagined = self._sampled(((camera, None) for camera in cameras), len(cameras), PIXELS)
        prospects = []
        for material in found:
            index = self.materials.index(material.name)
            views = [[of_materials[index] for of_materials in each] for each in (taken, imagined)]
            prospects.append(self._prospect(material, *views))
        return prospects

    def _sampled(self, pictures: Iterable[Picture], number: int, count: int) -> list[list[View]]:
        """Pixels of each of a number of pictures, by material."""
        generator = torch.Generator().manual_seed(self.lighting.seed)
        footprint = min(FOOTPRINT, self.lighting.fidelity.footprint)
        found = []
        for camera, mask in pictures:
            self.progress("looking from all round", len(found) / number)
            sampled = sampled_views(
                self.trace,
                camera,
                mask,
                materials=len(self.materials),
                count=count,
                footprint=footprint,
                generator=generator,
            )
            found.append(sampled)
        return found

    def _prospect(self, found: FittedMaterial, taken: Sequence[View], imagined: Sequence[View]) -> ExpectedGain:
        """Standard errors with one of the imagined views over those without.

        A fit takes a fixed number of pixels from all photographs together: with one more, there are fewer of each.
        """
        coordinates = FITTABLE[found.type].foreseen(WIDTH)
        x = coordinates.free(material_of(found)).clamp(-FARTHEST, FARTHEST)
        radiance = self._radiance(taken, coordinates, x, self.lighting.fidelity.samples)
        known, difference = _surface(taken), self._relative_difference(taken, radiance(x))
        told = told_by(taken, radiance, x, foreseen_noise(known, difference, known, found.type))
        radiance = self._radiance(imagined, coordinates, x, SAMPLES)
        new = told_by(imagined, radiance, x, foreseen_noise(known, difference, _surface(imagined), found.type))
        pixels, count = self.lighting.fidelity.pixels, len(taken)
        present = told.information(pixels / count).sum(0)
        extended = told.information(pixels / (count + 1)).sum(0) + new.information(pixels / (count + 1))

        def shrunk(information: Float[Tensor, "v x x"]) -> Ratios:
            return _ratios(present, information, coordinates, x)

        more = PRESETS["reference"].pixels
        finer = shrunk(told.information(more / count).sum(0)[None]) if pixels < more else None
        return ExpectedGain(found, shrunk(extended), finer)

    def _relative_difference(self, views: Sequence[View], model: Float[Tensor, "p 3"]) -> Float[Tensor, "p 3"]:
        """Model less photographs, relative to the model."""
        models = model.split([len(view.pixels) for view in views])
        differences = [model[:0]]
        for view, picture, photograph in zip(views, models, self.photographs, strict=True):
            if len(picture):
                seen = photograph.radiance[tuple(view.pixels.T)].double()
                differences.append((picture - seen) * relative_weight(picture))
        return torch.cat(differences)

    def _radiance(
        self, views: Sequence[View], coordinates: Coordinates, x: Float[Tensor, " x"], samples: int
    ) -> Callable[[Tensor], Tensor]:
        """The radiance of all views' pixels as a function of the free vector, near x; one light table serves them."""
        surface = gbuffer.concatenate([view.surface for view in views])
        if not len(surface.hit):
            return lambda x: x.new_zeros(0, 3)
        material = coordinates.material(x)
        model = self.lighting.pixels(surface, body=material.has_body)
        if material.width is not None:
            alpha = float(alpha_of(material.width))

            def report(share: float) -> None:
                self.progress("integrating", share)

            model = model.under(self.lighting.table(surface, (alpha / SPAN, alpha * SPAN, LEVELS), samples, report))
        return lambda x: model.radiance(coordinates.material(x))


def _surface(views: Sequence[View]) -> GBuffer:
    """The rays in the middle of all views' pixels."""
    return central(gbuffer.concatenate([view.surface for view in views]))


def _ratios(
    before: Float[Tensor, "x x"], after: Float[Tensor, "v x x"], coordinates: Coordinates, x: Float[Tensor, " x"]
) -> Ratios:
    """Standard errors by the information after, over those before."""
    covariances = [covariance(information, coordinates, x) for information in (before, after)]
    ratios = {}
    for quantity in reported_quantities(coordinates.material(x)):
        gradient = jacobian(lambda x, of=quantity: value_of(coordinates.material(x), of), x)
        error, smaller = ((gradient @ each * gradient).sum(-1).sqrt().clamp_min(TINY) for each in covariances)
        ratios[quantity.name] = smaller / error
    return ratios
