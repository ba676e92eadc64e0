"""What a library needs when it is first imported, wherever that is: some stop or chatter if left alone."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable, Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

Execute = Callable[[ModuleType], None]
Around = Callable[[Execute, ModuleType], None]


def at_first_import(name: str, execute: Around, prepare: Callable[[], None] | None = None) -> None:
    """Nothing where the library is there already; may be called again.

    Args:
        name: of the library's top package.
        execute: runs its code, given Python's own way to do so and the module to fill.
        prepare: is called before it is looked for, and again at the next import if it raised.
    """
    waiting = any(isinstance(finder, _Finder) and finder.name == name for finder in sys.meta_path)
    if name not in sys.modules and not waiting:
        sys.meta_path.insert(0, _Finder(name, execute, prepare))


class _Finder(MetaPathFinder):
    """Finds the library as Python would, once."""

    def __init__(self, name: str, execute: Around, prepare: Callable[[], None] | None) -> None:
        self.name, self._execute, self._prepare = name, execute, prepare

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name != self.name:
            return None
        if self._prepare is not None:
            self._prepare()
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(name)
        if spec is not None and spec.loader is not None:
            usual = spec.loader.exec_module
            spec.loader.exec_module = lambda module: self._execute(usual, module)
        return spec
