"""What the radiance of pixels is computed with: the light, the fidelity, and the tables that they call for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.forward.direct_light import DIFFUSE_DEGREE
from fit_material.fitter.forward.pixel_effects import PIXEL_EFFECTS, SeenPixels
from fit_material.fitter.forward.pixel_model import PixelModel, central, exact_pixels, viewer_pixels
from fit_material.fitter.observations.scene_data import Loaded
from fit_material.fitter.options.fidelity import Fidelity
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.renderer.environment import cubemap
from fit_material.renderer.environment.downsampling import box_filtered
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.images.textures import Texture, lookup
from fit_material.renderer.light_sampling.integrator import Integration, LobeGrid
from fit_material.renderer.light_tables import light_table
from fit_material.renderer.light_tables.irradiance_table import diffuse_table, even_table
from fit_material.renderer.light_tables.light_table import LightTable
from fit_material.renderer.light_tables.mirror_table import mirror_table
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.renderer.rays.occlusion import Occluder
from fit_material.renderer.rays.pixel_footprint import middle
from fit_material.renderer.scene.lights import light_of
from fit_material.renderer.viewer_model.viewer_light import Surroundings, surroundings
from fit_material.shaders.effects import EFFECTS
from fit_material.shaders.lights import Light
from fit_material.shaders.materials.fresnel_models import REFLECTANCES
from fit_material.shaders.materials.types import Material

if TYPE_CHECKING:
    from fit_material.fitter.forward.received_light import DiffuseLight

DIFFUSE_FACE_SIZE = 48  # texels of 1.9°: under softboxes 4e-4 of the light in the root mean square, most of it where
DIFFUSE_MARGIN = 3  # one of them sets; a tenth of that in the lit half, as much as `diffuse_table`'s blocks leave
MOST_DIFFUSE = 6 * (DIFFUSE_FACE_SIZE + 2 * DIFFUSE_MARGIN) ** 2  # pixels: of more, it is looked up by their normals
MOST_OCCLUDED = 2000  # pixels of a picture for which rays look in all directions; of more, in a few


@dataclass(frozen=True)
class Lighting:
    """The light on the object, and how accurately to compute it.

    Attributes:
        environment: the surroundings; light is integrated on their device.
        sources: lights beside the environment.
        fidelity: how accurately.
        seed: of the integration.
        effects: the names of those that are simulated, of `shaders.effects`.
        occluder: the object, where it may stand before its own light.
        color_map: the tint of the body by texture coordinates; None where it is even.
        openness: maps of ambient occlusion of the object's materials, which count in place of what rays find; None, or
            left out, where there is none.
        received: diffuse light on the object, of which pictures take what it hides and, with "interreflection", what it
            sends itself; None where a few rays determine the former.
    """

    environment: Environment
    sources: tuple[Light, ...]
    fidelity: Fidelity
    seed: int = 0
    effects: frozenset[str] = field(default_factory=lambda: frozenset(EFFECTS))
    occluder: Occluder | None = None
    color_map: Texture | None = None
    openness: tuple[Texture | None, ...] = ()
    received: DiffuseLight | None = None

    def simulating(self, effects: frozenset[str]) -> Lighting:
        """The same light with these effects, and no others."""
        fidelity = self.fidelity
        if fidelity.reflectance == "conductor" and "exact-fresnel" not in effects:
            fidelity = replace(fidelity, reflectance="lazanyi")
        return replace(self, effects=effects, fidelity=fidelity)

    def turned(self, degrees: float) -> Lighting:
        """The same with the environment rotated further about +Y."""
        environment = replace(self.environment, rotation=self.environment.rotation + degrees)
        return replace(self, environment=environment)

    def pixels(self, surface: GBuffer, body: bool, shown: bool = False) -> PixelModel:
        """The model of pixels [p, k], without a table so far.

        Args:
            surface: rays inside each.
            body: whether diffuse light is integrated.
            shown: whether it is for pictures to look at, whose ambient occlusion may be known to a few per cent.
        """
        model = self._plain_pixels(self._rays(surface), body, shown)
        seen = SeenPixels(surface, body, self.color_map)
        for effect in PIXEL_EFFECTS.values():
            model = effect.applied(model, seen) if effect.name in self.effects else model
        return model

    def _plain_pixels(self, surface: GBuffer, body: bool, shown: bool) -> PixelModel:
        """The model of pixels in one colour, without effects that follow from it."""
        reflectance = REFLECTANCES[self.fidelity.reflectance]
        if self.fidelity.blurs:
            openness = self._mapped_openness(central(surface))
            return viewer_pixels(surface, self.viewers.ambient, self.sources, reflectance, openness)
        diffuse = self._diffuse(surface, shown) if body else None
        lights = (self._before("self-visibility"), "light-reflection" in self.effects)
        return exact_pixels(surface, diffuse, self.sources, self.fidelity.distribution, reflectance, *lights)

    def table(
        self,
        surface: GBuffer,
        levels: tuple[float, float, int],
        samples: int,
        progress: Callable[[float], None] = lambda share: None,
    ) -> LightTable:
        """Light through the fidelity's lobe; `levels` are the ends of its roughness and their number."""
        surface = self._rays(surface)
        if self.fidelity.lobe == "taps":
            return light_table.tap_table(central(surface), self.viewers.cubemap, levels)
        if self.fidelity.lobe == "gaussian":
            return light_table.gaussian_table(central(surface), self.near, levels, samples, self.seed)
        if "blur" not in self.effects:
            return mirror_table(surface, self.near, levels[0], self.fidelity.degree, self.seed)
        return light_table.microfacet_table(
            surface,
            self.environment,
            LobeGrid(*levels, self.fidelity.distribution),
            Integration(self.fidelity.degree, samples, self.seed),
            occluder=self._before("self-visibility"),
            progress=progress,
        )

    def radiance(self, material: Material, surface: GBuffer, samples: int) -> Float[Tensor, "p 3"]:
        """The picture of one material, float64."""
        return self.model(material, surface, samples).radiance(material)

    def model(self, material: Material, surface: GBuffer, samples: int) -> PixelModel:
        """The model of pixels by a table that holds the roughness of one material alone."""
        bare = self.pixels(surface, body=material.has_body, shown=True)
        return bare.under(self.table_of(material, surface, samples))

    def table_of(self, material: Material, surface: GBuffer, samples: int) -> LightTable | None:
        """The light through the lobe of one material alone; None of one that mirrors nothing."""
        if material.width is None:
            return None
        roughness = float(material.width.value)
        span = (roughness * 0.999, roughness * 1.001, 1)  # the one level lies in their middle
        return self.table(surface, span, samples)

    @cached_property
    def viewers(self) -> Surroundings:
        """The same light as the viewer has it."""
        return replace(surroundings(self.near), sources=self.sources)

    @property
    def near(self) -> Environment:
        """The environment on the CPU: 49 taps are not worth the way."""
        return replace(self.environment, radiance=self.environment.radiance.cpu())

    def _rays(self, surface: GBuffer) -> GBuffer:
        """The rays of each pixel that are followed."""
        return surface if "pixel-footprint" in self.effects else middle(surface)

    def _before(self, effect: str) -> Occluder | None:
        """What stands before the light, where that is simulated."""
        return self.occluder if effect in self.effects else None

    def _diffuse(self, surface: GBuffer, shown: bool) -> Float[Tensor, "p b 3"]:
        surface = middle(surface)[:, 0]
        mapped = self._mapped_openness(surface)
        if mapped is None:
            return self._diffuse_by_rays(surface, shown, self._before("ambient-occlusion"))
        found = self._diffuse_by_rays(surface, shown, None) * mapped.nan_to_num(1.0)[:, :, None].float()
        bare = mapped[:, 0].isnan()  # materials without a map
        if bare.any():
            found[bare] = self._diffuse_by_rays(surface[bare], shown, self._before("ambient-occlusion"))
        return found

    def _mapped_openness(self, surface: GBuffer) -> Float[Tensor, "p 1"] | None:
        """Ambient occlusion of points [p] by the maps, NaN where there is none; None where no map is looked at."""
        maps = {index: each for index, each in enumerate(self.openness) if each is not None}
        if not self.effects & {"ambient-occlusion", "double-bounce"} or not maps:
            return None
        found = torch.full((len(surface.hit), 1), torch.nan, dtype=torch.float64)
        for index, texture in maps.items():
            own = surface.material == index
            found[own] = lookup(texture, surface.uv[own]).double()
        return found

    def _diffuse_by_rays(self, surface: GBuffer, shown: bool, occluder: Occluder | None) -> Float[Tensor, "p b 3"]:
        """The light of points [p] that what stands before it leaves over."""
        if shown and self.received is not None:
            return self._received(surface, self.received, occluder is not None)
        if occluder is None and len(surface.hit) <= MOST_DIFFUSE:
            return diffuse_table(surface.normal, self.near, DIFFUSE_DEGREE)
        if occluder is not None and (not shown or len(surface.hit) <= MOST_OCCLUDED):
            return diffuse_table(surface.normal, self.near, DIFFUSE_DEGREE, (occluder, occluder.origins(surface)))
        found = self._unoccluded(surface)
        return found if occluder is None else found * occluder.openness(surface)[:, None, None].to(found)

    def _received(self, surface: GBuffer, received: DiffuseLight, hidden: bool) -> Float[Tensor, "p b 3"]:
        """The light of points [p] by its values at places."""
        found, (share, returned) = self._unoccluded(surface), received.at(surface)
        if hidden:
            found = found * share[:, None].to(found)
        if "interreflection" in self.effects:
            found = found + (returned[:, None] * even_table(DIFFUSE_DEGREE)[:, None]).to(found)
        return found

    def _unoccluded(self, surface: GBuffer) -> Float[Tensor, "p b 3"]:
        """The light of points [p] before which nothing stands, by their normals."""
        found = cubemap.smooth_lookup(self._diffuse_by_normal, DIFFUSE_MARGIN, surface.normal)
        return found.reshape(-1, DIFFUSE_DEGREE, 3)

    @cached_property
    def _diffuse_by_normal(self) -> Float[Tensor, "6 m m c"]:
        """The table of every normal, for many pixels: between its texels it is smooth."""
        normals = cubemap.face_directions(DIFFUSE_FACE_SIZE, DIFFUSE_MARGIN)
        table = diffuse_table(normals.flatten(0, 2), self.near, DIFFUSE_DEGREE)
        return table.reshape(*normals.shape[:3], -1)


def lighting_for(loaded: Loaded, options: FitOptions, device: torch.device) -> Lighting:
    """The light of the scene on that device, and how accurately to compute it."""
    fidelity = options.fidelity
    radiance = box_filtered(loaded.environment.radiance, fidelity.environment_size)
    environment = replace(loaded.environment, radiance=radiance.to(device, getattr(torch, fidelity.dtype)))
    sources = tuple(light_of(light) for light in loaded.scene.lights)
    openness = tuple(each.ambient_occlusion for each in loaded.maps)
    return Lighting(environment, sources, options.fidelity, options.seed, openness=openness)
