"""The code's name: the same wherever the same code lies, another for other code."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from fit_material.fitter.result.provenance import code_digest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture
def installed(tmp_path) -> Path:
    """The packages laid out as a wheel has them."""
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["setuptools"]
    for package in listed["packages"]:
        source, target = (folder / package.replace(".", "/") for folder in (ROOT, tmp_path))
        target.mkdir()
        for pattern in ("*.py", *listed["package-data"].get(package, ())):
            for path in source.glob(pattern):
                shutil.copy(path, target)
    return tmp_path


def digest_of(folder: Path) -> str:
    """As a process of its own says that imports from there."""
    code = "from fitter import code_digest as module; print(module.__file__, module.code_digest())"
    done = subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, check=True, cwd=folder)
    where, digest = done.stdout.split()
    assert Path(where).parents[1] == folder
    return digest


def test_installed_code_has_the_name_of_its_source(installed):
    assert digest_of(installed) == code_digest()


@pytest.mark.parametrize("changed", ["shaders/optics/fresnel.py", "renderer/viewer/eye.py", "fitter/metals.csv"])
def test_a_line_more_is_another_name(installed, changed):
    before = digest_of(installed)
    with open(installed / changed, "a", encoding="utf-8") as file:
        file.write("# one more\n")
    assert digest_of(installed) != before
