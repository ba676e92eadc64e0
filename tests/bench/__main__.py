"""`python -m tests.bench [PART …]`: prints Markdown; without names the parts in `USUAL`. An unknown name lists all."""

from __future__ import annotations

import os
import sys
from functools import partial

from renderer.to_mitsuba import variant_here
from tests.bench import agreement, frame, loop, parity, recovery, types
from tests.bench.photographs import SHAPES
from tests.bench.setting import SHARED, header

PARTS = {
    "agreement": ("Agreement with Mitsuba", agreement.rows),
    "recovery": ("Recovery and cost of the fit command", recovery.command_rows),
    "types": ("Recovery and choice of the type", types.rows),
    "types-4096": ("Recovery and choice of the type, less noise", partial(types.rows, spp=4096)),
    "loop": ("From photographs to the viewer's picture", loop.rows),
    "parity": ("GLSL against torch", parity.rows),
    "frame": ("Time of a picture", frame.rows),
    "real": ("Recovery under real environments", recovery.real_rows),
    **{
        f"real-{shape}": (f"Recovery under real environments: {shape}", partial(recovery.real_rows, shapes=(shape,)))
        for shape in SHAPES
    },
}
USUAL = ("agreement", "recovery", "types", "loop", "parity", "frame")


def main() -> None:
    """Run the parts that are named."""
    names = sys.argv[1:] or USUAL
    unknown = set(names) - set(PARTS)
    if unknown or not SHARED.is_dir():
        listed = f"unknown {', '.join(sorted(unknown))}; there are {', '.join(PARTS)}"
        sys.exit(f"bench: {listed}" if unknown else f"bench: needs {SHARED}")
    os.environ.setdefault(frame.THREADS, "1")  # llvmpipe reads it once, when the first part makes a context
    variant = variant_here()
    print(header(), flush=True)
    for name in names:
        title, rows = PARTS[name]
        print(f"## {title}\n", flush=True)
        for row in rows(variant):
            print(row, flush=True)
        print(flush=True)


if __name__ == "__main__":
    main()
