"""A finished result in other programs' formats."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from types import MappingProxyType

from fit_material.fitter.export.blender import blender
from fit_material.fitter.export.gltf import gltf
from fit_material.fitter.export.materialx import materialx
from fit_material.fitter.export.mitsuba_xml import mitsuba_xml
from fit_material.fitter.export.mtl import ordinary_mtl, thesis_mtl
from fit_material.fitter.result.schema import FittedMaterial, PerParameter, Result
from fit_material.fitter.result.written_files import written_by_fit
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.atomic import replaced_together, write_bytes_atomically, write_text_atomically
from fit_material.renderer.files.regular_files import read_bytes
from fit_material.renderer.files.replaceable import Replaceable
from fit_material.renderer.materials.mtl_syntax import FLOAT32_MAX

PNG = b"\x89PNG\r\n\x1a\n"  # what such files begin with

Writer = Callable[[Sequence[FittedMaterial]], str]

KNOWN = "one of the same content, or --replace"

FORMATS: Mapping[str, tuple[str, Writer]] = MappingProxyType(
    {
        "thesis": (".thesis.mtl", thesis_mtl),
        "mtl": (".mtl", ordinary_mtl),
        "gltf": (".gltf", gltf),
        "materialx": (".mtlx", materialx),
        "mitsuba": (".xml", mitsuba_xml),
        "blender": (".blender.py", blender),
    }
)
"""Each format's name on the command line: what its files end with, and what writes their text."""


def export(
    result: Result,
    formats: Sequence[str],
    directory: str | Path,
    stem: str,
    source: str | Path = "result.json",
    *,
    replace: bool = False,
) -> tuple[Path, ...]:
    """Write the materials of `result` in each of `formats`: all files or, if one cannot be made, none.

    A file of other content is replaced where `result.json` in `directory` lists it, or where `replace` allows it.

    Args:
        formats: keys of `FORMATS`, at least one.
        directory: where the files go; made if it is not there.
        stem: what the files are called before their ending: the scene's name.
        source: where the result was read: never overwritten, nor are textures beside it.
        replace: overwrite whatever has the name of a file that is to be written.

    Returns:
        The files, in the order of `formats`.

    Raises:
        InputError: an unknown format, a stem that is no file name, a folder that cannot be written, a file in it that
            may not be replaced, or a material without a number that the format needs.
    """
    known = [_known(name) for name in formats]
    if Path(stem).name != stem:
        raise InputError("export", value=repr(stem), expected="a name for files, without folders in it")
    _require_colors(result.materials, source)
    allowed = _replaceable(result, Path(directory), Path(source), replace)
    with replaced_together(directory, replaceable=allowed) as folder:
        for ending, writer in known:
            write_text_atomically(folder / f"{stem}{ending}", _written(writer, result.materials, source))
        if {writer for _, writer in known} & {thesis_mtl, ordinary_mtl}:
            _copy_maps(result.materials, Path(source), folder)
    return tuple(Path(directory) / f"{stem}{ending}" for ending, _ in known)


def _replaceable(result: Result, directory: Path, source: Path, replace: bool) -> Replaceable:
    maps = [source.parent / material.maps.color for material in result.materials if material.maps is not None]
    own = {} if replace else written_by_fit(directory)
    return Replaceable((source, *maps), own, "" if replace else KNOWN)


def _copy_maps(materials: Sequence[FittedMaterial], source: Path, folder: Path) -> None:
    """The textures that MTL files name, which lie beside the result, into the same folder as these."""
    for index, material in enumerate(materials):
        if material.maps is None:
            continue
        field = f"materials[{index}].maps.color"
        write_bytes_atomically(folder / material.maps.color, _texture(source, field, material.maps.color))


def _texture(source: Path, field: str, name: str) -> bytes:
    """A texture, and no other file of whoever exports a result of somebody else's."""
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


def _written(writer: Writer, materials: Sequence[FittedMaterial], source: str | Path) -> str:
    """The writer's text; where it has none, the sentence about the first material at fault."""
    for index, material in enumerate(materials):
        try:
            writer([material])
        except (ValueError, ArithmeticError) as error:
            value = f"{material.type} {material.name!r}"
            expected = f"numbers that the format can hold ({error})"
            raise InputError(source, f"materials[{index}]{_beyond(material)}", value, expected) from error
    return writer(materials)


def _beyond(material: FittedMaterial) -> str:
    """The first parameter that float32 cannot hold, as the end of a field; "" if there is none."""
    for name in PerParameter.model_fields:
        value = getattr(material, name)
        numbers = value if isinstance(value, tuple) else (value,)
        if any(number is not None and not abs(number) <= FLOAT32_MAX for number in numbers):
            return f".{name}"
    return ""


def _require_colors(materials: Sequence[FittedMaterial], source: str | Path) -> None:
    """Raises InputError where there is no material, or one whose diffuse colour no format can hold."""
    if not materials:
        raise InputError(source, "materials", "[]", "at least one material")
    for index, material in enumerate(materials):
        for value in material.color or ():
            if not 0 <= value <= 1:
                raise InputError(source, f"materials[{index}].color", value, "numbers in [0, 1]")


def _known(name: str) -> tuple[str, Writer]:
    if name in FORMATS:
        return FORMATS[name]
    nearest = get_close_matches(name.lower(), FORMATS, n=1, cutoff=0.0)
    expected = f"one of {', '.join(FORMATS)}; the nearest is {nearest[0]}"
    raise InputError("--to", value=repr(name), expected=expected)
