"""One row of the table of hard cases: an input, and what must hold of it."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.renderer.errors.input_error import InputError

EVERYWHERE = (float("-inf"), float("inf"))


@dataclass(frozen=True)
class Numbers:
    """What a row is computed in: `torch.float32` or `torch.float64`, on one device."""

    dtype: torch.dtype
    device: torch.device = field(default_factory=lambda: torch.device("cpu"))

    @property
    def eps(self) -> float:
        """Distance from 1 to the next number."""
        return torch.finfo(self.dtype).eps

    def tensor(self, values: Any) -> Tensor:
        """Values as a tensor of these numbers."""
        return torch.as_tensor(values, dtype=self.dtype, device=self.device)

    def __str__(self) -> str:
        name = str(self.dtype).removeprefix("torch.")
        return name if self.device.type == "cpu" else f"{name} on {self.device}"


@dataclass(frozen=True)
class Formula:
    """A function at hard places.

    Attributes:
        function: of tensors by name; each element of its result depends on that element of each input alone.
        places: values of each input, as many of each.
        domain: where an input may be, both ends included; everywhere where it is left out.
        scale: over which the function changes with an input; without it 1, or the input itself where that is larger.
    """

    function: Callable[..., Float[Tensor, " p"]]
    places: Mapping[str, Sequence[float]]
    domain: Mapping[str, tuple[float, float]] = field(default_factory=lambda: MappingProxyType({}))
    scale: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))

    def inputs(self, numbers: Numbers) -> dict[str, Float[Tensor, " p"]]:
        """The places, rounded to these numbers."""
        return {name: numbers.tensor(values) for name, values in self.places.items()}

    def value(self, numbers: Numbers) -> Float[Tensor, " p"]:
        return self.function(**self.inputs(numbers))

    def with_slopes(self, numbers: Numbers) -> tuple[Float[Tensor, " p"], dict[str, Float[Tensor, " p"]]]:
        """The value, and its derivative by each input, by torch's backward pass."""
        inputs = {name: values.requires_grad_() for name, values in self.inputs(numbers).items()}
        value = self.function(**inputs)
        slopes = torch.autograd.grad(value.sum(), list(inputs.values()), allow_unused=True, materialize_grads=True)
        return value.detach(), dict(zip(inputs, slopes, strict=True))

    def exactly(self, numbers: Numbers) -> Formula:
        """The same function at the places as these numbers hold them."""
        places = {name: values.tolist() for name, values in self.inputs(numbers).items()}
        return Formula(self.function, places, self.domain, self.scale)


def grid(**values: Sequence[float]) -> dict[str, list[float]]:
    """Every combination of values, as places of a formula."""
    rows = list(itertools.product(*values.values()))
    return {name: [row[i] for row in rows] for i, name in enumerate(values)}


@dataclass(frozen=True)
class Claim:
    """Something that must hold.

    Attributes:
        word: for it, as the table has it.
        broken: from the row's subject (a `Formula`, or what an experiment returned) to a sentence about what does not
            hold, by how much; None where it holds.
    """

    word: str
    broken: Callable[[Any, Numbers], str | None]


Experiment = Callable[[Numbers], Any]
"""Something that is done once in given numbers; an `InputError` that it raises is its result."""


@dataclass(frozen=True)
class Row:
    """A hard case.

    Attributes:
        name: short, unique, for tests and `selftest`.
        hard: the difficulty.
        given: the input, in words.
        subject: the input itself.
        holds: what must hold.
        reference: what it is held against, which is never this code's own earlier output.
        once: one run, in float64, is enough for a selftest of a minute: the numbers touch next to nothing that the row
            is about, or it takes seconds, and the tests alone have the other run.
    """

    name: str
    hard: str
    given: str
    subject: Formula | Experiment
    holds: tuple[Claim, ...]
    reference: str
    once: bool = False

    def broken(self, numbers: Numbers) -> list[str]:
        """A sentence for each claim that does not hold in these numbers."""
        try:
            subject = self.subject if isinstance(self.subject, Formula) else _outcome(self.subject, numbers)
            found = [(claim.word, claim.broken(subject, numbers)) for claim in self.holds]
        except Exception as error:  # whatever is raised here is what the row is there to find
            return [f"raised {type(error).__name__}: {error}".partition("\n")[0]]
        return [f"{word}: {sentence}" for word, sentence in found if sentence is not None]


def _outcome(experiment: Experiment, numbers: Numbers) -> Any:
    try:
        return experiment(numbers)
    except InputError as refusal:
        return refusal
