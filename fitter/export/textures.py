"""Textures of a result: PNG files beside it, and no other file of whoever exports somebody else's result."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from fit_material.fitter.result.schema import FittedMaterial, Maps
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.regular_files import read_bytes

PNG = b"\x89PNG\r\n\x1a\n"  # what such files begin with


class TexturesBeside(Mapping[str, bytes]):
    """The textures that the materials of a result name, each read when it is looked up.

    Looking one up raises InputError where it is no PNG file in the result's folder, links followed.
    """

    def __init__(self, materials: Sequence[FittedMaterial], source: Path) -> None:
        """Of `source` the folder counts, and its sentences name it."""
        self._source, self._fields = source, _fields_by_name(materials)

    def __getitem__(self, name: str) -> bytes:
        return _png(self._source, self._fields[name], name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._fields)

    def __len__(self) -> int:
        return len(self._fields)

    @property
    def paths(self) -> tuple[Path, ...]:
        """Where they are read, which nothing may overwrite."""
        return tuple(self._source.parent / name for name in self)


def _fields_by_name(materials: Sequence[FittedMaterial]) -> dict[str, str]:
    """The field of the result that names each texture; the first of several."""
    fields: dict[str, str] = {}
    for index, material in enumerate(materials):
        for key in Maps.model_fields if material.maps is not None else ():
            fields.setdefault(getattr(material.maps, key), f"materials[{index}].maps.{key}")
    return fields


def _png(source: Path, field: str, name: str) -> bytes:
    path = source.parent / name
    try:
        here = path.resolve(strict=True).parent == source.parent.resolve()
        data = read_bytes(path) if here and path.is_file() else b""
    except (OSError, RuntimeError) as error:  # RuntimeError of links in a circle
        reason = getattr(error, "strerror", None) or "links in a circle"
        raise InputError(source, field, name, f"a file beside it ({reason})") from error
    if not data.startswith(PNG):
        raise InputError(source, field, name, "a PNG file beside it")
    return data
