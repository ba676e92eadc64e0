"""Which scenes a batch fits: from lists, folders, patterns and scene files to paths and names."""

from __future__ import annotations

import glob
import hashlib
import itertools
import os
import re
import shlex
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from fit_material.fitter.batch.pattern import matching
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.regular_files import read_bytes
from fit_material.renderer.files.validation import shortened

SCENE_FILE = "scene.toml"  # whose name is no name of a scene: its folder's is
TAKEN = frozenset({"summary.html", "summary.json", "fits.jsonl"})  # names of a batch's own files
LONGEST = 80  # characters of a name: files inside the folder need some, too


@dataclass(frozen=True)
class Listed:
    """One scene of a list.

    Attributes:
        scene: its file, absolute; whether it is there is not looked at.
        folder: that names are made from the path below.
        where: it is listed, for errors.
        words: options of `fit` for this scene alone.
    """

    scene: Path
    folder: Path
    where: str
    words: tuple[str, ...] = ()


def read_lists(sources: Sequence[str]) -> dict[str, Listed]:
    """All scenes by the names of their results, in order; what is listed twice, but with the same options, once.

    Args:
        sources: of each a list (a text file, "-" for standard input), a folder, or a scene file that ends in ".toml".

    Raises:
        InputError: a list cannot be read, there is no scene, or one is listed twice with unlike options.
    """
    found: dict[Path, Listed] = {}
    for listed in (each for source in sources for each in _source(source)):
        earlier = found.setdefault(Path(os.path.realpath(listed.scene)), listed)
        if earlier.words != listed.words:
            expected = f"each scene once; {earlier.where} lists it with other options"
            raise InputError(listed.where, value=listed.scene, expected=expected)
    if not found:
        raise InputError(", ".join(sources), expected="at least one scene")
    return dict(zip(_names(list(found.values())), found.values(), strict=True))


def _source(source: str) -> Iterator[Listed]:
    path = Path(source)
    if source != "-" and (path.is_dir() or path.suffix == ".toml"):
        inside = _expanded(source, Path(), "LIST", ())
        yield from (replace(each, folder=_absolute(path)) for each in inside) if path.is_dir() else inside
        return
    for number, line in enumerate(_lines(source), 1):
        where = f"{'standard input' if source == '-' else source}: line {number}"
        yield from _line(line.strip(), Path() if source == "-" else path.parent, where)


def _lines(source: str) -> list[str]:
    try:
        data = sys.stdin.buffer.read() if source == "-" else read_bytes(Path(source))
        return data.decode("utf-8-sig").splitlines()
    except OSError as error:
        raise InputError(source, expected=f"a list of scenes that can be read ({error.strerror})") from None
    except UnicodeDecodeError:
        raise InputError(source, expected="a list of scenes in UTF-8, one to a line") from None


def _line(line: str, folder: Path, where: str) -> Iterator[Listed]:
    """A path, as it is or as a shell has it, then options; "#" begins a comment."""
    if not line or line.startswith("#"):
        return
    if _is_there(folder / line):  # a path may have spaces
        yield from _expanded(line, folder, where, ())
        return
    try:
        path, *words = shlex.split(line)  # a first word that begins with # is quoted: it is no comment
    except ValueError:
        raise InputError(where, value=shortened(line), expected="quotes in pairs") from None
    options = tuple(itertools.takewhile(lambda word: not word.startswith("#"), words))
    if path.startswith("-"):
        raise InputError(where, value=shortened(line), expected="a scene file, and options behind it")
    yield from _expanded(path, folder, where, options)


def _expanded(text: str, folder: Path, where: str, words: tuple[str, ...]) -> Iterator[Listed]:
    """A scene file, all scenes of a folder, or all that match a pattern."""
    path = _path(text, folder, where)
    matches = sorted(matching(text, folder)) if glob.has_magic(text) else []
    if glob.has_magic(text) and not matches and not _is_there(path):
        raise InputError(where, value=shortened(text), expected="a pattern that some scene file matches")
    for each in matches or [path]:
        if each.is_dir() and not (inside := sorted(each.rglob(SCENE_FILE))):
            raise InputError(where, value=each, expected=f"a folder with a {SCENE_FILE}, or with folders that have one")
        for scene in inside if each.is_dir() else [each]:
            yield Listed(_absolute(scene), _absolute(folder), where, words)


def _path(text: str, folder: Path, where: str) -> Path:
    """What a text names, whether or not it is there.

    Raises:
        InputError: it cannot be: a zero byte, a name too long, no user's home, or a folder that may not be looked into.
    """
    try:
        path = folder / Path(text).expanduser()
        os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        return path
    except (OSError, RuntimeError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(where, value=shortened(text), expected=f"the path of a file ({reason})") from None
    return path


def _is_there(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):  # a name too long, a zero byte
        return False


def _absolute(path: Path) -> Path:
    return Path(os.path.abspath(path))


def _names(scenes: Sequence[Listed]) -> list[str]:
    """Readable, and all different, on disks that ignore case as well; the same for the same paths."""
    plain = [_name(each) for each in scenes]
    count = Counter(name.casefold() for name in plain)
    return [
        name if count[name.casefold()] == 1 and name not in TAKEN else f"{name}-{_digest(each)}"
        for name, each in zip(plain, scenes, strict=True)
    ]


def _name(listed: Listed) -> str:
    """Of photographs/copper/scene.toml photographs-copper; of copper/polished.toml copper-polished."""
    relative = Path(os.path.relpath(listed.scene, listed.folder))
    parts = relative.parent.parts if relative.name == SCENE_FILE else relative.with_suffix("").parts
    text = "-".join(part for part in parts if part not in ("..", "."))
    name = re.sub(r"[^\w.+-]+", "-", text).strip("-.") or re.sub(r"\W+", "-", listed.scene.parent.name) or "scene"
    return name if len(name) <= LONGEST else f"{name[:LONGEST]}-{_digest(listed)}"


def _digest(listed: Listed) -> str:
    relative = Path(os.path.relpath(listed.scene, listed.folder)).as_posix()
    return hashlib.sha256(relative.encode("utf-8", "surrogateescape")).hexdigest()[:6]
