"""Mitsuba as a forward model: radiance of chosen rays off a metal, with its derivatives, interreflection included."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.geometry.mesh import Shape
from fit_material.renderer.materials.bsdf import Bsdf
from fit_material.renderer.mitsuba.conversion import emitters, envmap, mitsuba, mitsuba_shapes
from fit_material.renderer.path_tracing.light_paths import ChangingMetal, LightPaths
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.shaders.lights import Light
from fit_material.shaders.materials.types import Metal
from fit_material.shaders.materials.widths import alpha_of

Progress = Callable[[float], None]

VARIANT = "llvm_ad_rgb"
MAX_DEPTH = 8  # segments; 2 is light → object → camera
SAMPLES_PER_PASS = 2**20  # bounds memory, and the wait for Ctrl-C
OFF_SURFACE = 1e-4  # of the object's extent: where rays begin before the surface that they are known to meet first


def unheard(share: float) -> None:
    """Progress that is not reported."""


@dataclass(frozen=True)
class Radiance:
    """Radiance of pixels, float64 [p, 3].

    Attributes:
        value: the radiance.
        by_n, by_k: derivative of each channel by its own n and k.
        by_alpha: derivative by alpha.
    """

    value: Float[Tensor, "p 3"]
    by_n: Float[Tensor, "p 3"]
    by_k: Float[Tensor, "p 3"]
    by_alpha: Float[Tensor, "p 3"]


class DifferentiableScene:
    """An object in its light, one of whose materials is a metal that may change."""

    def __init__(
        self,
        shape: Shape,
        environment: Environment,
        lights: Sequence[Light],
        bsdfs: Sequence[Bsdf],
        metal: int = 0,
        max_depth: int = MAX_DEPTH,
    ) -> None:
        """Load the scene into Mitsuba.

        Args:
            shape, environment, lights: what stands in which light.
            bsdfs: the materials, as `mitsuba.conversion` makes them, one for each of the mesh's `material_names`.
            metal: the index of the one that may change; a `roughconductor`.
            max_depth: segments of the longest path; 2 is light → object → camera.

        Raises:
            InputError: where LLVM is missing; names the package that has it.
        """
        import drjit as dr

        self._mi = mi = require_variant()
        shapes, surroundings = mitsuba_shapes(shape, bsdfs), {"environment": envmap(environment), **emitters(lights)}
        self._scene = mi.load_dict({"type": "scene", **surroundings, **shapes})
        self._bsdf = list(shapes.values())[metal].bsdf()
        self._held = mi.traverse(self._bsdf)
        ggx = bsdfs[metal]["distribution"] == "ggx"
        self._distribution = mi.MicrofacetType.GGX if ggx else mi.MicrofacetType.Beckmann
        self._max_depth = max_depth
        self._offset = OFF_SURFACE * float(dr.max(self._scene.bbox().extents()))

    def radiance(
        self,
        surface: GBuffer,
        metal: Metal,
        *,
        samples: int,
        seed: int,
        beyond_direct: bool = False,
        drawn: Metal | None = None,
        progress: Progress = unheard,
    ) -> Radiance:
        """Radiance that pixels send back along their rays.

        Args:
            surface: [p, k] rays inside each of p pixels, all of which meet the object.
            metal: what the changing material is made of; its roughness is alpha.
            samples: paths of each pixel, which its rays share evenly.
            seed: of the paths; the same seed gives the same numbers.
            beyond_direct: leave out what each pixel would mirror of the emitters if nothing hid them, which a light
                table has exactly; the paths' noise is then that of the rest.
            drawn: the metal for which the paths are drawn, if not for this one. With the same seed and the same `drawn`
                metals near it meet the same paths: the radiance is a smooth function of the metal, whose derivatives
                are exact.
            progress: called with the fraction done, in (0, 1].
        """
        import drjit

        paths = LightPaths(
            require_variant(), self._scene, self._max_depth, self._change(metal, drawn or metal), beyond_direct
        )
        pixels, step = len(surface.hit), max(1, SAMPLES_PER_PASS // samples)
        starts = range(0, pixels, step)
        streams = np.random.SeedSequence(seed).generate_state(len(starts)).tolist()
        origin = surface.position + self._offset * surface.view
        found = []
        for start, stream in zip(starts, streams, strict=True):
            rays = (each[start : start + step].float() for each in (origin, -surface.view))
            found.append(drjit.wrap("torch", "drjit")(partial(_means, paths, samples, stream))(*rays))
            progress(min(1.0, (start + step) / pixels))
        return Radiance(*(torch.cat(each).double() for each in zip(*found, strict=True)))

    def _change(self, metal: Metal, drawn: Metal) -> ChangingMetal:
        """Have the scene draw paths for one metal, to count them for another."""
        numbers, its = self._numbers(metal), self._numbers(drawn)
        self._held.update(dict(zip(("eta.value", "k.value", "alpha.value"), its, strict=True)))
        return ChangingMetal(self._mi, self._bsdf, self._distribution, *numbers, its)

    def _numbers(self, metal: Metal) -> tuple[Any, Any, Any]:
        """n, k and alpha in Mitsuba's types."""
        import drjit

        mi = self._mi
        n, k, alpha = mi.Color3f(metal.n.tolist()), mi.Color3f(metal.k.tolist()), mi.Float(float(alpha_of(metal.width)))
        drjit.make_opaque(n, k, alpha)  # constants would be compiled into the kernels, which each metal would need anew
        return n, k, alpha


def require_variant() -> Any:
    """Mitsuba, its variant set to the one with derivatives.

    Raises:
        InputError: where LLVM is missing; names the package that has it.
    """
    try:
        return mitsuba(VARIANT)
    except InputError as error:
        expected = f"{error.expected.removesuffix(', or use scalar_rgb')}, to trace paths with derivatives"
        raise InputError("--polish", expected=expected) from error


def _means(paths: LightPaths, samples: int, seed: int, origin: Any, direction: Any) -> list[Any]:
    """Means over the paths of each pixel of radiance and derivatives, [p, 3]; origin and direction are [p, k, 3]."""
    import drjit as dr

    mi, (pixels, rays, _) = paths.mi, origin.shape
    path = dr.arange(mi.UInt32, pixels * samples)
    index = (path // samples) * rays + path % rays
    start, towards = (dr.gather(mi.Vector3f, dr.detach(each.array), index) for each in (origin, direction))
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(dr.opaque(mi.UInt32, seed), pixels * samples)
    found = paths.trace(mi.Ray3f(mi.Point3f(start), towards), sampler)
    dr.eval(found)
    sums = [[dr.block_sum(each[c], samples) / samples for c in range(3)] for each in found]
    return [mi.TensorXf(dr.ravel(mi.Color3f(*each)), (pixels, 3)) for each in sums]
