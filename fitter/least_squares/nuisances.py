"""Nuisance parameters: factors between radiance and a photograph's pixels, with their priors.

    pixel = exposure · white balance · radiance

Each unknown is the logarithm of a factor, but for the environment's rotation, which is in degrees. Before any pixel of
the object is looked at, it has a normal distribution, so that the factor's is log-normal: wide about 1, or about a
guess, or as narrow as the calibration by the background. It is fitted beside the material's own numbers, whose
errors thereby count that it is not known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal, NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.scene.fittable_values import FITTED, turn_of
from fit_material.renderer.scene.scene_file import Scene

EXPOSURE_WIDTH = 1.5  # standard deviation of a logarithm: with 95 % within a factor of 19 of the guess
WHITE_BALANCE_WIDTH = 0.3  # of red and blue against green: with 95 % within a factor of 1.8, daylight against a lamp's
ROTATION_WIDTH = 3.0  # degrees: with 95 % within six
SCANNED = (-6.0, -3.0, 0.0, 3.0, 6.0)  # degrees at which a fit looks for it first
STEPS = (2.0, 1.0)  # degrees between the turns of the environment whose pictures are interpolated, at first and at last
ALIKE = 0.9  # of the prior's variance that photographs share: one camera took them
TOLD = 0.1  # standard deviation below which a factor is no guess any more

Key = Literal["exposure", "white_balance", "scale", "rotation"]


@dataclass(frozen=True)
class Unknown:
    """The logarithm of a factor; or degrees about +Y between the environment and the scene file's rotation.

    Attributes:
        key: of the scene file where it is declared unknown.
        photograph: index; None of one that all photographs share.
        channel: 0 red, 2 blue, for a white balance, which is against green; None for all channels.
        start: of a rotation, the scene file's, in degrees.
    """

    key: Key
    photograph: int | None = None
    channel: int | None = None
    start: float = 0.0

    def value(self, z: Float[Tensor, "*q"]) -> Float[Tensor, "*q"]:
        """The factor; or the rotation in degrees."""
        return self.start + z if self.key == "rotation" else z.exp()

    def is_like(self, other: Unknown) -> bool:
        """Whether both are the same of two photographs."""
        each = self.photograph is not None and other.photograph is not None
        return each and (self.key, self.channel) == (other.key, other.channel)

    @property
    def width(self) -> float:
        """Of the prior."""
        if self.key == "rotation":
            return ROTATION_WIDTH
        return EXPOSURE_WIDTH if self.channel is None else WHITE_BALANCE_WIDTH

    def counts(self, photographs: int) -> Float[Tensor, "v 3"]:
        """1 in the photographs and channels that it is a factor of, else 0."""
        found = torch.zeros(photographs, 3, dtype=torch.float64)
        if self.key == "rotation":
            return found
        rows = slice(None) if self.photograph is None else self.photograph
        found[rows, slice(None) if self.channel is None else self.channel] = 1
        return found


class RotationBracket(NamedTuple):
    """Between which turns of the environment pictures are interpolated, in degrees."""

    centre: float
    step: float


@dataclass(frozen=True)
class Nuisances:
    """The unknowns of a scene's photographs, and a normal prior of their free numbers z.

    Attributes:
        unknowns: what each free number is.
        photographs: how many there are.
        mean: of the prior.
        root: R; |R (z - mean)|² is the prior's sum of squares.
        told: whether the background determines it.
        turn: about which rotation the environment's is fitted; None where it is not.
    """

    unknowns: tuple[Unknown, ...]
    photographs: int
    mean: Float[Tensor, " z"]
    root: Float[Tensor, "z z"]
    told: Bool[Tensor, " z"]
    turn: RotationBracket | None = None

    @staticmethod
    def before(unknowns: Sequence[Unknown], photographs: int) -> Nuisances:
        """Nothing but wide priors about 1, whose common part over several photographs is mostly one error."""
        width = torch.tensor([each.width for each in unknowns], dtype=torch.float64)
        known = torch.zeros(len(unknowns), dtype=torch.bool)
        like = [[ALIKE * each.is_like(other) for other in unknowns] for each in unknowns]
        shared = width[:, None] * torch.tensor(like, dtype=torch.float64).fill_diagonal_(1.0) * width
        root = torch.linalg.cholesky(torch.linalg.inv(shared)).T
        turns = any(each.key == "rotation" for each in unknowns)
        turn = RotationBracket(0.0, STEPS[0]) if turns else None
        return Nuisances(tuple(unknowns), photographs, torch.zeros_like(width), root, known, turn)

    def without_turn(self) -> Nuisances | None:
        """The same without the environment's rotation, which is the last; None where nothing else is unknown."""
        if self.turn is None:
            return self
        mean, root, told = self.mean[:-1], self.root[:-1, :-1], self.told[:-1]
        rest = self.unknowns[:-1]
        return replace(self, unknowns=rest, mean=mean, root=root, told=told, turn=None) if rest else None

    def with_rotation_found(self, z: Float[Tensor, " z"], covariance: Float[Tensor, "x x"]) -> Nuisances:
        """The same with the environment's rotation as a fit has found it, for a model that cannot rotate it.

        Args:
            z: as the fit has found them.
            covariance: of the fit's free vector, which ends with z.
        """
        if self.turn is None:
            return self
        mean, root = self.mean.clone(), self.root.clone()
        mean[-1], root[-1, -1] = float(self.rotation(z)), 1 / float(covariance[-1, -1].sqrt())
        return replace(self, mean=mean, root=root, turn=None)

    @property
    def start(self) -> Float[Tensor, " z"]:
        """Where a fit begins."""
        if self.turn is None:
            return self.mean
        return torch.cat([self.mean[:-1], self.mean.new_tensor([self.turn.centre])])

    def steps(self, z: Float[Tensor, " z"]) -> Float[Tensor, ""]:
        """Rotation of the environment from the middle of `turn`, in its steps."""
        assert self.turn is not None
        return (self.rotation(z) - self.turn.centre) / self.turn.step

    def rotation(self, z: Float[Tensor, " z"]) -> Float[Tensor, ""]:
        """Degrees by which the environment is rotated: the last unknown, where it is one."""
        return z[-1]

    @cached_property
    def counts(self) -> Float[Tensor, "z v 3"]:
        """In which photographs and channels each counts."""
        return torch.stack([each.counts(self.photographs) for each in self.unknowns])

    def factors(self, z: Float[Tensor, " z"]) -> Float[Tensor, "v 3"]:
        """Pixel over radiance."""
        return torch.einsum("z,zvc->vc", z, self.counts).exp()

    def prior(self, z: Float[Tensor, " z"]) -> Float[Tensor, " z"]:
        """What is known before any pixel of the object, as residuals of variance 1."""
        return self.root @ (z - self.mean)

    def learning(self, ratio: Float[Tensor, "v 3"], error: Float[Tensor, "v 3"]) -> Nuisances:
        """The posterior of log factors that were measured; they may be infinitely wrong, which is: not at all.

        Where the unknowns cannot explain what was measured within its errors, these are larger than was thought.
        """
        rows, seen = self.counts.flatten(1).T, ratio.flatten()
        weight = torch.where(error.flatten().isfinite(), 1 / error.flatten(), 0.0)
        rows, seen = weight[:, None] * rows, weight * seen.nan_to_num(0.0, 0.0, 0.0)
        free = int((weight > 0).sum()) - len(self.unknowns)
        alone = torch.linalg.lstsq(rows, seen[:, None], driver="gelsd").solution[:, 0]
        excess = (rows @ alone - seen).square().sum() / max(1, free) if free > 0 else seen.new_ones(())
        rows, seen = (each / excess.clamp_min(1).sqrt() for each in (rows, seen))
        precision = self.root.T @ self.root + rows.T @ rows
        mean = torch.linalg.solve(precision, self.root.T @ (self.root @ self.mean) + rows.T @ seen)
        told = torch.linalg.inv(precision).diagonal().sqrt() < TOLD
        return replace(self, mean=mean, root=torch.linalg.cholesky(precision).T, told=told)

    def about(self, ratio: Float[Tensor, "v 3"]) -> Nuisances:
        """The same with exposures that nothing determines about the log factors of a guess."""
        guess = torch.stack([(each * ratio).sum() / each.sum().clamp_min(1) for each in self.counts])
        vague = ~self.told & torch.tensor([each.key in ("exposure", "scale") for each in self.unknowns])
        return replace(self, mean=torch.where(vague, guess, self.mean))


class PhotographBlock(NamedTuple):
    """Fitted pixels next to each other that share their factors: those of one photograph."""

    pixels: slice
    photograph: int


@dataclass(frozen=True)
class NuisanceFactors:
    """The unknown factors of fitted pixels.

    Attributes:
        nuisances: of the scene.
        photograph: of each pixel.
    """

    nuisances: Nuisances
    photograph: Int[Tensor, " p"]

    @cached_property
    def blocks(self) -> tuple[PhotographBlock, ...]:
        """All pixels, in order."""
        own, counts = self.photograph.unique_consecutive(return_counts=True)
        ends = counts.cumsum(0).tolist()
        spans = zip([0, *ends], ends, own.tolist(), strict=False)
        return tuple(PhotographBlock(slice(first, end), photograph) for first, end, photograph in spans)

    def factors(self, z: Float[Tensor, " z"]) -> Float[Tensor, "p 3"]:
        """Of each pixel."""
        return self.nuisances.factors(z)[self.photograph]


def unknowns_of(scene: Scene) -> tuple[Unknown, ...]:
    """The nuisance parameters that a scene file declares."""
    found: list[Unknown] = []
    if scene.exposure == FITTED:
        found.append(Unknown("exposure"))
    if scene.environment.scale == FITTED:
        found.append(Unknown("scale"))
    if scene.white_balance == FITTED:
        found += [Unknown("white_balance", channel=channel) for channel in (0, 2)]
    for index, each in enumerate(scene.photographs):
        if each.exposure == FITTED:
            found.append(Unknown("exposure", index))
        if each.white_balance == FITTED:
            found += [Unknown("white_balance", index, channel) for channel in (0, 2)]
    degrees, is_fitted = turn_of(scene.environment.rotation)
    if is_fitted:
        found.append(Unknown("rotation", start=degrees))
    return tuple(found)


def require_no_free_nuisances(scene: Scene, scene_file: Path, which: str) -> None:
    """Raises InputError where the scene file declares a nuisance parameter."""
    if unknowns := unknowns_of(scene):
        expected = f"numbers for exposures, white balances, scale and rotation, {which}"
        raise InputError(scene_file, _field(unknowns[0]), FITTED, expected)


def _field(unknown: Unknown) -> str:
    """Its key in the scene file."""
    if unknown.photograph is not None:
        return f"photographs[{unknown.photograph}].{unknown.key}"
    return f"environment.{unknown.key}" if unknown.key in ("scale", "rotation") else unknown.key
