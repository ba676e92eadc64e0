"""How well n, k, F0 and alpha could be known from given photographs at best: the Cramér-Rao bound.

    C >= I⁻¹,   I = Σ_pixels Jᵀ Σ⁻¹ J        [Rao 1945; Kay 1993, eq. 3.31, for normal noise of known covariance]

J is the derivative of the exact picture by (n, k, alpha) at the truth, Σ the covariance of a pixel's channels. No
unbiased estimate from the same pixels has smaller errors, whatever its method.
"""

from __future__ import annotations

import io
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.forward.pixel_model import PixelModel
from fit_material.fitter.options.fidelity import preset
from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.environment.environment_file import read_environment
from fit_material.renderer.files.atomic import write_bytes_atomically
from fit_material.renderer.geometry.mesh import Sphere, read_mesh
from fit_material.renderer.materials.catalogue import metal
from fit_material.renderer.materials.ground_truth import TrueMetal
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer, Tracer
from fit_material.renderer.rays.self_visibility import sees_itself
from fit_material.renderer.synthesis.camera_placement import views
from fit_material.renderer.synthesis.synthesise import SynthOptions
from fit_material.shaders.materials.types import Metal
from fit_material.shaders.materials.widths import Microfacet
from tests.bench.noise import Noise, noise_of
from tests.bench.photographs import Case

TABLE_SAMPLES, FOOTPRINT = 1024, 4
SPAN, LEVELS = 1.05, 3  # of alpha around the truth, both ways: narrow, so that interpolation is exact


@dataclass(frozen=True)
class Bound:
    """Smallest standard errors of unbiased estimates: n, k, F0 per channel and alpha."""

    n: Float[np.ndarray, "3"]
    k: Float[np.ndarray, "3"]
    f0: Float[np.ndarray, "3"]
    alpha: Float[np.ndarray, ""]


def bounds_of(case: Case, variant: str) -> tuple[Bound, Bound]:
    """The bound with channels taken for independent, and with their covariance; found where it is not kept."""
    kept = case.measured(f"bound-{TABLE_SAMPLES}", variant)
    if not kept.exists():
        kept.parent.mkdir(parents=True, exist_ok=True)
        independent, joint = _informations(case, variant)
        file = io.BytesIO()
        np.savez(file, independent=independent, joint=joint)
        write_bytes_atomically(kept, file.getvalue())
    with np.load(kept) as found:
        return bound(found["independent"], case), bound(found["joint"], case)


def bound(information: Float[np.ndarray, "7 7"], case: Case) -> Bound:
    """Standard errors from the information about (n, k, alpha)."""
    covariance = np.linalg.inv(information)
    gradient = torch.func.jacfwd(lambda x: _metal(x).f0)(_truth(case)).numpy()
    errors = np.sqrt(np.diag(covariance))
    f0 = np.sqrt(np.einsum("ci,ij,cj->c", gradient, covariance, gradient))
    return Bound(errors[:3], errors[3:6], f0, errors[6])


def information(
    jacobian: Float[np.ndarray, "p 3 x"], covariance: Float[np.ndarray, "p 3 3"], freedom: Float[np.ndarray, " p"]
) -> Float[np.ndarray, "x x"]:
    """Σ Jᵀ Σ⁻¹ J from covariances that were themselves estimated.

    The inverse of a sample covariance of c channels with ν degrees of freedom is too large by ν/(ν - c - 1)
    [Kaufman 1967].
    """
    channels = covariance.shape[-1]
    weight = np.linalg.inv(covariance) * ((freedom - channels - 1) / freedom)[:, None, None]
    return np.einsum("pcx,pcd,pdy->xy", jacobian, weight, jacobian, optimize=True)


def _informations(case: Case, variant: str) -> tuple[np.ndarray, np.ndarray]:
    model, place = _exact(_geometry(case), case.alpha)
    covariance, freedom = _of_photographs(noise_of(case, variant), case, place.numpy())
    known = freedom > 0  # a footprint's rays may all meet what Mitsuba's miss somewhere
    jacobian = torch.func.jacfwd(lambda x: model.radiance(_metal(x)))(_truth(case)).numpy()[known]
    covariance, freedom = covariance[known], freedom[known]
    each = [information(jacobian[:, [c]], covariance[:, [c]][:, :, [c]], freedom) for c in range(3)]
    return sum(each, np.zeros((7, 7))), information(jacobian, covariance, freedom)


def _geometry(case: Case) -> SynthOptions:
    """What the photographs of all metals and noises have in common."""
    nobody = TrueMetal((1.0, 1.0, 1.0), (1.0, 1.0, 1.0), case.alpha)
    return replace(case.options(""), material=nobody, noise=0.0, spp=1)


def _of_photographs(
    noise: Noise, case: Case, place: Int[np.ndarray, "p 3"]
) -> tuple[Float[np.ndarray, "p 3 3"], Float[np.ndarray, " p"]]:
    """Covariance of the photographs' values at some pixels, and its degrees of freedom."""
    at = tuple(place.T)
    added = (case.noise * noise.mean[at]) ** 2
    return noise.covariance[at] / case.spp + added[:, :, None] * np.eye(3), noise.freedom[at]


def _truth(case: Case) -> Float[Tensor, "7"]:
    known = metal(case.metal)
    return torch.tensor([*known.n, *known.k, case.alpha], dtype=torch.float64)


def _metal(x: Float[Tensor, "7"]) -> Metal:
    return Metal(x[:3], x[3:6], Microfacet(x[6]))


@lru_cache(maxsize=1)
def _exact(geometry: SynthOptions, alpha: float) -> tuple[PixelModel, Int[Tensor, "p 3"]]:
    """The picture of every pixel that can be fitted, and each one's view, row and column; the same for all metals."""
    shape = Sphere() if geometry.mesh is None else read_mesh(geometry.mesh)
    trace = gbuffer.tracer(shape)
    cameras = [view.camera(geometry.size) for view in views(geometry.views, shape, geometry.fov)]
    seen = [_usable(camera, trace) for camera in cameras]
    surface = gbuffer.concatenate([each for each, _ in seen])
    place = [torch.nn.functional.pad(pixels, (1, 0), value=view) for view, (_, pixels) in enumerate(seen)]
    lighting = Lighting(read_environment(geometry.env), (), preset("standard"))
    table = lighting.table(surface, (alpha / SPAN, alpha * SPAN, LEVELS), TABLE_SAMPLES)
    return lighting.pixels(surface, body=False).under(table), torch.cat(place)


def _usable(camera: Camera, trace: Tracer) -> tuple[GBuffer, Int[Tensor, "p 2"]]:
    """Rays and places of the pixels that the object's front covers wholly and that do not mirror the object."""
    pixels = gbuffer.pixel_centres(trace, camera).front.nonzero()
    surface = gbuffer.pixel_footprints(trace, camera, pixels[:, 1], pixels[:, 0], FOOTPRINT)
    whole = surface.front.all(-1)
    surface, pixels = surface[whole], pixels[whole]
    centres = gbuffer.pixel_footprints(trace, camera, pixels[:, 1], pixels[:, 0], 1)[:, 0]
    alone = ~sees_itself(trace, centres)
    return surface[alone], pixels[alone]
