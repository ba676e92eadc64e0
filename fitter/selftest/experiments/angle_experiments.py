"""What is done at angles where directions, lookups and frames have no slope or no tangent."""

from __future__ import annotations

import itertools
import math

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.forward.direct_light import DirectLight
from fit_material.fitter.selftest.experiments.row import Numbers
from fit_material.renderer.environment import cubemap, latlong
from fit_material.renderer.environment.cubemap import Cubemap
from fit_material.renderer.environment.environment import Environment, directions
from fit_material.renderer.geometry.mesh import Sphere
from fit_material.renderer.light_sampling import direction_sampling
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.shaders import shade
from fit_material.shaders.lights import DirectionalLight
from fit_material.shaders.materials.types import Glossy, Matte, Metal
from fit_material.shaders.materials.widths import Blur
from fit_material.shaders.optics import blur, diffuse
from fit_material.shaders.shade import EnvironmentLight, Points

TINY = (0.0, 1e-30, 1e-13, 1e-9, 1e-4)


def random(numbers: Numbers, *shape: int) -> Tensor:
    return numbers.tensor(torch.rand(*shape, generator=torch.Generator().manual_seed(7), dtype=torch.float64))


def unit(*parts: Tensor) -> Float[Tensor, "p 3"]:
    return torch.nn.functional.normalize(torch.stack(parts, -1), dim=-1)


def looked_up_at_the_pole(x: Tensor, z: Tensor, up: float) -> Tensor:
    """A map of 8 × 16 texels beside +Y or -Y."""
    texels = torch.rand(8, 16, 3, generator=torch.Generator().manual_seed(7), dtype=torch.float64).to(x)
    towards = unit(x, torch.full_like(x, up), z)
    return latlong.lookup(latlong.of(Environment(texels)), *towards.unbind(-1))[:, 0]


def polar_angle(x: Tensor) -> Tensor:
    """Of a direction that leans by x from +Y."""
    return latlong.polar_angle(torch.sin(x), torch.cos(x), 0 * x)


def seam(numbers: Numbers) -> float:
    """Jump of the map where its last column meets its first, over 1e-6 rad."""
    texels = random(numbers, 8, 16, 3)
    light = latlong.of(Environment(texels))
    angle, worst = numbers.tensor(1e-6), 0.0
    for y in (-0.9, 0.0, 0.6):
        level, radius = numbers.tensor(y), math.sqrt(1 - y * y)
        either = [
            latlong.lookup(light, side * radius * torch.sin(angle), level, -radius * torch.cos(angle))
            for side in (-1, 1)
        ]
        worst = max(worst, float((either[0] - either[1]).abs().max()))
    return worst


def rotated(numbers: Numbers) -> float:
    """A map rotated by 37° against directions rotated back by as much."""
    texels = random(numbers, 8, 16, 3)
    towards = directions(9, 11)[1:-1].reshape(-1, 3).to(numbers.device, numbers.dtype)  # the pole has no azimuth
    x, y, z = towards.unbind(-1)
    cos, sin = math.cos(math.radians(37)), math.sin(math.radians(37))
    turned = latlong.lookup(latlong.of(Environment(texels, 37.0)), x * cos + z * sin, y, z * cos - x * sin)
    return float((turned - latlong.lookup(latlong.of(Environment(texels)), x, y, z)).abs().max())


def cube_edges(numbers: Numbers) -> float:
    """Jump of the value over 1e-6 rad across the middle of each of the twelve edges, and near each corner."""
    cube = Cubemap(random(numbers, 6, 4, 4, 3))
    worst = 0.0
    for axes in itertools.permutations(range(3)):
        for signs in itertools.product((-1.0, 1.0), repeat=3):
            for along in (0.1, 0.7, 0.999999, 1.0):
                point = [0.0, 0.0, 0.0]
                point[axes[0]], point[axes[1]], point[axes[2]] = signs[0], signs[1], signs[2] * along
                either = []
                for side in (-1e-6, 1e-6):
                    beside = list(point)
                    beside[axes[0]] *= 1 + side
                    either.append(cubemap.lookup(cube, numbers.tensor(beside)))
                worst = max(worst, float((either[0] - either[1]).abs().max()))
    return worst


def cube_slopes(numbers: Numbers) -> float:
    """How much the slope of smooth light changes across an edge, over its size, less that of OpenGL's filter.

    OpenGL's seamless filter takes the texel of the same index across an edge, which lies nearer to the edge's middle:
    at t along the edge the slope breaks by √2 t ∂L/∂t, however small texels are.
    """
    size, along = 64, 0.3
    weights, towards = numbers.tensor([0.3, 0.5, -0.4]), cubemap.face_directions(size)
    light = 1 + towards.to(numbers.device, numbers.dtype) @ weights
    cube, slopes = Cubemap(light[..., None]), []
    for side in (1 - 1e-4, 1 + 1e-4):
        at = numbers.tensor([[side, 1.0, along]]).requires_grad_()
        slopes.append(torch.autograd.grad(cubemap.lookup(cube, at).sum(), at)[0])
    corner = numbers.tensor([1.0, 1.0, along])
    length, edge = corner.norm(), numbers.tensor([0.0, 0.0, 1.0])
    by_t = weights @ (edge / length - corner * along / length**3)
    told = math.sqrt(2) * along * abs(float(by_t))
    return (float((slopes[0] - slopes[1]).norm()) - told) / float(slopes[0].norm())


def turned_away(cos: Tensor, n: Tensor) -> Tensor:
    """A metal's radiance where the shading normal leans away from the viewer by -cos."""
    view = unit(1 - 0 * cos, 0 * cos, cos)
    normal = torch.zeros_like(view)
    normal[:, 2] = 1
    metal = Metal(n[:, None], n[:, None] + 2, Blur(n.new_tensor(0.3)))
    return shade.shade(metal, Points(normal, view), even_light(n))[:, 0]


def even_light(like: Tensor) -> EnvironmentLight:
    """Radiance that is linear in the direction, with a lamp."""
    lamp = DirectionalLight(like.new_tensor([0.0, 0.6, 0.8]), like.new_tensor([1.0, 1.0, 1.0]))
    weights = like.new_tensor([[0.3], [0.5], [-0.4]])
    ambient = diffuse.constant_ambient(like.new_tensor([1.0, 1.0, 1.0]))
    return EnvironmentLight(lambda towards: (2 + towards @ weights).expand(*towards.shape), ambient, sources=(lamp,))


def every_material_at_the_poles(numbers: Numbers) -> str | None:
    """All materials, seen so that they mirror ±Y exactly: radiance and slopes by geometry and material."""
    for up, rho in itertools.product((-1.0, 1.0), (0.0, 1e-6, 0.5)):
        normal = numbers.tensor([[0.0, up, 0.0]]).requires_grad_()
        half = numbers.tensor(0.5).expand(3).clone().requires_grad_()
        roughness = numbers.tensor(rho).requires_grad_()
        width = Blur(roughness)
        light = even_light(half)
        for material in (Metal(half, half, width), Glossy(half, half, width), Matte(half, half)):
            radiance = shade.shade(material, Points(normal, normal.detach()), light)
            unknowns = (normal, half, roughness) if material.mirrors else (normal, half)
            slopes = torch.autograd.grad(radiance.sum(), unknowns, retain_graph=True)
            if not all(each.isfinite().all() for each in (radiance, *slopes)):
                return f"{material.type} under {up:+g}: {radiance.tolist()}, slopes {[s.tolist() for s in slopes]}"
    return None


def axes_beside_the_pole(numbers: Numbers) -> float:
    """How far the blur's axes are from a frame with a horizontal side."""
    worst = 0.0
    for lean, up in itertools.product(TINY, (-1.0, 1.0)):
        r = unit(numbers.tensor([lean]), numbers.tensor([up]), numbers.tensor([-lean]))
        k_h, k_v = blur.tap_axes(r)
        frame = torch.cat([k_h, k_v, r])
        worst = max(worst, float((frame @ frame.T - torch.eye(3).to(frame)).abs().max()), float(k_h[:, 1].abs().max()))
    return worst


def frames(numbers: Numbers) -> float:
    """How far local frames of straight views are from orthonormal."""
    trace = gbuffer.tracer(Sphere())
    worst = 0.0
    for lean in TINY:
        origin = torch.nn.functional.normalize(torch.tensor([[lean, 1.0, -lean], [0.3, 0.5, 0.1]], dtype=torch.float64))
        surface = trace(4 * origin, -origin)
        rays = surface.reshape(2, 1)
        frame = direction_sampling.frames(rays, torch.tensor([0]), numbers.dtype)  # type: ignore[arg-type]
        axes = torch.stack([torch.stack([part[:, 0] for part in axis], -1) for axis in frame.axes], 1)
        off = axes @ axes.transpose(1, 2) - torch.eye(3).to(axes)
        worst = max(worst, float(off.abs().max()))
    return worst


def lamp_behind(numbers: Numbers) -> str | None:
    """A lamp exactly opposite to the view, whose half vector is 0/0, and one exactly at the horizon."""
    axis = torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64)
    trace = gbuffer.tracer(Sphere())
    surface: GBuffer = trace(4 * axis, -axis).reshape(1, 1)
    for towards in ([0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]):
        lamp = DirectionalLight(torch.tensor(towards), torch.ones(3))
        alpha = torch.tensor(0.1, dtype=torch.float64, requires_grad=True)
        for distribution in ("ggx", "beckmann"):
            found = DirectLight.of(surface, lamp).reflected(torch.ones_like, alpha, distribution)
            slope = torch.autograd.grad(found.sum(), alpha)[0]
            if not (found.isfinite().all() and slope.isfinite() and (found >= 0).all()):
                return f"{distribution} towards {towards}: {found.tolist()}, slope {slope.item()}"
    return None
