"""The one exception that a user's mistake raises; everything else is a bug of ours."""

from __future__ import annotations

from pathlib import Path

from fit_material.renderer.errors.printable import printable


class InputError(Exception):
    """Wrong input, in one sentence: which file, which field, the value, what was expected.

    Args:
        file: the file at fault, or a command-line option such as `--alpha`.
        field: the field inside it, such as `photographs[2].image`; empty for the file as a whole.
        value: what was found there; empty where there is no value to show.
        expected: what would have been right, and the remedy where there is one.
    """

    def __init__(self, file: str | Path, field: str = "", value: object = "", expected: str = "") -> None:
        self.file, self.field, self.value, self.expected = str(file), field, value, expected
        where = f"{self.file}: {field}" if field else self.file
        found = f" is {as_written(value)}," if str(value) else ""
        told = expected.replace("\n", " ")
        super().__init__(printable(f"{where}:{found} expected {told}"))


def as_written(value: object) -> str:
    """A value's text, of a tuple as the list that files have."""
    return str(list(value) if isinstance(value, tuple) else value)
