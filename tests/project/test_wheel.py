"""The installed package lives beside PyPI's `fitter` and `renderer`, whatever is installed first."""

from __future__ import annotations

import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

from tests.support.paths import ROOT, SOURCE

PARTS = ("fitter", "renderer", "shaders")


def run(*command: str | Path, **options) -> subprocess.CompletedProcess[str]:
    return subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False, **options)


def test_the_package_has_one_name_and_three_links():
    links = {path.name: path.resolve() for path in (SOURCE / "fit_material").iterdir() if path.is_symlink()}
    assert links == {name: ROOT / name for name in PARTS}
    assert [path.name for path in SOURCE.iterdir() if (path / "__init__.py").exists()] == ["fit_material"]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    if run(sys.executable, "-m", "pip", "index", "versions", "setuptools").returncode:
        pytest.skip("no package index can be reached, from which to build")
    done = run(sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", folder, ROOT)
    assert done.returncode == 0, done.stderr
    (made,) = folder.glob("*.whl")
    return made


@pytest.mark.slow
def test_a_wheel_holds_all_that_is_read_and_no_other_name(wheel):
    names = [Path(name) for name in zipfile.ZipFile(wheel).namelist()]
    assert {name.parts[0].partition("-")[0] for name in names} == {"fit_material"}
    held = {str(name.relative_to("fit_material")) for name in names if name.parts[0] == "fit_material"}
    read = {
        str(path.relative_to(ROOT))
        for part in PARTS
        for path in (ROOT / part).rglob("*")
        if path.is_file() and path.suffix != ".pyc"
    }
    assert held == read | {"__init__.py", "__main__.py"}


@pytest.mark.slow
@pytest.mark.parametrize("ours_first", [True, False])
def test_it_lives_beside_a_package_named_fitter(wheel, tmp_path, ours_first):
    made = run(sys.executable, "-m", "venv", tmp_path)
    assert made.returncode == 0, made.stderr
    python, packages = tmp_path / "bin" / "python", next((tmp_path / "lib").glob("python*/site-packages"))
    others = "import site; site.addsitedir({!r})".format(sysconfig.get_path("purelib"))  # all that ours depends on
    (packages / "zz_dependencies.pth").write_text(others + "\n")
    ways = [("--no-deps", wheel), ("fitter",)]  # PyPI's with what it needs and ours does not
    for way in ways if ours_first else ways[::-1]:
        done = run(python, "-m", "pip", "install", "-q", *way)
        assert done.returncode == 0, done.stderr
    command = run(tmp_path / "bin" / "fit-material", "--version", cwd=tmp_path)
    assert (command.returncode, command.stdout.split()[0]) == (0, "fit-material"), command.stderr
    code = "import fit_material.fitter, fitter; fitter.Fitter; print(fit_material.__file__, fitter.__file__)"
    both = run(python, "-c", code, cwd=tmp_path)
    assert both.returncode == 0, both.stderr
    ours, theirs = both.stdout.split()
    assert Path(ours).parent == packages / "fit_material"
    assert Path(theirs).parent == packages / "fitter"
