"""TOML files."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.regular_files import read_text


def load_toml(path: Path, what: str = "scene file") -> dict[str, Any]:
    """The tables of a TOML file; `what` names it where there is none.

    Raises:
        InputError: it cannot be read, or is no TOML.
    """
    try:
        return tomllib.loads(read_text(path, "utf-8-sig"))  # Windows begins UTF-8 with a mark
    except tomllib.TOMLDecodeError as error:
        told = re.fullmatch(r"(?P<reason>.*) \(at (?P<place>.*)\)", str(error), re.DOTALL)
        reason, place = told.group("reason", "place") if told else (str(error), "")
        raise InputError(path, place, expected=f"TOML ({reason})") from None
    except RecursionError:
        raise InputError(path, expected="TOML without hundreds of tables inside each other") from None
    except (OSError, ValueError) as error:
        reason = "there is none" if isinstance(error, FileNotFoundError) else error
        raise InputError(path, expected=f"a readable {what} here ({reason})") from None
