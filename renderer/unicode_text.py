"""Text that files in UTF-8 can hold."""

from __future__ import annotations


def unicode_text(text: str) -> str:
    """`text` with `\\udcHH` written out for what UTF-8 has no bytes for.

    Python's names of files hold such characters where the bytes of a name are no UTF-8; JSON may hold them anywhere.
    """
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def is_unicode(text: str) -> bool:
    """Whether UTF-8 has bytes for all of `text`."""
    return unicode_text(text) == text
