"""Known metals: complex refractive indices measured by others, from `metals.csv` beside this file."""

from __future__ import annotations

import csv
import difflib
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from fit_material.renderer.errors.input_error import InputError

TABLE = Path(__file__).with_name("metals.csv")
DARKEST_METAL = 0.01  # F0 below which nothing is a metal: tungsten, the table's darkest, has 0.5, glass 0.04
DARKEST_MATTE = 0.002  # colour below which nothing is a matte material: black velvet and soot have more


@dataclass(frozen=True)
class Metal:
    """One metal as somebody measured it, at one wavelength each for red, green and blue.

    Attributes:
        name: chemical symbol or alloy designation, such as "Au" or "CuZn30".
        title: common name, such as "gold" or "brass".
        n, k: real part and extinction coefficient of the refractive index n + ik, red, green, blue; unitless.
        wavelengths: where they were read off, red, green, blue; nanometres in vacuum.
        source: who measured, the data base's page, and its licence.
    """

    name: str
    title: str
    n: tuple[float, float, float]
    k: tuple[float, float, float]
    wavelengths: tuple[float, float, float]
    source: str


@cache
def read_catalogue() -> tuple[Metal, ...]:
    """All metals of the table, in its order."""
    with TABLE.open(encoding="utf-8", newline="") as file:
        return tuple(_metal(row) for row in csv.DictReader(file))


def metal(name: str) -> Metal:
    """The metal called `name`: symbol or common name, in any case.

    Raises:
        InputError: where the table has no such metal; names the nearest ones it has.
    """
    by_name = {key.lower(): entry for entry in read_catalogue() for key in (entry.name, entry.title)}
    wanted = name.strip().lower()
    if wanted not in by_name:
        raise InputError("--metal", value=repr(name), expected=f"a known metal, such as {_suggestion(wanted, by_name)}")
    return by_name[wanted]


def _metal(row: dict[str, str]) -> Metal:
    def rgb(quantity: str) -> tuple[float, float, float]:
        return float(row[f"{quantity}_r"]), float(row[f"{quantity}_g"]), float(row[f"{quantity}_b"])

    return Metal(row["name"], row["title"], rgb("n"), rgb("k"), rgb("wavelength"), row["source"])


def _suggestion(wanted: str, by_name: dict[str, Metal]) -> str:
    """The nearest names as the table spells them, or all symbols where nothing is near."""
    near = difflib.get_close_matches(wanted, by_name, n=3)
    if near:
        return " or ".join(f"{by_name[key].name} ({by_name[key].title})" for key in near)
    return ", ".join(entry.name for entry in read_catalogue())
