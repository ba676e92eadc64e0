"""Entries by name: one table of each kind of thing that may be added to."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Protocol, TypeVar


class Named(Protocol):
    """What a registry holds."""

    @property
    def name(self) -> str:
        """As files and the command line have it."""
        ...


T = TypeVar("T", bound=Named)


class Registry(Mapping[str, T]):
    """A mapping from names to entries, in the order of the entries.

    Closed for users: nothing adds to it while the program runs, so that files, schemas and tables always agree. Open
    for tests: `tests.support.registries.added` adds an entry for the length of a test.
    """

    def __init__(self, *entries: T) -> None:
        self._entries = {entry.name: entry for entry in entries}
        if len(self._entries) < len(entries):
            raise ValueError("two entries of one name")

    def __getitem__(self, name: str) -> T:
        return self._entries[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)
