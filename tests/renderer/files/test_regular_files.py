"""Files that never end, that wait for somebody, or that no memory holds: refused in one sentence, at once."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from fit_material.renderer.compute import memory
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.regular_files import read_text
from fit_material.renderer.geometry.mesh import FORMATS, read_mesh
from fit_material.renderer.images.image_file import read_image
from fit_material.renderer.materials.mtl_reader import read_mtl
from fit_material.renderer.scene.scene_file import read_scene
from tests.project.test_imports import FILES
from tests.support.special_files import KEYS


@pytest.fixture(scope="module")
def sentences(tmp_path_factory) -> dict[str, str]:
    """What every reader says of a pipe and of /dev/zero; a process of its own, whose memory and time are limited."""
    command = [sys.executable, "-m", "tests.support.special_files", str(tmp_path_factory.mktemp("special"))]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
    return json.loads(done.stdout)


@pytest.mark.parametrize(("special", "called"), [("pipe", "a named pipe"), ("zero", "a device")])
def test_no_reader_opens_a_pipe_or_a_device(sentences, special, called):
    found = {name: said for name, said in sentences.items() if name.endswith(f" {special}")}
    assert len(found) > 30
    for name, said in found.items():
        if "scene's" not in name:
            assert said.endswith(f": is {called}, expected a regular file"), name


@pytest.mark.parametrize(("special", "called"), [("pipe", "a named pipe"), ("zero", "a device")])
@pytest.mark.parametrize("key", KEYS)
def test_a_scene_file_names_none_either(sentences, special, called, key):
    said = sentences[f"scene's {key} {special}"]
    assert said.startswith("scene.toml: ")
    assert said.endswith(f": is a-{key}.png, expected a regular file, not {called}")


@pytest.mark.parametrize(
    ("name", "read"),
    [*((f"a{ending}", read_mesh) for ending in FORMATS), ("a.mtl", read_mtl), ("scene.toml", read_scene)],
)
def test_a_file_that_memory_does_not_hold_is_not_read(name, read, tmp_path):
    """A hole of a terabyte takes no room on the disk."""
    path = tmp_path / name
    with path.open("wb") as file:
        file.truncate(10**12)
    with pytest.raises(InputError) as refusal:
        read(path)
    assert str(refusal.value).startswith(f"{path}: expected what fits into memory: reading it takes 1e+03 GB, and ")
    assert str(refusal.value).endswith(" GB are free")


UNGATED = {
    "fit_material.renderer.files.regular_files": "the gate itself",
    "fit_material.renderer.backends.llvm": "the proof beside it, /proc/cpuinfo, and its own cache",
    "fit_material.renderer.compute.memory": "/proc and /sys",
    "fit_material.fitter.batch.fits_log": "of a regular file 64 KiB at most",
    "fit_material.renderer.files.unfinished": "/proc and /etc/machine-id",
    "fit_material.renderer.opengl.programs": "shaders of this package",
    "fit_material.fitter.result.provenance": "modules of this package",
    "fit_material.renderer.files.digests": "a regular file in pieces",
}


def reads_whole_files(path: Path) -> bool:
    """Whether a module calls a path's `read_bytes` or `read_text`, or Python's `open`, but for writing."""
    calls = [node for node in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(node, ast.Call)]
    methods = {call.func.attr for call in calls if isinstance(call.func, ast.Attribute)}
    opened = [call for call in calls if isinstance(call.func, ast.Name) and call.func.id == "open"]
    return bool(methods & {"read_bytes", "read_text"}) or any(_mode(call)[0] not in "wax" for call in opened)


def _mode(call: ast.Call) -> str:
    given = [*call.args[1:2], *(each.value for each in call.keywords if each.arg == "mode")]
    return next((str(each.value) for each in given if isinstance(each, ast.Constant)), "r")


def test_files_of_users_are_read_behind_the_gate():
    assert {name for name, path in FILES.items() if reads_whole_files(path)} == UNGATED.keys()


@pytest.mark.parametrize("name", ["a.hdr"])
def test_a_picture_with_a_terabyte_behind_it_is_not_read(name, tmp_path):
    path = tmp_path / name
    path.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 2\n")
    with path.open("r+b") as file:
        file.truncate(10**12)
    with pytest.raises(InputError) as refusal:
        read_image(path)
    assert str(refusal.value).startswith(f"{path}: expected what fits into memory: reading it takes 1e+03 GB, and ")


def test_text_is_read_as_python_reads_it(tmp_path):
    path = tmp_path / "a.txt"
    path.write_bytes(b"\xef\xbb\xbfa\r\nb\rc\n\n\xc3\xbc")
    assert read_text(path, "utf-8-sig") == path.read_text("utf-8-sig")


def test_the_memory_that_is_free_is_no_more_than_a_limit_leaves():
    """By a process that has such a limit."""
    code = (
        "import resource; resource.setrlimit(resource.RLIMIT_AS, (10**9, 10**9));"
        "from fit_material.renderer.compute.memory import available_memory; print(available_memory())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert 0 < int(done.stdout) < 10**9


VERSION_1 = {"memory.limit_in_bytes": "1000", "memory.usage_in_bytes": "700", "memory.stat": "total_inactive_file 50\n"}
VERSION_2 = {"memory.max": "1000", "memory.current": "700", "memory.stat": "anon 1\ninactive_file 50\n"}
BOUNDLESS = {"memory.max": "max", "memory.current": "1", "memory.stat": "inactive_file 0\n"}


@pytest.mark.parametrize(
    ("groups", "folder", "files"),
    [
        ("0::/mine/below\n", "mine", VERSION_2),
        ("0::/\n", ".", VERSION_2),
        ("4:memory:/docker/1f\n1:cpu:/\n0::/\n", "memory", VERSION_1),
        ("4:memory:/docker/1f\n", "memory/docker/1f", VERSION_1),
    ],
)
def test_a_control_group_leaves_its_limit_less_what_is_used_but_for_cached_files(groups, folder, files, tmp_path):
    (tmp_path / "cgroup").write_text(groups)
    (tmp_path / "root" / folder).mkdir(parents=True)
    for name, text in files.items():
        (tmp_path / "root" / folder / name).write_text(text)
    (tmp_path / "root" / "mine" / "below").mkdir(parents=True, exist_ok=True)
    for name, text in BOUNDLESS.items():
        (tmp_path / "root" / "mine" / "below" / name).write_text(text)
    assert list(memory.control_groups(tmp_path, tmp_path / "root")) == [350]


def test_no_control_groups_leave_no_limit(tmp_path):
    assert list(memory.control_groups(tmp_path, tmp_path)) == []
    assert list(memory.control_group_limits(tmp_path, tmp_path)) == []


@pytest.mark.parametrize(
    ("groups", "files", "limits"),
    [
        ("0::/a/b\n", {"a/b/memory.max": "max", "a/memory.max": "5000", "memory.max": "9000"}, {5000, 9000}),
        ("0::/\n", {"memory.max": "7000"}, {7000}),
        ("4:cpu:/x\n9:memory,hugetlb:/a\n", {"memory/a/memory.limit_in_bytes": "6000", "x/memory.max": "1"}, {6000}),
        ("9:memory:/docker/0a1b\n", {"memory/memory.limit_in_bytes": "8000", "memory.max": "1"}, {8000}),
    ],
    ids=["version 2", "version 2, a container", "version 1", "version 1, a container"],
)
def test_a_control_group_limits_memory_whatever_is_used_of_it(tmp_path, groups, files, limits):
    for name, text in files.items():
        path = tmp_path / "root" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text + "\n")
    (tmp_path / "cgroup").write_text(groups)
    assert set(memory.control_group_limits(tmp_path, tmp_path / "root")) == limits


def test_the_limit_of_memory_is_the_machine_s_or_a_smaller_one_of_a_control_group(monkeypatch):
    monkeypatch.setattr(memory, "control_group_limits", lambda: iter([]))
    machine = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    assert memory.memory_limit() == pytest.approx(machine, rel=1e-6)
    monkeypatch.setattr(memory, "control_group_limits", lambda: iter([2**62, 12345]))
    assert memory.memory_limit() == 12345
