"""Diffuse light: what the whole environment sends to a surface, under any transmittance of the angle.

    ∫ L(l) T(n·l) max(0, n·l)/π dl = Σ_b t_b D_b(n),    T(c) = Σ_b t_b T_b(2√c - 1)

The Chebyshev polynomials T_b stand in √c because a rough interface's transmittance changes fastest at grazing angles.
The D_b are integrated once; another material only has other t_b.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fit_material.renderer.compute import chebyshev
from fit_material.renderer.compute.threads import map_in_threads
from fit_material.renderer.environment import latlong
from fit_material.renderer.environment.environment import Environment, directions
from fit_material.renderer.environment.latlong import texel_solid_angles
from fit_material.renderer.rays.occlusion import Occluder

DEGREE = 10  # leaves 1.5e-4 of the light that a rough interface lets in, 1e-3 where all of it comes from one lamp

_BLOCKS = 6144
_BLOCKS_ASKED = 3072  # where a ray is cast to each, which takes longer than all else
_COARSEST, _FINEST = 32, 512  # rows of blocks, in the dark and where a lamp is
_CHUNK = 64  # normals at a time: 1.5 MiB of cosines stay in the cache


def diffuse_table(
    normals: Float[Tensor, "p 3"],
    environment: Environment,
    degree: int = DEGREE,
    before: tuple[Occluder, Float[Tensor, "p 3"]] | None = None,
    most: int | None = None,
) -> Float[Tensor, "p b 3"]:
    """D_b(n) = ∫ L(l) T_b(2√(n·l) - 1) max(0, n·l)/π dl, a sum over blocks of the map, without noise.

    Each of some thousand blocks of the map, smallest where it is brightest, shines from its centre of light. The error
    is of second order in a block's extent: below 1e-3 of the irradiance, and 2e-4 in the root mean square.

    Args:
        normals: unit, in world space.
        environment: the light.
        degree: number of polynomials; 1 gives the irradiance over π alone.
        before: what hides light from each place, and where its rays start; None where nothing does. With it the sum
            is over fewer blocks.
        most: blocks, where it shall be other than that.

    Returns:
        D_b, radiance, float32, on the CPU; D_0 is what a white Lambertian surface sends out.
    """
    usual = _BLOCKS if before is None else _BLOCKS_ASKED
    towards, light = (value.float() for value in blocks(environment, most or usual))

    def integrate(start: int) -> Float[Tensor, "c b 3"]:
        part = slice(start, start + _CHUNK)
        cos = (normals[part].to(towards) @ towards.T).clamp_min_(0)
        if before is not None:
            occluder, origins = before
            place, block = cos.nonzero().T
            cos[place, block] *= occluder.free(origins[part][place], towards[block])
        return torch.stack([kernel @ light for kernel in _kernels(cos, degree)], 1)

    return torch.cat(list(map_in_threads(integrate, range(0, len(normals), _CHUNK)))) / math.pi


def even_table(degree: int = DEGREE) -> Float[Tensor, " b"]:
    """D_b of light of radiance 1 from all sides, 2 ∫ T_b(2√c - 1) c dc over cosines c in [0, 1], float64."""
    node, weight = (torch.from_numpy(each) for each in np.polynomial.legendre.leggauss(degree + 4))
    root = (node + 1) / 2  # √c, in which the integrand is a polynomial: c dc is 2 (√c)³ d√c
    return (cosine_basis(root**2, degree) * (2 * root**3 * weight)[:, None]).sum(0)


def cosine_basis(cos: Float[Tensor, "*p"], degree: int = DEGREE) -> Float[Tensor, "*p b"]:
    """T_b(2√c - 1): with the coefficients t_b this is T(c), for cosines in [0, 1]."""
    return chebyshev.polynomials(2 * cos.clamp(0, 1).sqrt() - 1, degree).movedim(0, -1)


def coefficients(
    transmittance: Callable[[Float[Tensor, "b 1"]], Float[Tensor, "b c"]], like: Tensor, degree: int = DEGREE
) -> Float[Tensor, "b c"]:
    """t_b with T(c) ≈ Σ_b t_b T_b(2√c - 1), in the dtype of `like`.

    Args:
        transmittance: T by cosine, for one channel or for three.
        like: a tensor of the dtype and device that are wanted.
    """
    cos = ((chebyshev.nodes(degree) + 1) / 2).square().to(like)
    return chebyshev.coefficients(transmittance(cos[:, None]))


def blocks(environment: Environment, most: int = _BLOCKS) -> tuple[Float[Tensor, "t 3"], Float[Tensor, "t 3"]]:
    """The environment as a few thousand lamps, `most` at most; the last ones are kept, for a plan uses them often.

    Returns:
        unit direction towards each block's centre of light, in world space, and its radiance times solid angle;
        float64, on the CPU. Black blocks are left out.
    """
    return _blocks(environment, environment.radiance._version, most)


@functools.lru_cache(maxsize=2)
def _blocks(environment: Environment, _version: int, most: int) -> tuple[Float[Tensor, "t 3"], Float[Tensor, "t 3"]]:
    """The lamps of an environment, cached by its tensor and the tensor's version."""
    levels = [_moments(_refined(environment))]
    while levels[-1].shape[-2] > (_COARSEST if most >= _BLOCKS_ASKED else _COARSEST // 4):
        levels.append(4 * torch.nn.functional.avg_pool2d(levels[-1], 2))
    leaves = zip(levels, _leaves(levels, most), strict=True)
    light, moment = torch.cat([level[:, leaf] for level, leaf in leaves], 1).split(3)
    lit = light.sum(0) > 0
    towards = torch.nn.functional.normalize(moment[:, lit].T, dim=1)
    return _turned(towards, environment.rotation), light[:, lit].T


def _moments(radiance: Float[Tensor, "h w 3"]) -> Float[Tensor, "6 n m"]:
    """Light, by channel, and light times direction, summed over the texels of each cell of the finest grid."""
    height, width = radiance.shape[:2]
    weighted = radiance * torch.from_numpy(texel_solid_angles(height, width))[..., None]
    moments = torch.cat([weighted, weighted.sum(-1, keepdim=True) * directions(height, width)], -1)
    row, column = torch.arange(height) * _FINEST // height, torch.arange(width) * 2 * _FINEST // width
    cells = (row[:, None] * 2 * _FINEST + column).flatten()
    return (
        moments.new_zeros(2 * _FINEST**2, 6).index_add_(0, cells, moments.flatten(0, 1)).T.unflatten(1, (_FINEST, -1))
    )


def _leaves(levels: list[Float[Tensor, "6 n m"]], most: int) -> list[Bool[Tensor, "n m"]]:
    """Which cells of each level, finest first, are not divided further: those with the least light times variance."""
    worth = [_variance(levels[-1])]  # of dividing a cell and, before it, all that it lies in
    for level in levels[-2:0:-1]:
        worth.insert(0, torch.minimum(_variance(level), _divided(worth[0])))
    divisions = (most - worth[-1].numel()) // 3
    threshold = torch.cat([level.flatten() for level in worth]).topk(divisions).values[-1]
    divided = [torch.zeros_like(levels[0][0], dtype=torch.bool), *(level >= threshold for level in worth)]
    exists = [*(_divided(above) for above in divided[1:]), torch.ones_like(divided[-1])]
    return [there & ~split for there, split in zip(exists, divided, strict=True)]


def _variance(moments: Float[Tensor, "6 n m"]) -> Float[Tensor, "n m"]:
    """Light times variance of its directions, f (1 - |m|²/f²): what a cell's error is in proportion to."""
    light = moments[:3].sum(0)
    return light - moments[3:].square().sum(0) / light.clamp_min(torch.finfo(light.dtype).tiny)


def _divided(cells: Tensor) -> Tensor:
    """Each cell's value for the four that it consists of."""
    return cells.repeat_interleave(2, 0).repeat_interleave(2, 1)


def _kernels(cos: Float[Tensor, "c t"], degree: int) -> Iterator[Float[Tensor, "c t"]]:
    """c T_b(2√c - 1), by the polynomials' recurrence, of which only two are held so that they stay in the cache."""
    twice = 4 * cos.sqrt() - 2
    kernel, following = cos, cos * twice / 2
    for _ in range(degree):
        yield kernel
        kernel, following = following, torch.addcmul(-kernel, twice, following)


def _refined(environment: Environment) -> Float[Tensor, "h w 3"]:
    """The same bilinear map by more texels, where it has few. An odd factor keeps the old texels among the new."""
    radiance = environment.radiance.cpu()
    height, width = radiance.shape[:2]
    factor = math.ceil(_FINEST / 2 / max(1, height - 1)) // 2 * 2 + 1
    if factor == 1:
        return radiance.double()
    x, y, z = directions(factor * max(1, height - 1) + 1, factor * width).float().unbind(-1)
    return latlong.lookup(latlong.of(Environment(radiance)), x, y, z).double()


def _turned(towards: Float[Tensor, "t 3"], rotation: float) -> Float[Tensor, "t 3"]:
    """From the map's own axes to the world's: by `rotation` degrees about +Y."""
    x, y, z = towards.unbind(1)
    sin, cos = math.sin(math.radians(rotation)), math.cos(math.radians(rotation))
    return torch.stack([cos * x + sin * z, y, cos * z - sin * x], 1)
