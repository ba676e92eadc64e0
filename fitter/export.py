"""A finished result in other programs' formats."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from types import MappingProxyType

from fitter.mtl import ordinary_mtl, thesis_mtl
from fitter.result import FittedMaterial, Result
from renderer.atomic import replaced_together, write_text_atomically
from renderer.errors import InputError

Writer = Callable[[Sequence[FittedMaterial]], str]

FORMATS: Mapping[str, tuple[str, Writer]] = MappingProxyType(
    {"thesis": (".thesis.mtl", thesis_mtl), "mtl": (".mtl", ordinary_mtl)}
)
"""Each format's name on the command line: what its files end with, and what writes their text."""


def export(result: Result, formats: Sequence[str], directory: str | Path, stem: str) -> tuple[Path, ...]:
    """Write the materials of `result` in each of `formats`: all files or, if one cannot be made, none.

    Args:
        formats: keys of `FORMATS`, at least one.
        directory: where the files go; made if it is not there.
        stem: what the files are called before their ending: the scene's name.

    Returns:
        The files, in the order of `formats`.

    Raises:
        InputError: an unknown format, a stem that is no file name, or a folder that cannot be written.
        ValueError: a material lacks a number that its MTL needs (`fitter.mtl`).
    """
    known = [_known(name) for name in formats]
    if Path(stem).name != stem:
        raise InputError("export", value=repr(stem), expected="a name for files, without folders in it")
    with replaced_together(directory) as folder:
        for ending, writer in known:
            write_text_atomically(folder / f"{stem}{ending}", writer(result.materials))
    return tuple(Path(directory) / f"{stem}{ending}" for ending, _ in known)


def _known(name: str) -> tuple[str, Writer]:
    if name in FORMATS:
        return FORMATS[name]
    nearest = get_close_matches(name.lower(), FORMATS, n=1, cutoff=0.0)
    expected = f"one of {', '.join(FORMATS)}; the nearest is {nearest[0]}"
    raise InputError("--to", value=repr(name), expected=expected)
