"""Text from files, on its way to people or into files: what steers terminals or cannot be written is spelled out."""

from __future__ import annotations

import re

_CONTROLS = "\x00-\x1f\x7f-\x9f\u2028\u2029"  # C0, DEL, C1, and separators of lines and paragraphs
_NO_CHARACTERS = "\ud800-\udfff\ufffe\uffff"
_CONTROL = re.compile(f"[{_CONTROLS}]")
_UNPRINTABLE = re.compile(f"[{_CONTROLS}{_NO_CHARACTERS}]")
_UNPRINTABLE_WITHIN_LINES = re.compile(rf"(?!\n)[{_CONTROLS}{_NO_CHARACTERS}]")


def printable(text: str) -> str:
    r"""A text in one line, in which control characters and halves of characters are spelled out: \n, \x1b, \ud800."""
    return _UNPRINTABLE.sub(_spelled, text)


def printable_lines(text: str) -> str:
    """As `printable`, of a text that has lines of its own."""
    return _UNPRINTABLE_WITHIN_LINES.sub(_spelled, text)


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


def _spelled(found: re.Match[str]) -> str:
    code = ord(found[0])
    return ascii(found[0])[1:-1] if code < 0x7F else f"\\u{code:04x}"  # as JSON has it, which the text may be
