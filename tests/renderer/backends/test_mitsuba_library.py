"""Mitsuba loads its own plugins, whatever lies in the folder that the program is started in."""

import os
import subprocess
import sys

import pytest

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.mitsuba.conversion import mitsuba
from tests.project.test_imports import FILES, imported, top
from tests.support.hostile import MARK, hostile_plugins

SMALL = ["--size", "16", "--spp", "4", "--views", "2"]
IN_THREADS = """
import threading
from fit_material.renderer.mitsuba.conversion import mitsuba
mi = mitsuba("{variant}")
thread = threading.Thread(target=lambda: print(mi.load_dict({{"type": "sphere"}}).bbox()))
thread.start()
thread.join()
print(mi.load_dict({{"type": "roughconductor"}}))
"""


@pytest.fixture
def hostile(tmp_path):
    """A working folder with a hostile library for each plugin's name."""
    hostile_plugins(tmp_path, tmp_path / MARK)
    return tmp_path


def run(folder, *arguments: str) -> str:
    """What Python prints, started in that folder; it ends well."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, *arguments]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.dr_jit
@pytest.mark.parametrize("variant", ["scalar_rgb", "llvm_ad_rgb"])
def test_threads_of_every_variant_load_mitsuba_s_own_plugins(hostile, variant):
    try:
        mitsuba(variant)
    except InputError:
        pytest.skip("no LLVM on this machine")
    assert "RoughConductor" in run(hostile, "-c", IN_THREADS.format(variant=variant))
    assert not (hostile / MARK).exists()


@pytest.mark.parametrize("surroundings", [pytest.param("studio", marks=pytest.mark.slow), "sunsky"])
def test_synth_and_plan_load_mitsuba_s_own_plugins(hostile, surroundings):
    run(hostile, "-m", "fit_material", "synth", "--metal", "Au", *SMALL, "--env", surroundings, "-o", "made", "--quiet")
    assert (hostile / "made" / "scene.toml").is_file()
    run(
        hostile,
        "-c",
        "from fit_material.fitter.commands.app import app; app(['plan', 'made/scene.toml'], standalone_mode=False)",
    )
    assert not (hostile / MARK).exists()


def test_one_module_alone_imports_mitsuba():
    assert {name for name in FILES if "mitsuba" in top(imported(name))} == {
        "fit_material.renderer.backends.mitsuba_library"
    }
