"""Environments with exploding suns, single texels, none at all, and numbers that are none."""

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

from fitter.hard_cases.claims import refused, that, within
from fitter.hard_cases.row import Numbers, Row
from renderer import gbuffer, irradiance, lamps, latlong, transport
from renderer.box_filter import box_filtered
from renderer.environment import Environment, read_environment
from renderer.gbuffer import GBuffer
from renderer.images import write_exr
from renderer.latlong import LatLong
from renderer.mesh import Sphere
from renderer.transport import LightTable

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
    return transport.microfacet_table(kept, light, ALPHAS, distribution="ggx", degree=4, samples=256, seed=seed)


def _finite(found: Tensor, numbers: Numbers) -> str | None:
    wrong = ~(found.isfinite() & (found >= 0))
    return f"has {int(wrong.sum())} numbers that are not finite or negative" if wrong.any() else None


def _every_light(sun: float) -> Callable[[Numbers], Tensor]:
    """Table, irradiance and density under one sun, in units of it."""

    def found(numbers: Numbers) -> Tensor:
        environment = Environment(suns(16, 32, sun))
        mirrored = table_of(environment, numbers).light[:, :, :, 0].flatten()
        normals = points().normal[:, 0]
        scattered = irradiance.diffuse_table(normals, environment)[:, 0].flatten()
        return torch.cat([mirrored, scattered, lamps.sampling_density(environment).flatten()]).double()

    return found


def _irradiance_off(sun: float) -> Callable[[Numbers], float]:
    """Relative error of the irradiance of bright and dim texels together, against a sum of all texels in float64.

    The sum's own midpoints are refined: each texel of the bilinear map by 15² more.
    """

    def off(numbers: Numbers) -> float:
        environment = Environment(suns(16, 32, sun))
        normals = torch.nn.functional.normalize(
            torch.tensor([[0.2, 0.9, 0.3], [0.9, 0.3, -0.1], [0.0, -1.0, 0.2]]), dim=1
        )
        found = irradiance.diffuse_table(normals.double(), environment)[:, 0, 0].double()
        expected = _irradiance_sum(environment.radiance[..., 0].double().numpy(), normals.double().numpy())
        return float((found / torch.from_numpy(expected) - 1).abs().max())

    return off


def _irradiance_sum(radiance: Float[np.ndarray, "h w"], normals: Float[np.ndarray, "p 3"]) -> Float[np.ndarray, " p"]:
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


def _drawn_light(numbers: Numbers) -> float:
    """Error of ∫ L dω by directions that the light draws, one bright texel over next to nothing: L/p is nearly even."""
    environment = Environment(suns(16, 32, 1e6, 1e-6))
    sampler = lamps.build(environment)
    generator = torch.Generator().manual_seed(3)
    u, u1, u2 = numbers.tensor(torch.rand(3, 1 << 15, generator=generator, dtype=torch.float64)).cpu().unbind()
    x, y, z, density = lamps.sample(sampler, (torch.arange(len(u)) + u.double()) / len(u), u1, u2)
    light = latlong.lookup(latlong.of(environment), x, y, z)[:, 0]
    shares = (light / density).double()
    exact = _irradiance_total(environment)
    sigma = float(shares.std()) / math.sqrt(len(shares)) / exact
    return abs(float(shares.mean()) / exact - 1) / sigma


def _irradiance_total(environment: Environment) -> float:
    """∫ L dω of the bilinear map, by the trapezoidal sum of a finer grid, float64."""
    v, u = (torch.arange(600).double() + 0.5) / 600, (torch.arange(1200).double() + 0.5) / 1200
    theta, phi = torch.meshgrid(math.pi * v, 2 * math.pi * u, indexing="ij")
    light = latlong.of(Environment(environment.radiance.double()))
    value = latlong.lookup(light, theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos())[..., 0]
    return float((value * theta.sin()).sum() * (math.pi / 600) * (2 * math.pi / 1200))


def _constant(numbers: Numbers) -> float:
    """White facets under light of 1 from everywhere: the most that comes back over 1, or how far the diffuse is off."""
    environment = Environment(torch.ones(8, 16, 3))
    mirrored = table_of(environment, numbers).mean(torch.float64)[:, :, 0]
    scattered = irradiance.diffuse_table(points().normal[:, 0], environment)[:, 0].double()
    return max(float(mirrored.max()) - 1, float((scattered - 1).abs().max()))


def _tiny_map(numbers: Numbers) -> Tensor:
    """Everything that is made of a map of 1 × 2 texels."""
    environment = Environment(torch.tensor([[[1.0, 0.5, 0.0], [0.0, 2.0, 1e9]]]))
    normals = points().normal[:, 0]
    parts = [
        table_of(environment, numbers).light[
            :, :, :, 0
        ],  # other polynomials than the first are negative here and there
        irradiance.diffuse_table(normals, environment)[:, 0],
        latlong.lookup(latlong.of(environment), *normals.unbind(-1)),
        irradiance.blocks(environment)[1],
    ]
    return torch.cat([part.double().flatten() for part in parts])


def _huge_map(numbers: Numbers) -> float:
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


def _box_filtered(numbers: Numbers) -> float:
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


def _scaled(numbers: Numbers) -> float:
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


def _map(height: int = 4, **texels: float) -> Float[np.ndarray, "h w 3"]:
    """Ones, with a few texels otherwise: r1c2=…"""
    made = np.ones((height, 2 * height, 3), np.float32)
    for place, value in texels.items():
        row, column = place[1:].split("c")
        made[int(row), int(column)] = value
    return made


def _half_floats(numbers: Numbers) -> float:
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


def _repaired(count: int, value: float) -> Any:
    """The claim that so many texels were replaced, and that the broken one now has a value."""

    def sentence(found: Environment, numbers: Numbers) -> str | None:
        radiance = found.radiance
        if found.repaired != count or not (radiance.isfinite() & (radiance >= 0)).all():
            return f"replaced {found.repaired} texels, expected {count} and none that is negative or not finite"
        got = float(radiance[1, 2, 0])
        return None if math.isclose(got, value, rel_tol=1e-6) else f"became {got:.9g}, expected {value:.9g}"

    return that("repaired and told", sentence)


def _rounding(numbers: Numbers) -> float:
    return 64 * numbers.eps


ROWS = (
    *(
        Row(
            f"sun-of-{sun:g}",
            f"one texel is {sun / DIM:g} times as bright as the rest",
            f"a sun of {sun:g} in a map of {DIM:g}: table, irradiance, density",
            _every_light(sun),
            (that("finite", _finite),),
            "finite; not negative",
        )
        for sun in (1e5, 1e9, 1e20)
    ),
    *(
        Row(
            f"irradiance-under-a-sun-of-{sun:g}",
            "a sum of bright and dim texels: where the sun is below the horizon the dim ones are all there is",
            f"a sun of {sun:g} in a map of {DIM:g}, three normals, one turned away",
            _irradiance_off(sun),
            (within(lambda numbers: 3e-3),),
            "midpoints of 960 × 1920 in float64; blocks and DIFFUSE's float32 are told to err by 1e-3, the sum by 1e-3",
        )
        for sun in (1.0, 1e5, 1e9)
    ),
    Row(
        "one-bright-texel",
        "directions of the lobe never meet it",
        "one texel of 1e6 over 1e-6",
        _drawn_light,
        (within(lambda numbers: 5.0),),
        "∫ L dω on a grid of 600 × 1200, float64; five standard errors",
    ),
    Row(
        "constant-light",
        "white facets and a white body return what they get, and no more",
        "1 from everywhere",
        _constant,
        (within(lambda numbers: 2e-3, "bounded"),),
        "energy; blocks of the map err by 1e-3",
    ),
    Row(
        "two-texels",
        "rows are one, columns two; the other texel is a sun of 1e9",
        "1 × 2 pixels",
        _tiny_map,
        (that("finite", _finite),),
        "finite; not negative",
    ),
    Row(
        "map-of-8192-by-4096",
        "a float32 angle has 2e-7 of a turn, which is 2e-3 of a texel",
        "lookups at texels' middles, also beside the poles",
        _huge_map,
        (within(lambda numbers: 8192 * 16 * numbers.eps + 1e-2 * (numbers.eps > 1e-10) + 8e-3),),
        "the texel itself; 16 roundings of a turn, grid_sample's own in float32 (the map's) for 2e-3 each",
    ),
    Row(
        "smaller-map",
        "a sun of 1e9 and the dim rest both keep their light",
        "64 × 128 to 16 × 32",
        _box_filtered,
        (within(lambda numbers: 1e-9),),
        "Σ L Δω, of each part",
    ),
    Row(
        "brighter-light",
        "scaling the light scales the table and nothing else",
        "2²⁰ times as bright",
        _scaled,
        (within(_rounding, "invariant"),),
        "the same table, scaled",
    ),
    Row(
        "half-floats",
        "65504 and 2⁻²⁴ in a file of float16",
        "EXR of half floats",
        _half_floats,
        (within(lambda numbers: 0.0),),
        "the numbers written",
    ),
    Row(
        "black-light",
        "no light at all: nothing can be drawn in proportion to it",
        "a map of zeros",
        read(np.zeros((4, 8, 3))),
        (refused("every texel is black"),),
        "a refusal",
    ),
    Row(
        "light-that-is-nan",
        "not one number",
        "a map of NaN",
        read(np.full((4, 8, 3), np.nan)),
        (refused("every texel is black"),),
        "a refusal",
    ),
    Row(
        "negative-texel",
        "rings of a filter leave negative light",
        "a texel of -3",
        read(_map(r1c2=-3.0)),
        (_repaired(1, 0.0),),
        "0, counted",
    ),
    Row(
        "nan-texel",
        "one NaN would be everywhere",
        "a texel of NaN",
        read(_map(r1c2=math.nan)),
        (_repaired(1, 1.0),),
        "the mean of its neighbours, counted",
    ),
    Row(
        "infinite-texel",
        "a sun beyond the format's largest number",
        "a texel of ∞",
        read(_map(r1c2=math.inf)),
        (_repaired(1, 1.0),),
        "the mean of its neighbours, counted",
    ),
    Row(
        "nan-among-suns",
        "the sum of eight bright neighbours overflows, their mean does not",
        "a texel of NaN among texels of 3e38",
        read(np.where(_map(r1c2=math.nan) == 1, 3e38, np.nan)),
        (_repaired(1, 3e38),),
        "the mean of its neighbours, counted",
    ),
    Row(
        "not-a-map",
        "a map that is not twice as wide as high",
        "3 × 4 pixels",
        read(np.ones((3, 4, 3))),
        (refused("twice as wide as high"),),
        "a refusal",
    ),
)
