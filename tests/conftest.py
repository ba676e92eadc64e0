"""What several test modules share."""

from __future__ import annotations

import os
import shutil
import signal
from pathlib import Path

import pytest
import torch
from hypothesis import settings

from fit_material.renderer.backends import dr_jit
from tests.support.paths import SHARED

if hasattr(signal, "SIGHUP"):
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # `nohup` has it ignored, also by what tests begin
dr_jit.prepare()  # before there are threads; processes that tests start inherit the choice, and say nothing of it
# several tests run at once, and the machine is shared: operations that wait for other cores wait long
torch.set_num_threads(1)

# the same examples on every machine, however slow the first call that compiles or imports something; `make stress` has
# more of them, and other ones each time
settings.register_profile("steady", deadline=None, derandomize=True)
settings.register_profile("long", deadline=None, max_examples=int(os.environ.get("EXAMPLES", "1000")), print_blob=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "steady"))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Real input kept beside the repository, where there is any."""
    if not SHARED.is_dir():
        pytest.skip("../shared/data is absent")
    return SHARED


@pytest.fixture(scope="session")
def gl():
    """An OpenGL context without a window."""
    from fit_material.renderer.errors.input_error import InputError
    from fit_material.renderer.opengl.context import offscreen_context

    try:
        return offscreen_context()
    except InputError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def gold_photographs(tmp_path_factory) -> Path:
    """Folder of a small scene of gold."""
    from fit_material.renderer.materials.catalogue import metal
    from fit_material.renderer.materials.ground_truth import TrueMetal
    from fit_material.renderer.synthesis.synthesise import SynthOptions, synthesise

    gold = metal("Au")
    options = SynthOptions(TrueMetal(gold.n, gold.k, alpha=0.25), size=40, spp=256, views=2)
    return synthesise(options, tmp_path_factory.mktemp("photographs")).parent


@pytest.fixture
def gold_scene(gold_photographs, tmp_path) -> Path:
    """A copy of the small scene, to spoil."""
    return Path(shutil.copytree(gold_photographs, tmp_path / "scene")) / "scene.toml"


@pytest.fixture
def mtl(tmp_path):
    """Writes a material file and reads it."""
    from fit_material.renderer.materials.mtl_reader import read_mtl

    def read(text: str | bytes, name="a.mtl", **options):
        (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_mtl(tmp_path / name, **options)

    return read
