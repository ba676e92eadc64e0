"""What `frontier` compares: rungs of the ladder, or single choices around the standard one, as options of `fit`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from fit_material.renderer.errors.input_error import InputError


@dataclass(frozen=True)
class Rung:
    """One way to fit.

    Attributes:
        name: for tables and plots.
        options: of `fit-material fit`, exactly as one would type them.
    """

    name: str
    options: tuple[str, ...] = ()


def _between(preset: str, samples: int, pixels: int) -> Rung:
    """A preset with other numbers."""
    options = ("--fidelity", preset, "--samples", str(samples), "--pixels", str(pixels))
    return Rung(f"{preset}-{samples}-{pixels}", options)


LADDER = (
    Rung("viewer", ("--fidelity", "viewer")),
    _between("preview", 128, 1500),
    Rung("preview", ("--fidelity", "preview")),
    _between("preview", 512, 6000),
    Rung("standard", ("--fidelity", "standard")),
    _between("standard", 1024, 24000),
    Rung("reference", ("--fidelity", "reference")),
)
"""From the cheapest to the finest: the presets, and powers of two of samples and pixels between them."""

CHOICES = (
    Rung("standard"),  # conductor, ggx, float32, lm
    Rung("schlick", ("--reflectance", "schlick")),
    Rung("lazanyi", ("--reflectance", "lazanyi")),
    Rung("taps", ("--lobe", "taps")),
    Rung("gaussian", ("--lobe", "gaussian")),
    Rung("beckmann", ("--lobe", "beckmann")),
    Rung("float64", ("--dtype", "float64")),
    Rung("environment-256", ("--environment-size", "256")),
    Rung("adam", ("--solver", "adam")),
    Rung("lbfgs", ("--solver", "lbfgs")),
)
"""The standard rung, and the same with one choice made otherwise."""


def named(rungs: Sequence[Rung], names: str | None, always: Sequence[Rung] = ()) -> tuple[Rung, ...]:
    """Those of the rungs whose names are listed, separated by commas, in the ladder's order; all where none are.

    Args:
        rungs: to choose from.
        names: as they were typed.
        always: rungs that need not be listed.

    Raises:
        InputError: there is no such rung, or fewer than two are left to compare.
    """
    if names is None:
        return tuple(rungs)
    wanted = [name.strip() for name in names.split(",")]
    known = [rung.name for rung in rungs]
    for name in wanted:
        if name not in known:
            expected = f"names separated by commas, of {', '.join(known)}"
            raise InputError("--rungs", value=name or '""', expected=expected)
    found = tuple(rung for rung in rungs if rung.name in wanted or rung in always)
    if len(found) < 2:
        expected = f"another than {always[0].name}" if always else "two rungs at least, to compare"
        raise InputError("--rungs", value=names, expected=expected)
    return found
