"""`python -m tests.bench [agreement] [recovery] [real] [real-SHAPE]`: prints Markdown; without names the first two."""

from __future__ import annotations

import sys
from functools import partial

from tests.bench import agreement, recovery, types
from tests.bench.photographs import SHAPES
from tests.bench.setting import SHARED, header, mitsuba_variant

PARTS = {
    "agreement": ("Agreement with Mitsuba", agreement.rows),
    "recovery": ("Recovery and cost of the fit command", recovery.command_rows),
    "types": ("Recovery and choice of the type", types.rows),
    "real": ("Recovery under real environments", recovery.real_rows),
    **{
        f"real-{shape}": (f"Recovery under real environments: {shape}", partial(recovery.real_rows, shapes=(shape,)))
        for shape in SHAPES
    },
}


def main() -> None:
    """Run the parts that are named."""
    names = sys.argv[1:] or ["agreement", "recovery"]
    unknown = set(names) - set(PARTS)
    if unknown or not SHARED.is_dir():
        sys.exit(f"bench: unknown {', '.join(sorted(unknown))}" if unknown else f"bench: needs {SHARED}")
    variant = mitsuba_variant()
    print(header(), flush=True)
    for name in names:
        title, rows = PARTS[name]
        print(f"## {title}\n", flush=True)
        for row in rows(variant):
            print(row, flush=True)
        print(flush=True)


if __name__ == "__main__":
    main()
