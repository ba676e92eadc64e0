"""The plan of a fit: which effects its photographs call for, before anything is found and after."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from fit_material.fitter.effects.effect_measurement import Measurement, Sample, possible
from fit_material.fitter.effects.plan import Change, Plan, planned
from fit_material.fitter.effects.plan_rules import Facts
from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.observations.pixel_selection import FEWEST
from fit_material.fitter.observations.scene_data import Loaded
from fit_material.fitter.options.fidelity import Fidelity
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.rays.gbuffer import Tracer
from fit_material.renderer.rays.occlusion import Occluder, occluder
from fit_material.shaders.effects import EFFECTS
from fit_material.shaders.materials.kinds import KINDS, MaterialType
from fit_material.shaders.materials.types import Material
from fit_material.shaders.materials.widths import Blur, Microfacet

TOLERANCE = 0.01
"""Relative change of a pixel from which an effect is called for, without a --tolerance."""
FOOTPRINT = 4  # rays along each side of a pixel that is looked at, at most


@dataclass(frozen=True)
class Planner:
    """What a plan is made from.

    Attributes:
        loaded, trace: the scene.
        lighting: the light, without an occluder.
        options: of the fit.
    """

    loaded: Loaded
    trace: Tracer
    lighting: Lighting
    options: FitOptions

    @cached_property
    def occluder(self) -> Occluder | None:
        """What may stand before the light; None where the object is convex, and in the thesis's model."""
        return None if self.lighting.fidelity.blurs else occluder(self.loaded.shape)

    @cached_property
    def sample(self) -> Sample:
        """Pixels to measure effects on."""
        footprint = min(self.lighting.fidelity.footprint, FOOTPRINT)
        return Sample.of(self.loaded.photographs, self.trace, footprint, self.options.seed)

    def plan(self, kinds: Sequence[MaterialType | None], found: Mapping[str, Material] | None = None) -> Plan:
        """The effects that the photographs call for.

        Args:
            kinds: types of the materials, None where that is open.
            found: the materials, by name, once they are known.
        """
        fidelity, options = self.lighting.fidelity, self.options
        types = frozenset(each.type for each in found.values()) if found else _possible_types(kinds)
        facts = Facts(
            kinds=types,
            lights=len(self.lighting.sources),
            convex=fidelity.blurs or self.occluder is None,
            blurs=fidelity.blurs,
            reflectance=fidelity.reflectance,
            footprint=fidelity.footprint,
            untraced=None if self.occluder is None else _untraced(types, fidelity) or spared(self._free),
            found=found is not None,
            maps=self._maps,
        )
        tolerance = options.tolerance or TOLERANCE
        materials = possible(types, Blur if fidelity.blurs else Microfacet) if found is None else found

        def measured(names: Collection[str]) -> Mapping[str, Change]:
            everything = replace(self.lighting, occluder=self.occluder, effects=frozenset(EFFECTS))
            return Measurement(self.sample, everything, materials, tolerance).changes(names)

        wanted = (*options.wanted, *(("interreflection",) if options.polish else ()))
        return planned(facts, measured, tolerance).overruled(wanted, options.unwanted)

    @property
    def _maps(self) -> frozenset[str]:
        """Textures that are recovered or given."""
        given = self.loaded.maps
        normal = {"normal"} if any(each.normal is not None for each in given) else set()
        openness = {"ambient-occlusion"} if any(each.ambient_occlusion is not None for each in given) else set()
        return frozenset({*self.options.maps, *normal, *openness})

    @property
    def _free(self) -> float:
        """Share of the pixels that mirror nothing of an object that is not convex."""
        return 1 - self.sample.self_seeing

    def simulating(self, plan: Plan) -> Lighting:
        """The light with what the plan has on."""
        by_rays = plan.on - ({"self-visibility"} if plan["interreflection"].on else set())  # else the paths have it
        hides = by_rays & {"self-visibility", "ambient-occlusion"}
        before = (self.occluder or Occluder.of(self.loaded.shape)) if hides else None
        return replace(self.lighting, occluder=before).simulating(by_rays)

    def kept(self, plan: Plan, kinds: Sequence[MaterialType | None]) -> tuple[int, ...]:
        """Materials of which pixels are taken though they mirror the object: its light is simulated there, or small."""
        if plan.avoids:
            return ()
        traced = plan["interreflection"].on
        return tuple(index for index, kind in enumerate(kinds) if not traced or (kind is not None and is_traced(kind)))


def _possible_types(kinds: Sequence[MaterialType | None]) -> frozenset[str]:
    return frozenset(KINDS) if None in kinds else frozenset(kind for kind in kinds if kind is not None)


def spared(free: float) -> str | None:
    """Why no paths need be traced, though some pixels mirror the object: a share of others does not, and is fitted."""
    return f"{free:.1%} of the pixels mirror nothing of it, which is enough" if free * FEWEST >= 1 else None


def is_traced(kind: str) -> bool:
    """Whether paths are traced for a type of material: for those that have a surface alone."""
    return not KINDS[kind].has_body


def _untraced(types: frozenset[str], fidelity: Fidelity) -> str | None:
    """Why no paths can be traced; finds out by loading Mitsuba, which takes a second."""
    if not any(map(is_traced, types)):
        return "paths are traced for metals alone"
    from fit_material.fitter.effects.interreflection import require_polishable

    try:
        require_polishable(fidelity)
    except InputError as error:
        return f"paths take {error.expected}"
    return None
