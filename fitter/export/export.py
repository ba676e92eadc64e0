"""A finished result in other programs' formats."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from pathlib import Path

from fit_material.fitter.export.format import Files, Format
from fit_material.fitter.export.formats import FORMATS
from fit_material.fitter.export.textures import TexturesBeside
from fit_material.fitter.result.schema import FittedMaterial, PerParameter, Result
from fit_material.fitter.result.written_files import written_by_fit
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.atomic import replaced_together, write_bytes_atomically
from fit_material.renderer.files.replaceable import Replaceable
from fit_material.renderer.materials.mtl_syntax import FLOAT32_MAX

KNOWN = "one of the same content, or --replace"


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
        The main file of each format, in the order of `formats`.

    Raises:
        InputError: an unknown format, a stem that is no file name, a folder that cannot be written, a file in it that
            may not be replaced, two formats of different files by one name, a texture that is no PNG beside the result,
            or a material without a number that the format needs.
    """
    known = [_known(name) for name in formats]
    if Path(stem).name != stem:
        raise InputError("export", value=repr(stem), expected="a name for files, without folders in it")
    _require_colors(result.materials, source)
    textures = TexturesBeside(result.materials, Path(source))
    own = {} if replace else written_by_fit(Path(directory))
    allowed = Replaceable((Path(source), *textures.paths), own, "" if replace else KNOWN)
    with replaced_together(directory, replaceable=allowed) as folder:
        files = _together(_files(each, result.materials, stem, textures, source) for each in known)
        for name, data in files.items():
            write_bytes_atomically(folder / name, data)
    return tuple(Path(directory) / f"{stem}{each.ending}" for each in known)


def _together(formats: Iterable[Files]) -> Files:
    """The files of all formats; raises InputError where two of them have different contents for one name."""
    together: dict[str, bytes] = {}
    for files in formats:
        for name, data in files.items():
            if together.setdefault(name, data) != data:
                raise InputError("--to", expected=f"formats of which no two write {name}: export them one by one")
    return together


def _files(
    known: Format, materials: Sequence[FittedMaterial], stem: str, textures: TexturesBeside, source: str | Path
) -> Files:
    """The format's files; where it has none, the sentence about the first material at fault."""
    try:
        return known.files(materials, stem, textures)
    except (ValueError, ArithmeticError):
        for index, material in enumerate(materials):
            try:
                known.files([material], stem, textures)
            except (ValueError, ArithmeticError) as error:
                value = f"{material.type} {material.name!r}"
                expected = f"numbers that the format can hold ({error})"
                raise InputError(source, f"materials[{index}]{_beyond(material)}", value, expected) from error
        raise


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


def _known(name: str) -> Format:
    if name in FORMATS:
        return FORMATS[name]
    nearest = get_close_matches(name.lower(), FORMATS, n=1, cutoff=0.0)
    expected = f"one of {', '.join(FORMATS)}; the nearest is {nearest[0]}"
    raise InputError("--to", value=repr(name), expected=expected)
