"""From photographs to an MTL file to the viewer's picture, by the commands that a user types."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float

from fit_material.fitter.report.image_quality import compare
from fit_material.fitter.result.schema import PictureQuality, Result, read_result
from fit_material.renderer.geometry.mesh import read_mesh
from fit_material.renderer.images.image_file import read_image
from fit_material.renderer.materials.bsdf import Channels
from fit_material.renderer.materials.catalogue import metal
from fit_material.renderer.materials.ground_truth import TrueGlossy, TrueMaterial, TrueMatte, TrueMetal
from fit_material.renderer.synthesis.camera_placement import View, views
from fit_material.renderer.synthesis.synthesise import SynthOptions, synthesise
from tests.bench.photographs import map_of, photographed, truth_of
from tests.bench.setting import CACHE, spread

SIZE, VIEWS = 128, 3
COVERED = 1 - 1e-6
ACCEPTED = {"fit": (0, 1)}  # exit codes; a fit without a usable material has its status in the table
GOALS = {"f0": 1e-4, "color": 1e-4, "reflectance": 1e-4, "roughness": 1e-3}


def _metal(name: str, alpha: float | None = None, rho: float | None = None) -> TrueMetal:
    known = metal(name)
    return TrueMetal(known.n, known.k, alpha, rho, metal=known.name, source=known.source)


def _glossy(color: Channels, reflectance: Channels, alpha: float | None = None, rho: float | None = None) -> TrueGlossy:
    return TrueGlossy(color, reflectance, alpha, rho)


# Every color leaves room for F from the front: one that the energy guard divides everywhere is known but for a factor.
THESIS: dict[str, TrueMaterial] = {
    "gold": _metal("Au", rho=0.25),
    "iron": _metal("Fe", rho=0.08),
    "red plastic": _glossy((0.6, 0.1, 0.05), (0.04, 0.04, 0.04), rho=0.15),
    "white enamel": _glossy((0.85, 0.8, 0.7), (0.04, 0.06, 0.1), rho=0.4),
    "clay": TrueMatte((0.5, 0.3, 0.2)),
    "velvet": TrueMatte((0.5, 0.1, 0.3), (0.3, 0.6, 0.9)),
}
REAL: dict[str, TrueMaterial] = {
    "gold": _metal("Au", alpha=0.2),
    "red plastic": _glossy((0.6, 0.1, 0.05), (0.04, 0.04, 0.04), alpha=0.1),
}


@dataclass(frozen=True)
class Outcome:
    """One time round.

    Attributes:
        result: of the fit.
        truth: of the photographs.
        viewed: how alike the viewer's picture and each photograph are, on covered pixels.
        one_sided: pixels that only one of the two takes for covered, of all pictures.
    """

    result: Result
    truth: dict
    viewed: tuple[PictureQuality, ...]
    one_sided: int

    @property
    def rms(self) -> list[float]:
        """Relative RMS difference between the viewer's picture and each photograph, linear."""
        return [each.rms_relative or 0.0 for each in self.viewed]

    def error(self, key: str) -> float | None:
        """Largest absolute error over the channels; None where the material has no such number."""
        found, true = getattr(self.result.materials[0], key), self.truth[key]
        return None if found is None or true is None else float(np.abs(np.subtract(found, true)).max())


def rows(variant: str) -> Iterator[str]:
    """Lines of two Markdown tables: photographs by the viewer's model, and by Mitsuba's."""
    mesh = _ball()
    yield f"Icosphere in studio_small_03, {VIEWS} views of {SIZE}²; `fit`, `export`, `view --antialias 1 --no-sky`."
    yield ""
    yield "Photographs in the viewer's model, `fit --fidelity viewer`; largest absolute errors over the channels:"
    yield ""
    yield "| material | found | F0 | color | reflectance | ρ | rms of fit | rms of viewer's pictures | one-sided |"
    yield "|---|---|---|---|---|---|---|---|---|"
    outcomes = []
    for name, material in THESIS.items():
        outcomes.append(_in_viewers_model(material, mesh))
        yield _row(name, outcomes[-1])
    yield ""
    for key, goal in GOALS.items():
        errors = [error for outcome in outcomes if (error := outcome.error(key)) is not None]
        yield f"- error of {key}: {spread(errors)} (goal {goal:g})"
    yield f"- viewer's picture against the photograph: {spread([max(each.rms) for each in outcomes])} (goal 0.01)"
    yield ""
    yield "Photographs by Mitsuba, `fit` at standard fidelity: how near the thesis's model comes to real lobes."
    yield ""
    yield "| material | found | alpha | ρ | rms of fit | rms of viewer's pictures, linear | PSNR, tone-mapped, dB |"
    yield "|---|---|---|---|---|---|---|"
    for name, material in REAL.items():
        yield _real_row(name, _by_mitsuba(name, material, mesh, variant))


def _ball() -> Path:
    """A ball of 20 480 triangles with exact normals, as a file."""
    path = CACHE / "ball-5.obj"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        ball = trimesh.creation.icosphere(subdivisions=5)
        smooth = trimesh.Trimesh(ball.vertices, ball.faces, vertex_normals=ball.vertices, process=False)
        smooth.export(path, include_normals=True)
    return path


def _in_viewers_model(material: TrueMaterial, mesh: Path) -> Outcome:
    """These photographs are our own code's and made in no time: none are kept."""
    with tempfile.TemporaryDirectory() as folder:
        options = SynthOptions(material, "viewer", mesh, map_of("studio_small_03"), views=VIEWS, size=SIZE)
        return _round(synthesise(options, Path(folder) / "photographs"), mesh, "viewer")


def _by_mitsuba(name: str, material: TrueMaterial, mesh: Path, variant: str) -> Outcome:
    options = SynthOptions(
        material, mesh=mesh, env=map_of("studio_small_03"), views=VIEWS, size=SIZE, spp=1024, variant=variant
    )
    return _round(photographed(options, f"loop-{name.replace(' ', '-')}"), mesh, "standard")


def _round(scene: Path, mesh: Path, fidelity: str) -> Outcome:
    """Fit, export beside a copy of the mesh, and view from where each photograph was taken."""
    with tempfile.TemporaryDirectory() as folder:
        fitted, shown = Path(folder) / "fit", Path(folder) / "shown"
        _command("fit", scene, "-o", fitted, "--fidelity", fidelity, "--quiet")
        shown.mkdir()
        model = shown / mesh.name
        model.write_bytes(mesh.read_bytes())
        _command("export", fitted / "result.json", "--to", "thesis", "-o", shown)
        viewed, one_sided = [], 0
        for index, view in enumerate(views(VIEWS, read_mesh(mesh))):
            picture = _viewed(model, scene.with_name("environment.exr"), view)
            photograph = read_image(scene.with_name(f"view_{index}.exr"))
            assert photograph.alpha is not None
            drawn, seen = picture[..., 3] == 1, photograph.alpha >= COVERED
            one_sided += int((drawn != seen).sum())
            viewed.append(compare(photograph.radiance, picture[..., :3], drawn & seen))
        return Outcome(read_result(fitted / "result.json"), truth_of(scene), tuple(viewed), one_sided)


def _viewed(model: Path, environment: Path, view: View) -> Float[np.ndarray, "h w 4"]:
    picture = model.with_name("picture.exr")
    pose = ("--origin", *view.origin, "--target", *view.target, "--up", *view.up, "--fov", view.fov)
    plain = ("--size", SIZE, SIZE, "--antialias", 1, "--no-sky")
    _command("view", model, "--env", environment, "--screenshot", picture, *plain, *pose)
    image = read_image(picture)
    assert image.alpha is not None
    return np.concatenate([image.radiance, image.alpha[..., None]], -1)


def _command(*arguments: object) -> None:
    done = subprocess.run([sys.executable, "-m", "fit_material", *map(str, arguments)], capture_output=True, text=True)
    if done.returncode not in ACCEPTED.get(str(arguments[0]), (0,)):
        sys.exit(f"bench: fit-material {arguments[0]} said {done.returncode}: {done.stdout}{done.stderr}")


def _row(name: str, outcome: Outcome) -> str:
    errors = (outcome.error(key) for key in ("f0", "color", "reflectance", "roughness"))
    told = " | ".join("" if error is None else f"{error:.1e}" for error in errors)
    own = outcome.result.quality.overall.rms_relative or 0
    viewed = " ".join(f"{value:.1e}" for value in outcome.rms)
    return f"| {name} | {_found(outcome)} | {told} | {own:.1e} | {viewed} | {outcome.one_sided} |"


def _real_row(name: str, outcome: Outcome) -> str:
    found = outcome.result.materials[0]
    own = outcome.result.quality.overall.rms_relative or 0
    viewed = " ".join(f"{value:.0%}" for value in outcome.rms)
    shown = " ".join("–" if each.psnr is None else f"{each.psnr:.1f}" for each in outcome.viewed)
    return (
        f"| {name} | {_found(outcome)} | {found.alpha:.4f} | {found.roughness:.4f} | {own:.2%} | {viewed} | {shown} |"
    )


def _found(outcome: Outcome) -> str:
    right = outcome.result.materials[0].type == outcome.truth["type"]
    return f"{outcome.result.materials[0].type}{'' if right else ' (wrong)'}, {outcome.result.status}"
