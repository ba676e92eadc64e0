"""The code's name: the same wherever the same code lies, another for other code."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from fit_material.fitter.result.provenance import code_digest
from tests.support.paths import ROOT


@pytest.fixture
def installed(tmp_path) -> Path:
    """The package as files of its own, as a wheel has them."""
    package = tmp_path / "fit_material"
    shutil.copytree(ROOT / "src" / "fit_material", package, ignore=shutil.ignore_patterns("__pycache__"))
    return package


def digest_of(package: Path) -> str:
    """As a process of its own says that imports from there."""
    code = "from fit_material.fitter.result import provenance as module; print(module.__file__, module.code_digest())"
    done = subprocess.run(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, check=True, cwd=package.parent
    )
    where, digest = done.stdout.split()
    assert Path(where).parents[2] == package
    return digest


def test_installed_code_has_the_name_of_its_source(installed):
    assert digest_of(installed) == code_digest()


@pytest.mark.parametrize(
    "changed", ["shaders/optics/fresnel.py", "renderer/viewer/eye.py", "renderer/materials/metals.csv"]
)
def test_a_line_more_is_another_name(installed, changed):
    before = digest_of(installed)
    with open(installed / changed, "a", encoding="utf-8") as file:
        file.write("# one more\n")
    assert digest_of(installed) != before
