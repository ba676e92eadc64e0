"""Diffuse light on an object that hides light from itself and sends itself some: by rays from some thousand places.

All light is expressed as the radiance that a white Lambertian body sends out of it: irradiance over π.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy import sparse
from torch import Tensor

from fit_material.fitter.forward.direct_light import DirectLight
from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.forward.received_light import Albedo, DiffuseLight, Met
from fit_material.fitter.forward.surface_samples import Places, Sparse
from fit_material.renderer.light_tables.irradiance_table import diffuse_table
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer, Tracer
from fit_material.renderer.rays.occlusion import OFF, Occluder
from fit_material.renderer.rays.self_visibility import cosine_directions

PLACES = 40000  # of a surface that fills 200² texels about every one
FURTHER = 10000  # places on what those receive light from, which no photograph need show
BLOCKS = 768  # of the environment, that rays are cast towards: shadows need many places before many directions
FEW, DIRECTIONS = 16, 256  # in which a place looks for what it receives light from, and for how much that is
AT_ONCE = 1 << 11  # places
LEAST, BOUNCES = 1e-4, 64  # share of the light that the last bounce may add; on most objects each adds a tenth
DARK = 1e-20  # radiance that counts as none


"""Share of the light that points send back, in all directions together, in [0, 1]."""


@dataclass(frozen=True)
class Transfer:
    """How light comes from places [n] of an object by way of the surfaces that rays from points [p] meet, [m].

    Attributes:
        met: what the rays meet.
        gathering: weighted mean over each point's rays, [p, m]; where they meet nothing it is dark.
        spreading: from the places to the surfaces that are met, [m, n].
    """

    met: Met
    gathering: Sparse
    spreading: Sparse

    def arriving(self, light: DiffuseLight) -> Float[np.ndarray, "p 3"]:
        """Mean radiance that rays from points [p] meet on the object, which counts as diffuse."""
        return self.gathering @ (light.albedo(self.met) * (self.spreading @ light.total))

    @staticmethod
    def of(
        surface: GBuffer, towards: Float[Tensor, "p s 3"], weight: Float[Tensor, "p s"], looking: Looking
    ) -> Transfer:
        """Of weighted rays from points [p]."""
        above, met = _met(looking.trace, looking.occluder, surface, towards)
        first = np.concatenate([[0], above.sum(1).cumsum(0).numpy()])
        values, column = weight[above].numpy() / towards.shape[1], np.arange(len(met.hit))
        gathering = sparse.csr_matrix((values, column, first), shape=(len(above), len(met.hit)))
        return Transfer(Met(met.material, met.uv.float()), gathering, looking.places.mixing(met))

    @staticmethod
    def joined(parts: Sequence[Transfer]) -> Transfer:
        """Of points in turn."""
        met = Met(*(torch.cat([getattr(each.met, key) for each in parts]) for key in ("material", "uv")))
        gathering = sparse.block_diag([each.gathering for each in parts], "csr")
        return Transfer(met, gathering, sparse.vstack([each.spreading for each in parts], "csr"))


@dataclass(frozen=True)
class Looking:
    """What it takes to look for an object from its own surface.

    Attributes:
        trace: of the object.
        occluder: the same object, for where rays start.
        places: that stand for it.
    """

    trace: Tracer
    occluder: Occluder
    places: Places


@dataclass(frozen=True)
class Radiosity:
    """How an object's places light each other.

    Attributes:
        places: where light is known.
        unoccluded: of the far surroundings, if nothing hid them, [n, 3].
        surroundings: what arrives of that, [n, 3].
        sources: what arrives of lights beside the environment, [n, 3].
        transfer: between the places; None where they are taken not to light each other.
    """

    places: Places
    unoccluded: Float[np.ndarray, "n 3"]
    surroundings: Float[np.ndarray, "n 3"]
    sources: Float[np.ndarray, "n 3"]
    transfer: Transfer | None

    def light(self, albedo: Albedo | None = None) -> DiffuseLight:
        """The light with all bounces, E = E₀ + G ρ S E: the radiosity equation B = ρ (E₀ + F B) [Goral et al. 1984]
        divided by the albedo ρ, its form factors F gathered by rays, G, that meet what places stand for, S.

        Surfaces count as diffuse: what they mirror, as if they scattered it. Without an albedo nothing is returned.
        """
        direct = self.surroundings + self.sources
        total = direct
        if self.transfer is not None and albedo is not None:
            sent, transfer = albedo(self.transfer.met), self.transfer
            for _ in range(BOUNCES):
                before, total = total, direct + transfer.gathering @ (sent * (transfer.spreading @ total))
                if np.abs(total - before).max() <= LEAST * total.max():
                    break
        share = self.surroundings / np.maximum(self.unoccluded, DARK)
        return DiffuseLight(self.places, share, total - direct, total, albedo or _black)


def _black(met: Met) -> Float[np.ndarray, "m 3"]:
    return np.zeros((len(met.material), 3))


def radiosity(lighting: Lighting, seen: GBuffer, trace: Tracer, returning: bool, seed: int = 0) -> Radiosity:
    """The diffuse light on an object, of a setting that has an occluder.

    Args:
        lighting: the light.
        seen: points [p] of the surface, at least one, of which `PLACES` are taken.
        trace: of the object.
        returning: whether the object sends light to itself.
        seed: of the choice of places and directions.
    """
    occluder = lighting.occluder
    assert occluder is not None
    generator = torch.Generator().manual_seed(seed)
    surface, extent = _chosen(seen, PLACES, generator), occluder.offset / OFF
    if returning:
        met = [_met(trace, occluder, *each)[1] for each in _all_around(surface, FEW, generator)]
        surface = gbuffer.concatenate([surface, _chosen(gbuffer.concatenate(met), FURTHER, generator)])
    places, transfer = Places(surface, extent), None
    if returning:
        looking, even = Looking(trace, occluder, places), torch.ones(1, 1, dtype=torch.float64)
        parts = [
            Transfer.of(some, towards, even.expand(towards.shape[:2]), looking)
            for some, towards in _all_around(surface, DIRECTIONS, generator)
        ]
        transfer = Transfer.joined(parts)
    before = (occluder, occluder.origins(surface))
    unoccluded, arriving = (
        diffuse_table(surface.normal, lighting.near, 1, hides, BLOCKS)[:, 0].double() for hides in (None, before)
    )
    shadows = occluder if "self-visibility" in lighting.effects else None
    lights = [DirectLight.of(surface[:, None], source, shadows) for source in lighting.sources]
    sources = sum((each.received() for each in lights), torch.zeros_like(arriving))
    surroundings = torch.minimum(arriving, unoccluded)
    return Radiosity(places, unoccluded.numpy(), surroundings.numpy(), sources.numpy(), transfer)


def _chosen(surface: GBuffer, most: int, generator: torch.Generator) -> GBuffer:
    return surface[torch.randperm(len(surface.hit), generator=generator)[:most]]


def _all_around(
    surface: GBuffer, count: int, generator: torch.Generator
) -> Iterator[tuple[GBuffer, Float[Tensor, "p s 3"]]]:
    """Places, some at a time, and from each so many directions, distributed as the cosine.

    They are Sobol points, shifted by chance from place to place [Cranley & Patterson 1976], so that neighbours err
    independently.
    """
    for part in torch.arange(len(surface.hit)).split(AT_ONCE):
        some = surface[part]
        yield some, cosine_directions(some, *shifted_points(len(part), count, generator))


def shifted_points(points: int, count: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """For each point so many pairs of numbers in [0, 1), two of [points, count], float64."""
    sobol = torch.quasirandom.SobolEngine(2, scramble=True, seed=0).draw(count).double()
    shift = torch.rand(points, 1, 2, generator=generator, dtype=torch.float64)
    first, second = ((sobol + shift) % 1).unbind(-1)
    return first, second


def _met(
    trace: Tracer, occluder: Occluder, surface: GBuffer, towards: Float[Tensor, "p s 3"]
) -> tuple[Bool[Tensor, "p s"], GBuffer]:
    """Which rays from points [p] meet the object's front, and where, [m], in their order."""
    origins = occluder.origins(surface)[:, None].expand_as(towards)
    above = (towards * surface.geometric_normal[:, None]).sum(-1) > 0
    met = trace(origins[above], towards[above])
    above[above.clone()] = met.front
    return above, met[met.front]
