"""Photographs that are read one at a time: what is kept of them, and how much memory they take together."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
import weakref
from pathlib import Path

import numpy as np
import pytest
import torch

from fit_material.fitter.observations import album as album_module
from fit_material.fitter.observations.album import FULL_SIZE, Album, thumbnail_side
from fit_material.fitter.observations.photograph import Photograph
from fit_material.fitter.observations.scene_data import load
from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.images.image_file import write_exr
from fit_material.renderer.rays.picture import LARGEST_SIDE

HEIGHT, WIDTH = 4, 6
BYTES = HEIGHT * WIDTH * (3 * 4 + 1)


def photograph(index: int, height: int = HEIGHT, width: int = WIDTH) -> Photograph:
    radiance = torch.full((height, width, 3), float(index))
    mask = torch.rand(height, width, generator=torch.Generator().manual_seed(index)) < 0.5
    return Photograph(f"view_{index}", radiance, mask, Camera(torch.eye(4), width, height), 2.0, 3, 4)


class Reader:
    """Reads a photograph, and counts how often it did and whether somebody still holds what it read."""

    def __init__(self, index: int) -> None:
        self.index, self.times, self.made = index, 0, weakref.WeakSet()

    def __call__(self) -> Photograph:
        self.times += 1
        made = photograph(self.index)
        self.made.add(made.radiance)
        return made


@pytest.mark.parametrize(("kept", "held"), [(0, 0), (BYTES - 1, 0), (BYTES, 1), (3 * BYTES + 1, 3), (99 * BYTES, 5)])
def test_no_more_photographs_are_held_than_may_be_kept(monkeypatch, kept, held):
    monkeypatch.setattr(album_module, "KEPT", kept)
    readers = [Reader(index) for index in range(5)]
    album = Album(readers)
    for _ in range(2):
        for index, each in enumerate(album):
            assert each.name == f"view_{index}"
            assert sum(len(reader.made) for reader in readers) <= held + 2  # the one in hand, and the one before it
        del each
    assert sum(len(reader.made) for reader in readers) == held
    assert [reader.times for reader in readers] == [1] * held + [2] * (5 - held)


def test_thumbnails_are_of_the_first_reading(monkeypatch):
    monkeypatch.setattr(album_module, "KEPT", 0)
    readers = [Reader(index) for index in range(3)]
    album = Album(readers)
    assert album[1].name == "view_1"
    assert [each.name for each in album.thumbnails] == ["view_0", "view_1", "view_2"]
    assert [each.name for each in album.thumbnails] == ["view_0", "view_1", "view_2"]
    assert [reader.times for reader in readers] == [1, 1, 1]
    assert sum(len(reader.made) for reader in readers) == 0


def test_a_thumbnail_has_every_so_many_th_pixel_and_what_is_to_be_said():
    one = photograph(1, 2 * LARGEST_SIDE + 1, 7)
    (seen,) = Album.of([one]).thumbnails
    assert seen.step == 3
    assert torch.equal(seen.mask, one.mask[::3, ::3])
    assert torch.equal(seen.radiance, one.radiance[::3, ::3])
    assert seen.radiance.untyped_storage().nbytes() == seen.radiance.nbytes  # no view of the whole
    assert (seen.name, seen.exposure, seen.clipped, seen.nonfinite) == ("view_1", 2.0, 3, 4)
    assert seen.camera == one.camera


@pytest.mark.parametrize("count", [1, 2, FULL_SIZE, FULL_SIZE + 1, 100, 1000])
def test_thumbnails_together_have_a_bounded_area(count):
    side = thumbnail_side(count)
    assert count * side**2 <= FULL_SIZE * LARGEST_SIDE**2
    assert side == LARGEST_SIDE or count > FULL_SIZE


@pytest.fixture
def scene(tmp_path):
    """Writes a scene of a ball with some photographs of one image."""

    def write(count: int, size: int = 16, image: str = "view.exr") -> Path:
        if not (tmp_path / image).exists():
            write_exr(tmp_path / image, np.ones((size, size, 3), np.float32))
        write_exr(tmp_path / "light.exr", np.ones((8, 16, 3), np.float32))
        table = f'[[photographs]]\nimage = "{image}"\n[photographs.camera]\norigin = [0, 0, 4]\ntarget = [0, 0, 0]\n'
        head = '[geometry]\nshape = "sphere"\n[environment]\nmap = "light.exr"\n'
        path = tmp_path / f"scene-{count}.toml"
        path.write_text(head + count * table)
        return path

    return write


def test_inputs_are_all_files_with_their_hashes(scene):
    path = scene(2)
    names = [path, path.with_name("light.exr"), path.with_name("view.exr"), path.with_name("view.exr")]
    expected = [(str(name), hashlib.sha256(name.read_bytes()).hexdigest()) for name in names]
    assert [(file.path, file.sha256) for file in load(path).inputs] == expected


def test_a_wrong_photograph_is_told_when_it_is_looked_at(scene):
    path = scene(2)
    loaded = load(path)
    path.with_name("view.exr").write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"view\.exr: expected a readable EXR image"):
        loaded.photographs[1]


CHILD = """
import json, sys
from pathlib import Path
from fit_material.fitter.observations import album
from fit_material.fitter.observations.scene_data import load
from fit_material.fitter.observations.pixel_request import PixelRequest
from fit_material.fitter.observations.pixel_selection import choose_pixels
from fit_material.renderer.rays import gbuffer
album.KEPT = 0
def peak():  # getrusage's is at least that of the process which began this one
    lines = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    return int(lines["VmHWM"].split()[0])
loaded = load(Path(sys.argv[1]))
before = peak()
found, = choose_pixels(PixelRequest(loaded.photographs, gbuffer.tracer(loaded.shape), Path("s.toml"), 2, seed=0), 100)
thumbnails = loaded.photographs.thumbnails
print(json.dumps([len(found.radiance), len(thumbnails), peak() - before]))
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="only Linux tells a process's own peak")
def test_memory_does_not_grow_with_the_number_of_photographs(scene, tmp_path):
    """A whole process each; 2 and 32 photographs of 1.5 megapixels, 19.5 MB each, of which none is kept.

    Held, thirty more take 585 MB more. Of streamed ones thirty thumbnails remain, 306² · 13 B = 1.2 MB each, and what
    the allocator keeps of freed blocks, which does not add up, three photographs at most: less than a third of that.
    """
    one = 1224**2 * 13 / 1024  # kB
    np.save(tmp_path / "view.npy", np.ones((1224, 1224, 3), np.float32))
    grown = [_grown(scene(count, image="view.npy"), count) for count in (2, 32)]
    assert grown[0] > one  # the one that is looked at
    assert grown[1] - grown[0] < 30 * one / 3


def _grown(path: Path, count: int) -> int:
    """Peak memory beyond that of the imports, kB."""
    run = subprocess.run([sys.executable, "-c", CHILD, str(path)], capture_output=True, text=True, check=True)
    pixels, thumbnails, grown = json.loads(run.stdout)
    assert (pixels, thumbnails) == (100, count)
    return grown
