"""Pictures around the model as a sequence of PNG files, and numbered names for pictures."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from pathlib import Path

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.atomic import replaced_together
from fit_material.renderer.files.replaceable import ANYTHING, Replaceable
from fit_material.renderer.images.image_file import png
from fit_material.renderer.viewer.display import Codes
from fit_material.renderer.viewer.eye import Eye, orbit

FRAMES = 72  # three seconds of film
MOST_FRAMES = 100_000


def turntable(
    directory: Path, eye: Eye, frames: int, draw: Callable[[Eye], Codes], replaceable: Replaceable = ANYTHING
) -> Iterator[int]:
    """Write frame_000.png …, each from a camera a step further round the target, all at the end together.

    A generator, so that a window can answer between two frames; closed before its end, it leaves nothing behind.

    Args:
        directory: where to; made if need be.
        eye: of the first frame. The last frame is one step short of it, so that the film can be repeated.
        frames: how many.
        draw: the picture from an eye.
        replaceable: which files of `directory` may be replaced.

    Yields:
        The number of frames that are drawn.

    Raises:
        InputError: the number is out of range, the folder cannot be written, frames of another, longer turntable are in
            it, or a file that may not be replaced.
    """
    if not 2 <= frames <= MOST_FRAMES:
        raise InputError("--frames", value=frames, expected=f"2 to {MOST_FRAMES}")
    names = [f"frame_{index:0{max(3, len(str(frames - 1)))}}.png" for index in range(frames)]
    others = sorted({path.name for path in directory.glob("frame_*.png")} - {*names})
    if others:
        raise InputError("--turntable", value=directory, expected=f"a folder without another film's {others[0]}")
    replaceable.require(directory, names, "--turntable")
    with replaced_together(directory, last=names[-1], option="--turntable", replaceable=replaceable) as folder:
        for index, name in enumerate(names):
            (folder / name).write_bytes(png(draw(orbit(eye, 2 * math.pi * index / frames, 0.0))))
            yield index + 1


def free_name(folder: Path, stem: str, *endings: str) -> Path:
    """The first of stem-001, stem-002 … in `folder` that none of the endings makes a file that is there."""
    for number in itertools.count(1):
        path = folder / f"{stem}-{number:03}"
        if not any(path.with_name(path.name + ending).exists() for ending in endings):
            return path
    raise AssertionError
