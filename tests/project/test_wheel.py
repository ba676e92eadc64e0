"""The wheel holds one package, `fit_material`, and lives beside PyPI's `fitter`, whose name one of our folders has."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import venv
import zipfile
from collections.abc import Iterable
from fnmatch import fnmatch
from importlib.metadata import version
from pathlib import Path

import pytest

from tests.support.paths import ROOT, SOURCE

TOPS = ("shaders", "renderer", "fitter")
DATA = {
    "fit_material/shaders/glsl/*.glsl",
    "fit_material/shaders/glsl/*.vert",
    "fit_material/shaders/glsl/*.frag",
    "fit_material/fitter/html/*.html",
    "fit_material/fitter/html/*.css",
    "fit_material/renderer/materials/*.csv",
}
BUILD = ("setuptools>=77", "fitter")  # what `pyproject.toml` builds with, and the package of another's to live beside
LISTED = """
import json
from setuptools import Distribution
made = Distribution({"script_name": "setup.py"})
made.parse_config_files(["pyproject.toml"])
build = made.get_command_obj("build_py")
build.build_lib = "."
build.ensure_finalized()
build.data_files = build.get_data_files_without_manifest()
print(json.dumps(build.get_outputs(include_bytecode=False)))
"""
SDIST = "import sys; from setuptools.build_meta import build_sdist; build_sdist(sys.argv[1])"
UNTOUCHED = """
import base64, hashlib
from importlib.metadata import files
for name in ("fit-material", "fitter"):
    for file in files(name):
        if file.hash is not None:
            digest = hashlib.new(file.hash.mode, file.read_binary()).digest()
            assert base64.urlsafe_b64encode(digest).rstrip(b"=").decode() == file.hash.value, file
"""
IMPORTED = """
import sys
from unittest.mock import MagicMock
while True:
    try:
        import fitter
        break
    except ModuleNotFoundError as error:  # one of its dependencies, which we do not install
        assert error.name.partition(".")[0] != "fitter", error
        sys.modules[error.name] = MagicMock()
import fit_material.fitter, fit_material.renderer.materials.catalogue
print(fitter.__file__, fit_material.__file__, fitter.Fitter.__module__)
print(fit_material.renderer.materials.catalogue.metal("Au").name)
"""


def sources() -> set[str]:
    """What a wheel is to hold of our folders, by its path there."""
    found = (path for top in TOPS for path in (ROOT / top).rglob("*.py"))
    modules = {f"fit_material/{path.relative_to(ROOT).as_posix()}" for path in found}
    data = {f"{pattern.rpartition('/')[0]}/{path.name}" for pattern in DATA for path in SOURCE.glob(pattern)}
    return {"fit_material/__init__.py", "fit_material/__main__.py"} | modules | data


def require_whole(held: Iterable[str]) -> None:
    """That a wheel holds all of our files, data of every kind among them, and no other top-level name than ours."""
    held = set(held)
    assert {name.partition("/")[0] for name in held} == {"fit_material"}
    assert held == sources()
    assert not {pattern for pattern in DATA if not any(fnmatch(name, pattern) for name in held)}


def test_the_package_has_one_name_and_three_links():
    links = {path.name: path.resolve() for path in (SOURCE / "fit_material").iterdir() if path.is_symlink()}
    assert links == {name: ROOT / name for name in TOPS}
    assert [path.name for path in SOURCE.iterdir() if (path / "__init__.py").exists()] == ["fit_material"]


def test_what_the_wheel_would_hold():
    """As setuptools itself finds it by `pyproject.toml`, without building anything."""
    pytest.importorskip("setuptools", minversion=BUILD[0].partition(">=")[2])
    done = subprocess.run([sys.executable, "-c", LISTED], capture_output=True, text=True, check=True, cwd=ROOT)
    require_whole(Path(name).as_posix() for name in json.loads(done.stdout))


def test_no_data_file_is_left_out():
    """Whatever lies among the modules is a module, or of a kind that the wheel takes."""
    found = {path for top in TOPS for path in (ROOT / top).rglob("*") if path.is_file() and path.suffix != ".pyc"}
    held = {ROOT / name.removeprefix("fit_material/") for name in sources()}
    assert not found - held


class Environment:
    """A Python of its own, empty but for pip."""

    def __init__(self, folder: Path) -> None:
        venv.create(folder, with_pip=True, symlinks=os.name != "nt")
        self.binaries = folder / ("Scripts" if os.name == "nt" else "bin")

    def run(self, *command: str | Path, cwd: Path | None = None) -> str:
        """The output of one of its programs, which must end well."""
        name, *arguments = map(str, command)
        environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
        done = subprocess.run(
            [self.binaries / name, *arguments], capture_output=True, text=True, check=False, cwd=cwd, env=environment
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def pip(self, *arguments: str | Path) -> None:
        """Install or build, from files alone."""
        action, *rest = arguments
        self.run("python", "-m", "pip", action, "--no-deps", "--no-index", *rest)

    def lend_dependencies(self) -> None:
        """Add the packages that this process has, as later entries of the path: editable installs among them do not
        count, for those are found by `.pth` files, which are read in an environment's own folder alone."""
        others = [path for path in sys.path if Path(path).name in ("site-packages", "dist-packages")]
        own = self.run("python", "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip()
        (Path(own) / "lent.pth").write_text("\n".join(others), "utf-8")


@pytest.fixture(scope="module")
def builder(tmp_path_factory) -> Environment:
    return Environment(tmp_path_factory.mktemp("builder"))


@pytest.fixture(scope="module")
def packages(builder, tmp_path_factory) -> Path:
    """A folder of the packages of others, from the package index."""
    folder = tmp_path_factory.mktemp("packages")
    command = [builder.binaries / "python", "-m", "pip", "download", "--no-deps", "-d", folder, *BUILD]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f"no package index within reach: {(done.stderr.strip().splitlines() or ['no reason given'])[-1]}")
    return folder


@pytest.fixture(scope="module")
def tree(tmp_path_factory) -> Path:
    """The project as git has it, links as links: builds leave folders, of which the next build takes old files."""
    folder = tmp_path_factory.mktemp("tree") / "project"
    unwanted = shutil.ignore_patterns("__pycache__", "*.egg-info")
    for name in ("src", *TOPS):
        shutil.copytree(ROOT / name, folder / name, symlinks=True, ignore=unwanted)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder / name)
    return folder


def built(builder: Environment, source: Path, packages: Path, folder: Path) -> Path:
    builder.pip("wheel", "--find-links", packages, "-w", folder, source)
    (wheel,) = folder.glob("fit_material-*.whl")
    return wheel


@pytest.fixture(scope="module")
def wheel(builder, tree, packages, tmp_path_factory) -> Path:
    return built(builder, tree, packages, tmp_path_factory.mktemp("wheel"))


def names_in(wheel: Path) -> list[str]:
    return [name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name]


@pytest.mark.slow
def test_the_wheel_is_whole(wheel):
    require_whole(names_in(wheel))


@pytest.mark.slow
def test_so_is_the_one_from_an_sdist(builder, tree, packages, tmp_path):
    """An archive has no links: it holds the files that they lead to."""
    builder.pip("install", "--find-links", packages, "--upgrade", "setuptools")
    builder.run("python", "-c", SDIST, tmp_path, cwd=tree)
    (archive,) = tmp_path.glob("fit_material-*.tar.gz")
    require_whole(names_in(built(builder, archive, packages, tmp_path)))


@pytest.mark.slow
@pytest.mark.parametrize("first", ["fit-material", "fitter"])
def test_the_wheel_lives_beside_the_fitter_of_others(first, wheel, packages, tmp_path):
    """Whichever is installed first, all files of both are as they were packed, both are imported, and ours runs."""
    (theirs,) = packages.glob("fitter-*.whl")
    here = Environment(tmp_path / "environment")
    for each in (wheel, theirs) if first == "fit-material" else (theirs, wheel):
        here.pip("install", each)
    here.run("python", "-c", UNTOUCHED)
    here.lend_dependencies()
    assert here.run("fit-material", "--version") == f"fit-material {version('fit-material')}\n"
    where, gold = here.run("python", "-c", IMPORTED, cwd=tmp_path).splitlines()
    fitter, ours, module = where.split()
    assert all((tmp_path / "environment") in Path(path).parents for path in (fitter, ours))
    assert (Path(fitter).parent.name, Path(ours).parent.name, module) == ("fitter", "fit_material", "fitter.fitter")
    assert gold == "Au"
