"""The library Mitsuba, which loads its own plugins only."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any


@cache
def mitsuba_library() -> Any:
    """The module `mitsuba`; to be imported by nothing else in the program.

    Mitsuba looks for `plugins/NAME.so`, which it runs, and for its tables of spectra and skies in the working folder
    first, and in its own after that. Here it has its own alone, in all threads and variants. A name that it has no
    plugin for is still looked for in the working folder: no such name may come from a file.
    """
    import mitsuba

    mi: Any = mitsuba
    resolver = mi.file_resolver()
    resolver.clear()
    resolver.append(str(Path(str(mi.__file__)).resolve().parent))
    return mi
