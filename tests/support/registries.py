"""Registries, opened for a test."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from fit_material.shaders.registry.registry import Registry, T


@contextmanager
def added(registry: Registry[T], entry: T) -> Iterator[None]:
    """The registry with one more entry, for as long as the context lasts."""
    assert entry.name not in registry, "an entry of the program may not be replaced"
    registry._entries[entry.name] = entry
    try:
        yield
    finally:
        del registry._entries[entry.name]
