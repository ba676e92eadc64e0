"""Each effect by itself: the picture with all that is on, the one without it, and their difference."""

from __future__ import annotations

from dataclasses import replace

from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.effects.plan_rules import RULES
from fit_material.fitter.fitted.part import FittedPart, shade_by_material
from fit_material.fitter.fitted.planned import PlannedFit
from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.observations.album import Thumbnail
from fit_material.fitter.report.image_quality import ViewPictures
from fit_material.renderer.rays.gbuffer import GBuffer, Tracer
from fit_material.renderer.rays.picture import Picture, draw
from fit_material.shaders.materials.types import Material

SIDE = 96  # pixels along a strip's pictures at most
SAMPLES = 128
FOOTPRINT = 2


def strips(planned: PlannedFit, thumbnail: Thumbnail, trace: Tracer) -> list[ViewPictures]:
    """Of each effect that is on the pictures with and without it, as `photograph` and `fit` under its name.

    Args:
        planned: the materials found, and by which effects.
        thumbnail: of the photograph whose pixels are drawn.
        trace: of the object.
    """
    step = -(-max(thumbnail.mask.shape) // SIDE)
    mask, distance = thumbnail.mask[::step, ::step], thumbnail.step * step

    def picture(without: str | None) -> Picture:
        def shade(surface: GBuffer) -> Float[Tensor, "p 3"]:
            return shade_by_material(planned.parts, surface, lambda part, seen: _radiance(planned, part, seen, without))

        return draw(trace, thumbnail.camera, mask, distance, FOOTPRINT, shade)

    whole = picture(None)
    shown, drawn = whole.radiance.numpy(), whole.mask.numpy()
    names = [each.name for each in planned.plan.decisions if each.on and not RULES[each.name].always]
    return [ViewPictures(name, shown, picture(name).radiance.numpy(), drawn) for name in names]


def _radiance(planned: PlannedFit, part: FittedPart, surface: GBuffer, without: str | None) -> Float[Tensor, "p 3"]:
    """One material's picture with the plan's effects, but for one."""
    material = part.choice.fit.material

    def drawn(made: Material = material, lighting: Lighting = part.lighting) -> Float[Tensor, "p 3"]:
        return lighting.simulating(lighting.effects - {without or ""}).radiance(made, surface, SAMPLES)

    if without == "diffuse-irradiance" and material.color is not None:
        return drawn(_bodiless(material)) if material.mirrors else 0 * drawn()
    if without == "reflection" and material.mirrors:
        return 0 * drawn() if material.color is None else drawn() - drawn(_bodiless(material))
    if part.polish is None:
        return drawn()
    if without not in ("self-visibility", "interreflection"):
        return drawn() + part.polish.picture(surface)
    by_rays = part.lighting.effects | {"self-visibility"}  # in place of the paths, which have it with the rest
    occluded = replace(part.lighting, occluder=planned.planner.occluder, effects=by_rays)
    direct = occluded.radiance(material, surface, SAMPLES)
    if without == "interreflection":
        return direct
    hidden = drawn() - direct
    return drawn() + part.polish.picture(surface) + hidden


def _bodiless(material: Material) -> Material:
    """The material's surface over a black body."""
    assert material.color is not None
    return material.with_color(0 * material.color)
