"""Checked input: pydantic models that refuse unknown keys, and their errors as one sentence for the user."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    PlainValidator,
    Strict,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic_core import ErrorDetails, PydanticCustomError

from fit_material.renderer.errors.input_error import InputError, as_written
from fit_material.renderer.errors.printable import has_controls, printable
from fit_material.renderer.files.regular_files import special

Model = TypeVar("Model", bound=BaseModel)

PLAIN = "without control characters"
DEEPEST = 100  # tables and lists inside each other, beyond which pydantic cannot report them; files of ours have five


class Checked(BaseModel):
    """A table of an input file: no unknown keys, no silent conversions, no NaN."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _only_known_keys(cls, data: Any) -> Any:
        unknown = [key for key in data if key not in cls.model_fields] if isinstance(data, dict) else []
        if unknown and cls.model_config.get("extra") == "forbid":
            raise unexpected(_nearest(unknown[0], list(cls.model_fields)), key=unknown[0], value=data[unknown[0]])
        return data


UNSHOWN = object()  # in place of a value that is absent, or too long to help


def unexpected(expected: str, **where: Any) -> PydanticCustomError:
    """An error for a validator to raise.

    Args:
        expected: what would have been right; the sentence's end.
        where: `key`, a key below the place of the validator; `value`, what stands there, `UNSHOWN` to show none.
    """
    for key, value in where.items():  # pydantic takes UTF-8 alone
        where[key] = type(value)(printable(str(value))) if isinstance(value, str | Path) else value
    return PydanticCustomError("unexpected", "{expected}", {"expected": expected, **where})


def known_name(names: Callable[[], Iterable[str]]) -> PlainValidator:
    """A validator of text that is one of several names, which are looked up when it is called."""

    def known(value: Any) -> str:
        if not isinstance(value, str) or value not in names():
            raise unexpected(one_of(names()))
        return value

    return PlainValidator(known)


def check(model: type[Model], data: Any, file: Path) -> Model:
    """`data` as a `model`, its paths taken relative to the folder of `file`.

    Raises:
        InputError: about the first thing in `file` that is wrong.
    """
    if _deeper(data, DEEPEST):
        raise InputError(file, expected=f"fewer than {DEEPEST} tables or lists inside each other")
    try:
        return model.model_validate(data, context={"folder": file.parent})
    except ValidationError as error:
        location, value, expected = _wrong(error)
        found = "" if value is UNSHOWN else _quoted(value)
        raise InputError(file, shortened(_field(location), 200), found, expected) from None


def check_within(model: type[Model], data: Any, info: ValidationInfo) -> Model:
    """`data` as a `model` that a validator chooses, with the sentences that a field of that type would have.

    Raises:
        PydanticCustomError: `unexpected`, about the first thing that is wrong.
    """
    try:
        return model.model_validate(data, context=info.context)
    except ValidationError as error:
        location, value, expected = _wrong(error)
        key = {"key": _field(location)} if location else {}
        raise unexpected(expected, value=value, **key) from None


def require_plain(data: Any, file: Path, field: str = "") -> None:
    """Refuse texts with control characters or halves of characters, wherever they stand in what `check` has passed.

    Raises:
        InputError: about the first of them.
    """
    if isinstance(data, str) and printable(data) != data:
        raise InputError(file, field, _quoted(data), f"a text {PLAIN}")
    if isinstance(data, dict):
        for key, value in data.items():
            require_plain(value, file, f"{field}.{key}".removeprefix("."))
    if isinstance(data, list):
        for index, value in enumerate(data):
            require_plain(value, file, f"{field}[{index}]")


def _deeper(data: Any, depth: int) -> bool:
    """Whether more tables and lists than that stand inside each other; without recursion, which would end first."""
    level = [data]
    for _ in range(depth):
        nested = [each.values() if isinstance(each, dict) else each for each in level if isinstance(each, dict | list)]
        level = [each for values in nested for each in values]
    return bool(level)


def _existing(path: Path, info: ValidationInfo) -> Path:
    try:
        found = (info.context or {}).get("folder", Path()) / path.expanduser()
        there = found.exists()
    except (RuntimeError, OSError, ValueError):  # no user's home, a name too long, a zero byte
        raise unexpected("a file or folder that exists", value=shortened(str(path))) from None
    if not there:
        raise unexpected("a file or folder that exists", value=found)
    if has_controls(str(found)):
        raise unexpected(f"a path {PLAIN}", value=shortened(str(found)))
    kind = special(found)
    if kind is not None:
        raise unexpected(f"a regular file, not {kind}", value=found)
    return found


def existing_path(path: Any, folder: Path) -> Path | None:
    """The file or folder of that name in `folder`, as `ExistingPath` finds it; None for whatever that would refuse."""
    try:
        found = folder / Path(path).expanduser()
        return found if found.exists() and special(found) is None else None
    except (TypeError, RuntimeError, OSError, ValueError):
        return None


def existing_file(path: Any, folder: Path) -> Path | None:
    """The file of that name in `folder`, as `ExistingFile` finds it; None for whatever that would refuse."""
    found = existing_path(path, folder)
    return found if found is not None and found.is_file() else None


def _file(path: Path) -> Path:
    if path.is_dir():
        raise unexpected("a file, not a folder", value=path)
    return path


def _plain(text: str) -> str:
    if has_controls(text):
        raise unexpected(f"a text {PLAIN}", value=text)
    return text


PlainText = Annotated[str, AfterValidator(_plain)]
ExistingPath = Annotated[Path, Strict(False), AfterValidator(_existing)]
ExistingFile = Annotated[ExistingPath, AfterValidator(_file)]
Vector = Annotated[tuple[float, float, float], Strict(False)]


def one_of(names: Iterable[str]) -> str:
    """'one', 'two' or 'three', as pydantic lists literals."""
    *others, last = map(repr, names)
    return f"{', '.join(others)} or {last}" if others else last


def _nearest(key: str, known: Sequence[str]) -> str:
    nearest = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
    return f"a known key, the nearest is {nearest[0]}" if nearest else f"one of the keys {', '.join(known)}"


MISSING = "a value here, but it is missing"
_EXPECTED = {
    "missing": MISSING,
    "model_type": "a table",
    "tuple_type": "a list",
    "too_short": "at least one entry",
    "too_long": "fewer entries",
    "bool_type": "true or false",
    "float_type": "a number",
    "float_parsing": "a number",
    "string_type": "a text in quotes",
    "path_type": "a path in quotes",
}


def _wrong(error: ValidationError) -> tuple[list[int | str], Any, str]:
    """The first thing that is wrong, in our words: where, the value or `UNSHOWN`, and what was expected."""
    first: ErrorDetails = error.errors(include_url=False)[0]
    told = first.get("ctx", {})
    location = [*first["loc"], *([told["key"]] if "key" in told else [])]
    value = UNSHOWN if first["type"] == "missing" else told.get("value", first["input"])
    expected = _EXPECTED.get(first["type"]) or first["msg"].removeprefix("Input should be ")
    return location, value, expected


def _field(location: Sequence[int | str]) -> str:
    """("photographs", 0, "camera") as photographs[0].camera."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in location).removeprefix(".")


def _quoted(value: Any) -> str:
    """A value as the user wrote it, or its beginning."""
    try:
        text = f'"{value}"' if isinstance(value, str) else as_written(value)
    except ValueError:  # Python writes no int of more than 4300 digits
        text = "a number of thousands of digits"
    return shortened(text, 200)


def shortened(text: str, length: int = 80) -> str:
    """A printable text in one line, or its beginning."""
    line = printable(text)
    return line if len(line) <= length else f"{line[: length - 1]}…"


def _rigid(rows: tuple[Row, Row, Row, Row]) -> tuple[Row, Row, Row, Row]:
    matrix = np.array(rows)
    rotation = matrix[:3, :3]
    with np.errstate(over="ignore", invalid="ignore"):  # not near 1 anyway
        turned = np.abs(rotation @ rotation.T - np.eye(3)).max()
    if not turned <= 1e-4 or np.linalg.det(rotation) < 0 or np.abs(matrix[3] - [0, 0, 0, 1]).max() > 1e-4:
        raise unexpected("a rigid motion: an orthonormal right-handed rotation, and 0 0 0 1 in the last row")
    return rows


Row = Annotated[tuple[float, float, float, float], Strict(False)]
RigidMotion = Annotated[tuple[Row, Row, Row, Row], Strict(False), AfterValidator(_rigid)]
