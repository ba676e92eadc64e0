"""MTL as text: blocks of key and value, whatever the keys mean; names as our writer spells them."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.regular_files import read_bytes
from fit_material.renderer.files.validation import existing_file, shortened
from fit_material.renderer.geometry.mesh import UNNAMED
from fit_material.renderer.geometry.obj import decoded

FLOAT32_MAX = (2 - 2**-23) * 2.0**127

Triple = tuple[float, float, float]

_NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"
_OPTION = re.compile(
    r"(?<!\S)-(?:(?:blendu|blendv|boost|cc|clamp|colorspace|imfchan|texres|type)\s+\S+"
    rf"|bm\s+{_NUMBER}|mm\s+{_NUMBER}\s+{_NUMBER}|[ost]\s+{_NUMBER}(?:\s+{_NUMBER}){{0,2}})(?!\S)"
)
_NEUTRAL = {"s": (1, 1, 1), "o": (0, 0, 0), "t": (0, 0, 0), "bm": (1,), "mm": (0, 1)}
_COMMENT = re.compile(r"(?:^|\s)#.*")
_COMMENT_BEHIND = re.compile(r"\s#.*")


@dataclass(frozen=True)
class Block:
    """What stands behind one `newmtl`.

    Attributes:
        file: where.
        name: the material's; blanks inside are one blank.
        values: what stands behind each key, the last time it does; keys in lower case.
    """

    file: Path
    name: str
    values: dict[str, str] = field(default_factory=dict)

    def number(self, key: str) -> float | None:
        """The first number behind `key`; None where there is nothing.

        Raises:
            InputError: no number, or one that float32 does not hold.
        """
        words = [word for word in self._words(key) if word != "-halo"]
        return self._float(key, words[0]) if words else None

    def triple(self, key: str) -> Triple | None:
        """The colour behind `key`, three numbers or one for all channels [MTL, "Ka r g b"]; None where there is none.

        Raises:
            InputError: two numbers, no numbers, a spectral curve, or numbers that float32 does not hold.
        """
        words = self._words(key)
        if not words:
            return None
        if words[0].lower() in ("spectral", "xyz") or len(words) == 2:
            raise self.error(key, " ".join(words), "one number or three: red, green, blue")
        red, green, blue = (self._float(key, word) for word in (words * 3 if len(words) == 1 else words)[:3])
        return red, green, blue

    def error(self, key: str, value: object, expected: str) -> InputError:
        """The sentence about this material's `key`."""
        return InputError(self.file, f"{shortened(self.name)}: {key}", shortened(str(value)), expected)

    def remark(self, keys: str, what: str = "not drawn") -> str:
        """A sentence about keys of this material that do no harm and do not count."""
        return f"{self.file}: {shortened(self.name)}: {keys} {what}"

    def _words(self, key: str) -> list[str]:
        return _COMMENT.sub("", self.values.get(key.lower(), "")).split()

    def _float(self, key: str, word: str) -> float:
        if not re.fullmatch(_NUMBER, word) or not abs(float(word)) <= FLOAT32_MAX:
            raise self.error(key, word, "a finite number of float32's range")
        return float(word)


def read_blocks(path: Path) -> list[Block]:
    """The materials of an MTL file, in its order; of two with one name the later one.

    Line ends of every system, tabs, byte-order marks, indentation and comments do no harm.

    Raises:
        InputError: the file cannot be read.
    """
    try:
        text = decoded(read_bytes(path))
    except (OSError, ValueError) as error:
        raise InputError(path, expected="a readable MTL file") from error
    blocks: dict[str, Block] = {}
    block = Block(path, "")  # keys before the first `newmtl` belong to no material
    for line in re.split(r"\r\n?|\n", text):
        key, _, value = line.strip().replace("\t", " ").partition(" ")
        if key.lower() == "newmtl":
            block = Block(path, spelled(value) or UNNAMED)
            blocks.pop(block.name, None)
            blocks[block.name] = block
        elif key and not key.startswith("#"):
            block.values[key.lower()] = value.strip()
    return list(blocks.values())


def spelled(name: str) -> str:
    """A material's name without the comment behind it, and with single blanks."""
    return " ".join(_COMMENT_BEHIND.sub("", name).split())


def texture_file(value: str) -> str:
    """The file's name in what stands behind `map_Kd` and the like: without options, wherever they stand."""
    return _OPTION.sub("", value).strip().strip('"')


def texture_options(value: str) -> list[str]:
    """The options of a texture that would change its look here: scale, offset, turbulence, strength, clamping."""
    return [option[0] for option in _OPTION.finditer(value) if _changes_something(option[0])]


def _changes_something(option: str) -> bool:
    key, *words = option[1:].split()
    if key == "clamp":
        return words == ["on"]
    neutral = _NEUTRAL.get(key)
    return neutral is not None and any(float(word) != value for word, value in zip(words, neutral, strict=False))


def found_file(name: str, folder: Path, tree: Path | None = None) -> Path | None:
    """The file that an OBJ or MTL in `folder` calls `name`; None where there is none.

    Tried in this order: the name as it is, with slashes for backslashes, without the comment behind it, and only its
    last part, for paths of another computer.

    Args:
        tree: a folder in or below which the file has to be, links followed; None for anywhere.
    """
    slashes = re.sub(r"\\+", "/", name)
    plain = _COMMENT_BEHIND.sub("", slashes).strip()
    candidates = (name, slashes, plain, plain.rpartition("/")[2])
    found = (existing_file(candidate, folder) for candidate in candidates if candidate)
    return next((file for file in found if file is not None and (tree is None or _lies_in(tree, file))), None)


def _lies_in(tree: Path, file: Path) -> bool:
    try:
        return file.resolve().is_relative_to(tree.resolve())
    except (OSError, RuntimeError):  # links in a circle
        return False


def written_names(names: Iterable[str]) -> list[str]:
    """The names as our MTL files spell them: without blanks and the like, and no two the same."""
    return distinct([_safe_name(name) for name in names])


def _safe_name(name: str) -> str:
    """`name` without what loses materials in tinyobjloader and Blender: blanks, BOM, emptiness; and what steers."""
    kept = re.sub(r"[\s\x00-\x1f\x7f-\x9f\ud800-\udfff#\\]+", "_", name.replace("\ufeff", "").strip())
    return kept or "unnamed"


def distinct(names: list[str]) -> list[str]:
    """The names, those met before with _2, _3, … behind them."""
    taken: dict[str, None] = {}
    last: dict[str, int] = {}
    for name in names:
        numbers = ((i, f"{name}_{i}" if i > 1 else name) for i in range(last.get(name, 0) + 1, len(names) + 1))
        last[name], free = next((i, candidate) for i, candidate in numbers if candidate not in taken)
        taken[free] = None
    return list(taken)
