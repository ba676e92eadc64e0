"""Diffuse light on an object that hides light from itself and sends itself some: by rays from some thousand places."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from scipy import sparse
from torch import Tensor

from fitter.pixel_model import DirectLight
from fitter.places import LightShare, Places, Sparse
from fitter.setting import Setting
from renderer import gbuffer
from renderer.gbuffer import GBuffer, Tracer
from renderer.irradiance import diffuse_table
from renderer.occlusion import Occluder
from renderer.visibility import cosine_directions

PLACES = 40000  # of a surface that fills 200² texels about every one
FURTHER = 10000  # places on what those receive light from, which no photograph need show
BLOCKS = 768  # of the environment, that rays are cast towards: shadows need many places before many directions
FEW, DIRECTIONS = 16, 256  # in which a place looks for what it receives light from, and for how much that is
AT_ONCE = 1 << 11  # places
LEAST, BOUNCES = 1e-4, 64  # of the light, which the last bounce may add; 64 leave that inside of nine tenths of a ball
DARK = 1e-20  # radiance that counts as none

Albedo = Callable[[GBuffer], Float[np.ndarray, "m 3"]]
"""Share of the light that points [m] send back, in all directions together, in [0, 1]."""


@dataclass(frozen=True)
class Returned:
    """From where the object sends light to its places.

    Attributes:
        met: what rays from the places meet, [m].
        gathering: mean over the rays of each place of what they meet, [n, m]; rows sum to the share of rays that do.
        spreading: what is known at the places to what is met, [m, n].
    """

    met: GBuffer
    gathering: Sparse
    spreading: Sparse


@dataclass(frozen=True)
class Reflected:
    """Diffuse light on an object whose parts light each other.

    Attributes:
        share: of the far surroundings' light.
        light: all of it at the places, directional lights' included, as the radiance of a white body, [n, 3].
        albedo: of the object.
    """

    share: LightShare
    light: Float[np.ndarray, "n 3"]
    albedo: Albedo

    def arriving(self, returned: Returned) -> Float[np.ndarray, "p 3"]:
        """Mean radiance of what is met, weighted as it is gathered; it counts as diffuse."""
        return returned.gathering @ (self.albedo(returned.met) * (returned.spreading @ self.light))


@dataclass(frozen=True)
class ReceivedLight:
    """Diffuse light at places of an object, as the radiance of a white body there.

    Attributes:
        places: where it is known.
        unhidden: of the far surroundings, if nothing hid them, [n, 3].
        far: of what is left of them, [n, 3].
        lamps: of the directional lights, [n, 3].
        returned: None where the object is taken to send itself none.
    """

    places: Places
    unhidden: Float[np.ndarray, "n 3"]
    far: Float[np.ndarray, "n 3"]
    lamps: Float[np.ndarray, "n 3"]
    returned: Returned | None

    @property
    def unreflected(self) -> LightShare:
        """The far surroundings' light that comes straight."""
        return LightShare(self.places, self.far / self.unhidden)

    def reflected_by(self, albedo: Albedo) -> Reflected:
        """That, and all light that comes by way of the object, B = E₀ + G ρ S B [Goral et al. 1984, eq. 5].

        G gathers, S spreads. Surfaces count as diffuse: what they mirror, as if they scattered it.
        """
        direct = self.far + self.lamps
        found = Reflected(self.unreflected, direct, albedo)
        for _ in range(BOUNCES if self.returned is not None else 0):
            assert self.returned is not None
            before, light = found.light, direct + found.arriving(self.returned)
            found = replace(found, share=LightShare(self.places, (light - self.lamps) / self.unhidden), light=light)
            if np.abs(light - before).max() <= LEAST * light.max():
                break
        return found


def received_light(setting: Setting, seen: GBuffer, trace: Tracer, returning: bool, seed: int = 0) -> ReceivedLight:
    """The diffuse light on an object, of a setting that has an occluder.

    Args:
        setting: the light.
        seen: points [p] of the surface, of which `PLACES` are taken.
        trace: of the object.
        returning: whether it sends light to itself.
        seed: of the choice of places and directions.
    """
    generator = torch.Generator().manual_seed(seed)
    surface, returned = _some(seen, PLACES, generator), None
    if returning:
        met, _ = _look_around(surface, setting, trace, FEW, generator)
        surface = gbuffer.concatenate([surface, _some(met, FURTHER, generator)])
    places = Places(surface)
    if returning:
        met, gathering = _look_around(surface, setting, trace, DIRECTIONS, generator)
        returned = Returned(met, gathering, places.mixing(met)) if len(met.hit) else None
    near = replace(setting.environment, radiance=setting.environment.radiance.cpu())
    occluder = setting.occluder
    assert occluder is not None
    before = (occluder, occluder.origins(surface))
    unhidden, far = (diffuse_table(surface.normal, near, 1, hides, BLOCKS)[:, 0].double() for hides in (None, before))
    lights = [DirectLight.of(surface, source, occluder) for source in setting.sources]
    lamps = sum((light.cos_l[:, None] * light.irradiance / torch.pi for light in lights), torch.zeros_like(far))
    unhidden = unhidden.clamp_min(DARK)
    far = torch.minimum(far, unhidden)
    return ReceivedLight(places, unhidden.numpy(), far.numpy(), lamps.numpy(), returned)


def _some(surface: GBuffer, most: int, generator: torch.Generator) -> GBuffer:
    return surface[torch.randperm(len(surface.hit), generator=generator)[:most]]


def _look_around(
    surface: GBuffer, setting: Setting, trace: Tracer, count: int, generator: torch.Generator
) -> tuple[GBuffer, Sparse]:
    """What rays from places [n], so many from each, meet of the object's front, and its mean over them, [n, m].

    The rays are distributed as the cosine, by Sobol points, shifted by chance from place to place [Cranley & Patterson
    1976], so that neighbours err independently.
    """
    occluder = setting.occluder
    assert occluder is not None
    points = torch.quasirandom.SobolEngine(2, scramble=True, seed=0).draw(count).double()
    found, gathering = [], []
    for part in torch.arange(len(surface.hit)).split(AT_ONCE):
        some = surface[part]
        shift = torch.rand(len(part), 1, 2, generator=generator, dtype=torch.float64)
        towards = cosine_directions(some, *((points + shift) % 1).unbind(-1))
        met, mean = looked(some, towards, occluder, trace)
        found.append(met)
        gathering.append(mean)
    return gbuffer.concatenate(found), sparse.block_diag(gathering, "csr")


def looked(
    surface: GBuffer,
    towards: Float[Tensor, "p s 3"],
    occluder: Occluder,
    trace: Tracer,
    weight: Float[Tensor, "p s"] | None = None,
) -> tuple[GBuffer, Sparse]:
    """What rays from points [p] meet of an object's front, [m], and its weighted mean over each's rays, [p, m]."""
    origins = occluder.origins(surface)[:, None].expand_as(towards)
    weight = torch.ones(towards.shape[:2], dtype=torch.float64) if weight is None else weight
    above = (towards * surface.geometric_normal[:, None]).sum(-1) > 0
    met = trace(origins[above], towards[above])
    above[above.clone()] = met.front
    met, first = met[met.front], np.concatenate([[0], above.sum(1).cumsum(0).numpy()])
    values, column = weight[above].numpy() / towards.shape[1], np.arange(len(met.hit))
    return met, sparse.csr_matrix((values, column, first), shape=(len(above), len(met.hit)))
