"""What is done with environments of suns, single texels, none, and numbers that are none."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.selftest.experiments.row import Claim, Numbers
from fit_material.renderer.environment import latlong
from fit_material.renderer.environment.downsampling import box_filtered
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.environment.environment_file import read_environment
from fit_material.renderer.environment.latlong import LatLong
from fit_material.renderer.geometry.mesh import Sphere
from fit_material.renderer.images.image_file import write_exr
from fit_material.renderer.light_sampling import environment_sampling
from fit_material.renderer.light_sampling.integrator import Integration, LobeGrid
from fit_material.renderer.light_tables import irradiance_table, light_table
from fit_material.renderer.light_tables.light_table import LightTable
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer

DIM = 1e-3
ALPHAS = (0.3, 0.301, 1)


def suns(height: int, width: int, sun: float, dim: float = DIM) -> Float[Tensor, "h w 3"]:
    """A dim map with one texel of a sun."""
    radiance = torch.full((height, width, 3), dim)
    radiance[height // 3, width // 4] = sun
    return radiance


def points() -> GBuffer:
    """Six points of the unit sphere, one ray each."""
    axis = torch.cat([torch.eye(3), -torch.eye(3)]).double()
    return gbuffer.tracer(Sphere())(4 * axis, -axis).reshape(6, 1)


def table_of(environment: Environment, numbers: Numbers, seed: int = 0, surface: GBuffer | None = None) -> LightTable:
    """Light through one lobe at six points."""
    light = Environment(environment.radiance.to(numbers.device, numbers.dtype), environment.rotation)
    kept = points() if surface is None else surface
    return light_table.microfacet_table(
        kept, light, LobeGrid(*ALPHAS, "ggx"), Integration(degree=4, samples=256, seed=seed)
    )


def not_finite(found: Tensor, numbers: Numbers) -> str | None:
    wrong = ~(found.isfinite() & (found >= 0))
    return f"has {int(wrong.sum())} numbers that are not finite or negative" if wrong.any() else None


def every_light(sun: float) -> Callable[[Numbers], Tensor]:
    """Table, irradiance and density under one sun, in units of it."""

    def found(numbers: Numbers) -> Tensor:
        environment = Environment(suns(16, 32, sun))
        mirrored = table_of(environment, numbers).light[:, :, :, 0].flatten()
        normals = points().normal[:, 0]
        scattered = irradiance_table.diffuse_table(normals, environment)[:, 0].flatten()
        return torch.cat([mirrored, scattered, environment_sampling.sampling_density(environment).flatten()]).double()

    return found


def irradiance_off(sun: float) -> Callable[[Numbers], float]:
    """Relative error of the irradiance of bright and dim texels together, against a sum of all texels in float64.

    The sum's own midpoints are refined: each texel of the bilinear map by 15² more.
    """

    def off(numbers: Numbers) -> float:
        environment = Environment(suns(16, 32, sun))
        normals = torch.nn.functional.normalize(
            torch.tensor([[0.2, 0.9, 0.3], [0.9, 0.3, -0.1], [0.0, -1.0, 0.2]]), dim=1
        )
        found = irradiance_table.diffuse_table(normals.double(), environment)[:, 0, 0].double()
        expected = irradiance_sum(environment.radiance[..., 0].double().numpy(), normals.double().numpy())
        return float((found / torch.from_numpy(expected) - 1).abs().max())

    return off


def irradiance_sum(radiance: Float[np.ndarray, "h w"], normals: Float[np.ndarray, "p 3"]) -> Float[np.ndarray, " p"]:
    """∫ L max(0, n·l)/π dl by midpoints on a grid of 960 × 1920, L bilinear: by numpy."""
    rows, columns = radiance.shape
    v, u = (np.arange(960) + 0.5) / 960, (np.arange(1920) + 0.5) / 1920
    row, column = v * (rows - 1), u * columns - 0.5
    top, left = np.floor(row).astype(int), np.floor(column).astype(int)
    down, right = (row - top)[:, None], (column - left)[None]
    at = [[radiance[(top + j).clip(0, rows - 1)][:, (left + i) % columns] for i in (0, 1)] for j in (0, 1)]
    light = (1 - down) * ((1 - right) * at[0][0] + right * at[0][1]) + down * (
        (1 - right) * at[1][0] + right * at[1][1]
    )
    theta, phi = math.pi * v[:, None], 2 * math.pi * u[None]
    towards = np.stack([np.sin(theta) * np.sin(phi), np.cos(theta) + 0 * phi, -np.sin(theta) * np.cos(phi)], -1)
    area = np.sin(theta) * (math.pi / 960) * (2 * math.pi / 1920)
    return np.array([(np.maximum(towards @ n, 0) * light * area).sum() / math.pi for n in normals])


def drawn_light(numbers: Numbers) -> float:
    """Error of ∫ L dω by directions that the light draws, one bright texel over next to nothing: L/p is nearly even."""
    environment = Environment(suns(16, 32, 1e6, 1e-6))
    sampler = environment_sampling.build(environment)
    generator = torch.Generator().manual_seed(3)
    u, u1, u2 = numbers.tensor(torch.rand(3, 1 << 15, generator=generator, dtype=torch.float64)).cpu().unbind()
    x, y, z, density = environment_sampling.sample(sampler, (torch.arange(len(u)) + u.double()) / len(u), u1, u2)
    light = latlong.lookup(latlong.of(environment), x, y, z)[:, 0]
    shares = (light / density).double()
    exact = irradiance_total(environment)
    sigma = float(shares.std()) / math.sqrt(len(shares)) / exact
    return abs(float(shares.mean()) / exact - 1) / sigma


def irradiance_total(environment: Environment) -> float:
    """∫ L dω of the bilinear map, by the trapezoidal sum of a finer grid, float64."""
    v, u = (torch.arange(600).double() + 0.5) / 600, (torch.arange(1200).double() + 0.5) / 1200
    theta, phi = torch.meshgrid(math.pi * v, 2 * math.pi * u, indexing="ij")
    light = latlong.of(Environment(environment.radiance.double()))
    value = latlong.lookup(light, theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos())[..., 0]
    return float((value * theta.sin()).sum() * (math.pi / 600) * (2 * math.pi / 1200))


def constant(numbers: Numbers) -> float:
    """White facets under light of 1 from everywhere: the most that comes back over 1, or how far the diffuse is off."""
    environment = Environment(torch.ones(8, 16, 3))
    mirrored = table_of(environment, numbers).mean(torch.float64)[:, :, 0]
    scattered = irradiance_table.diffuse_table(points().normal[:, 0], environment)[:, 0].double()
    return max(float(mirrored.max()) - 1, float((scattered - 1).abs().max()))


def tiny_map(numbers: Numbers) -> Tensor:
    """Everything that is made of a map of 1 × 2 texels."""
    environment = Environment(torch.tensor([[[1.0, 0.5, 0.0], [0.0, 2.0, 1e9]]]))
    normals = points().normal[:, 0]
    parts = [
        table_of(environment, numbers).light[
            :, :, :, 0
        ],  # other polynomials than the first are negative here and there
        irradiance_table.diffuse_table(normals, environment)[:, 0],
        latlong.lookup(latlong.of(environment), *normals.unbind(-1)),
        irradiance_table.blocks(environment)[1],
    ]
    return torch.cat([part.double().flatten() for part in parts])


def huge_map(numbers: Numbers) -> float:
    """Lookups at the texels' middles of a map of 8192 × 4096, in texels of error along a ramp."""
    width, height = 8192, 4096
    ramp = torch.arange(width, dtype=torch.float32).expand(1, 1, height, width)
    map_ = LatLong(latlong.with_border(ramp), 0.0)
    row, column = torch.tensor([0, 1, 17, 2048, 4094]).repeat_interleave(3), torch.tensor([1, 4095, 8190]).repeat(5)
    theta, phi = math.pi * row.double() / (height - 1), 2 * math.pi * (column.double() + 0.5) / width
    towards = (theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos())
    away = theta.sin() > 1e-6
    x, y, z = (part[away].to(numbers.dtype) for part in towards)
    return float((latlong.lookup(map_, x, y, z)[:, 0] - column[away]).abs().max())


def lost_by_filtering(numbers: Numbers) -> float:
    """Light that a smaller map loses of a sun of 1e9 and of the dim rest, relative to each."""
    radiance = suns(64, 128, 1e9).double()
    smaller = box_filtered(radiance, 32)
    worst = 0.0
    for part in (radiance, suns(64, 128, DIM).double()):
        less = box_filtered(part, 32)
        before, after = (
            float((each[..., 0] * latlong.row_solid_angle(*each.shape[:2])[:, None]).sum()) for each in (part, less)
        )
        worst = max(worst, abs(after / before - 1))
    return worst + abs(float(smaller.min() / radiance.min()) - 1)


def scaled(numbers: Numbers) -> float:
    """A table under light of 2²⁰ times as much, over that."""
    bright, dim = (table_of(Environment(suns(16, 32, 1e3) * factor), numbers).light for factor in (2.0**20, 1.0))
    return float((bright / 2.0**20 - dim).abs().max() / dim.abs().max())


def read(texels: Any) -> Callable[[Numbers], Environment]:
    """An experiment: a map of these texels, written as EXR and read."""

    def made(numbers: Numbers) -> Environment:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "map.exr"
            write_exr(path, np.asarray(texels, np.float32))
            return read_environment(path)

    return made


def map_with(height: int = 4, **texels: float) -> Float[np.ndarray, "h w 3"]:
    """Ones, with a few texels otherwise: r1c2=…"""
    made = np.ones((height, 2 * height, 3), np.float32)
    for place, value in texels.items():
        row, column = place[1:].split("c")
        made[int(row), int(column)] = value
    return made


def half_floats(numbers: Numbers) -> float:
    """The largest half float and the smallest, through a file of half floats."""
    import OpenEXR

    texels = np.ones((2, 4, 3), np.float16)
    texels[0, 1], texels[1, 2] = 65504, 2.0**-24
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "half.exr"
        OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, {"RGB": texels}).write(
            str(path)
        )
        return float((read_environment(path).radiance - torch.from_numpy(texels.astype(np.float32))).abs().max())


def repaired(count: int, value: float) -> Any:
    """The claim that so many texels were replaced, and that the broken one now has a value."""

    def sentence(found: Environment, numbers: Numbers) -> str | None:
        radiance = found.radiance
        if found.repaired != count or not (radiance.isfinite() & (radiance >= 0)).all():
            return f"replaced {found.repaired} texels, expected {count} and none that is negative or not finite"
        got = float(radiance[1, 2, 0])
        return None if math.isclose(got, value, rel_tol=1e-6) else f"became {got:.9g}, expected {value:.9g}"

    return Claim("repaired and reported", sentence)


def rounding(numbers: Numbers) -> float:
    return 64 * numbers.eps
