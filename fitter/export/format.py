"""An export format: its name, what its files end with, and what writes them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from fit_material.renderer.files.atomic import in_utf8

if TYPE_CHECKING:
    from fit_material.fitter.result.schema import FittedMaterial

Files = Mapping[str, bytes]
"""Contents of files by their names, which have no folders in them."""


@dataclass(frozen=True)
class Export:
    """Input of a format's writer.

    Attributes:
        materials: of the result.
        stem: what every file is called before its ending: the scene's name.
        ending: of the format's main file.
        textures: PNG files of the result, by the names in the materials' `maps`; each is read when it is looked up.
    """

    materials: Sequence[FittedMaterial]
    stem: str
    ending: str
    textures: Files

    @property
    def file(self) -> str:
        """Name of the format's main file."""
        return f"{self.stem}{self.ending}"


Writer = Callable[[Export], Files]
"""Raises ValueError where a number that the format needs is missing, not finite or out of range."""


@dataclass(frozen=True)
class Format:
    """A format that materials are exported in.

    Attributes:
        name: as the command line has it.
        ending: of its main file, behind the scene's name.
        write: its files, of which one is `Export.file`.
    """

    name: str
    ending: str
    write: Writer

    def files(self, materials: Sequence[FittedMaterial], stem: str, textures: Files) -> Files:
        """The materials' files in this format; see `Export` for the arguments."""
        return self.write(Export(materials, stem, self.ending, textures))


def text_file(text: Callable[[Sequence[FittedMaterial]], str]) -> Writer:
    """Writer of a single file, whose text depends on the materials alone."""
    return lambda export: {export.file: in_utf8(text(export.materials))}
