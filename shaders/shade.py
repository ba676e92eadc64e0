"""The thesis's model, put together: a material under the light of one object, seen at points of its surface.

    metal    C = blur(L, r, ρ·depth) · F + light reflection · F
    glossy   C = diffuse(energy_guard(color, F)) + the metal's reflection, F = schlick(reflectance)
    matte    C = diffuse(color) · F,  F = schlick(reflectance)

[thesis 3.2, 4.3; MODEL.md 3, 4]. Everything is differentiable in the material, the geometry and the light.
"""

from __future__ import annotations

import functools
import math
import operator
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import assert_never

from jaxtyping import Float
from torch import Tensor

from fit_material.shaders.lights import Incident, Light
from fit_material.shaders.materials.fresnel_models import viewer_reflectance
from fit_material.shaders.materials.lobes import Blurred, Diffuse, ThesisLobe
from fit_material.shaders.materials.material import MaterialReflectance
from fit_material.shaders.materials.types import Material
from fit_material.shaders.optics import blur, diffuse

Lookup = Callable[[Float[Tensor, "*p 3"]], Float[Tensor, "*p 3"]]
DepthLookup = Callable[[Float[Tensor, "*p 3"]], Float[Tensor, "*p"]]


@dataclass(frozen=True)
class Points:
    """Points of a surface, any leading shape.

    Attributes:
        normal: unit shading normal, a normal map's where there is one.
        view: unit direction to the viewer.
        openness: ambient occlusion, 1 open to 0 closed; None where there is no such map.
        tint: the colour map's value, which multiplies `color`; None where there is no map.
        position: in world space; may be left out where all lights are directional.
    """

    normal: Float[Tensor, "*p 3"]
    view: Float[Tensor, "*p 3"]
    openness: Float[Tensor, "*p 1"] | None = None
    tint: Float[Tensor, "*p 3"] | None = None
    position: Float[Tensor, "*p 3"] | None = None

    @property
    def n_dot_v(self) -> Float[Tensor, "*p 1"]:
        """Cosine between normal and view, 0 where the normal faces away."""
        return (self.normal * self.view).sum(-1, keepdim=True).clamp(0, 1)

    @property
    def reflected(self) -> Float[Tensor, "*p 3"]:
        """r = 2(n·v)n - v, the mirrored view."""
        return 2 * (self.normal * self.view).sum(-1, keepdim=True) * self.normal - self.view

    def lit_by(self, light: Light) -> Incident:
        """The light that arrives from one source; NaN where that depends on a position that is unknown."""
        position = self.position
        return light.at(self.normal.new_full(self.normal.shape, math.nan) if position is None else position)


class Illumination(ABC):
    """The light that falls on one object.

    Attributes:
        ambient: coefficients for `diffuse.ambient`.
        sources: lights beside the environment.
    """

    ambient: Float[Tensor, "9 3"]
    sources: tuple[Light, ...]

    @abstractmethod
    def blurred(self, r: Float[Tensor, "*p 3"], rho: Float[Tensor, ""]) -> Float[Tensor, "*p 3"]:
        """The environment around r, blurred with the radius ρ."""


@dataclass(frozen=True)
class EnvironmentLight(Illumination):
    """Light of an environment that is looked up.

    Attributes:
        radiance: L by direction: the far environment's, or that of the object's own captured cubemap.
        depth: d = 1 - near/D in [0, 1) by direction, 1 for the sky; None where nothing is near [MODEL.md 3.3].
    """

    radiance: Lookup
    ambient: Float[Tensor, "9 3"]
    depth: DepthLookup | None = None
    sources: tuple[Light, ...] = ()

    def blurred(self, r: Float[Tensor, "*p 3"], rho: Float[Tensor, ""]) -> Float[Tensor, "*p 3"]:
        return blur.blur(self.radiance, r, rho if self.depth is None else rho * self.depth(r))


def shade(
    material: Material, points: Points, light: Illumination, reflectance: MaterialReflectance = viewer_reflectance
) -> Float[Tensor, "*p 3"]:
    """Radiance towards the viewer, linear Rec. 709: the sum over the material's lobes.

    Args:
        reflectance: of metals; the thesis's is `viewer_reflectance`.
    """
    lobes = material.thesis_lobes(reflectance, points.tint)
    return functools.reduce(operator.add, (_lobe(lobe, points, light) for lobe in lobes))


def _lobe(lobe: ThesisLobe, points: Points, light: Illumination) -> Float[Tensor, "*p 3"]:
    if isinstance(lobe, Blurred):
        return reflection(lobe.reflectance(points.n_dot_v), lobe.rho, points, light)
    if isinstance(lobe, Diffuse):
        return lobe.albedo * lobe.leaving(points.n_dot_v) * scattered(points, light)
    assert_never(lobe)


def reflection(
    f: Float[Tensor, "*p 3"], roughness: Float[Tensor, ""], points: Points, light: Illumination
) -> Float[Tensor, "*p 3"]:
    """What the surface mirrors, blurred: environment and lights under the reflectance F [MODEL.md 3, 4].

    Args:
        f: F at n·v.
        roughness: ρ.
    """
    r = points.reflected
    blurred = light.blurred(r, roughness)
    for source in light.sources:
        incident = points.lit_by(source)
        blurred = blurred + incident.radiance * blur.light_reflection(r, incident.towards, roughness)
    return double_bounce(f, points.openness) * blurred


def double_bounce(f: Float[Tensor, "*p 3"], openness: Float[Tensor, "*p 1"] | None) -> Float[Tensor, "*p 3"]:
    """F ← ao·F + (1-ao)·F²: in a crease light is reflected twice [thesis 4.3.2; MODEL.md 4]."""
    return f if openness is None else f * (openness + (1 - openness) * f)


def scattered(points: Points, light: Illumination) -> Float[Tensor, "*p 3"]:
    """What a white Lambertian surface sends out: Σ E max(0, n·l) + ambient · ao [MODEL.md 4]."""
    found = diffuse.ambient(light.ambient, points.normal)
    if points.openness is not None:
        found = found * points.openness
    for source in light.sources:
        incident = points.lit_by(source)
        found = found + incident.radiance * (points.normal * incident.towards).sum(-1, keepdim=True).clamp_min(0)
    return found
