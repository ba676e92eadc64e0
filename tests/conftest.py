"""What several test modules share."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from hypothesis import settings

# several tests run at once, and the machine is shared: operations that wait for other cores wait long
torch.set_num_threads(1)

# the same examples on every machine, however slow the first call that compiles or imports something
settings.register_profile("steady", deadline=None, derandomize=True)
settings.load_profile("steady")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Real input kept beside the repository, where there is any."""
    folder = Path(__file__).resolve().parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("../shared/data is absent")
    return folder


@pytest.fixture(scope="session")
def gl():
    """An OpenGL context without a window."""
    from renderer.errors import InputError
    from renderer.viewer.context import offscreen_context

    try:
        return offscreen_context()
    except InputError as error:
        pytest.skip(str(error))
