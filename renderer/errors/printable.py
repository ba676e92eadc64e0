"""Text from files, on its way to people or into files: what steers terminals or cannot be written is spelled out."""

from __future__ import annotations

import json
import re
import unicodedata

_CONTROL = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029]")  # C0, DEL, C1, and separators of lines and paragraphs


def printable(text: str) -> str:
    r"""A text in one line; characters that are not visible are spelled out: \n, \x1b, \ufeff, \u202e, \ud800."""
    return "".join(each if each.isprintable() else _spelled(each) for each in text)


def printable_lines(text: str) -> str:
    """As `printable`, of a text that has lines, and spaces of all widths, of its own."""
    return "".join(each if each == "\n" or _is_seen(each) else _spelled(each) for each in text)


def has_controls(text: str) -> bool:
    """Whether a control character, or one that ends a line, is in it."""
    return _CONTROL.search(text) is not None


def unicode_text(text: str) -> str:
    """`text` with `\\udcHH` written out for what UTF-8 has no bytes for.

    Python's names of files hold such characters where the bytes of a name are no UTF-8; JSON may hold them anywhere.
    """
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def is_unicode(text: str) -> bool:
    """Whether UTF-8 has bytes for all of `text`."""
    return unicode_text(text) == text


def _is_seen(character: str) -> bool:
    return character.isprintable() or unicodedata.category(character) == "Zs"


def _spelled(character: str) -> str:
    """As Python has it below 0x7F, as JSON above, which the text may be."""
    return ascii(character)[1:-1] if ord(character) < 0x7F else json.dumps(character)[1:-1]
