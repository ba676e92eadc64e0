"""Which error of the model moves a fit by how much: the budget of docs/error-budget.md."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.estimation.coarse_to_fine import Fit, Problem, fit_material
from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.least_squares.covariance import sandwich_covariance, standard_errors
from fit_material.fitter.least_squares.solvers import SOLVERS
from fit_material.fitter.observations.pixel_request import PixelRequest
from fit_material.fitter.observations.pixel_selection import choose_pixels
from fit_material.fitter.observations.scene_data import Loaded, load
from fit_material.fitter.options.fidelity import PRESETS
from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.light_tables.light_table import LightTable
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer, Tracer
from tests.bench.photographs import Case

CASES = (
    ("Au", 0.05, "studio_small_03"),
    ("Au", 0.2, "rooitou_park"),
    ("Fe", 0.1, "st_peters_square_night"),
    ("Al", 0.4, "studio_small_03"),
)
FINE_SIDE = 7


def rows(variant: str) -> Iterator[str]:
    """Lines of Markdown: per case the shifts of all numbers, in stated standard errors, the largest of each kind."""
    yield "| case | error | F0 | n | k | alpha |"
    yield "|---|---|---|---|---|---|"
    for metal, alpha, environment in CASES:
        case = Case(metal, alpha, environment)
        problem, fine = _problems(case, variant)
        fit = fit_material(problem, "metal")
        for name, shift in _shifts(problem, fine, fit):
            cells = " | ".join(f"{value:.3f} σ" for value in _in_errors(fit, shift))
            yield f"| {metal} {alpha:g} {environment} | {name} | {cells} |"


def _problems(case: Case, variant: str) -> tuple[Problem, GBuffer]:
    """The fit's problem, and the same pixels traced by more rays."""
    scene = case.scene(variant)
    loaded, fidelity = load(scene), PRESETS["standard"]
    trace = gbuffer.tracer(loaded.shape)

    request = PixelRequest(loaded.photographs, trace, scene, fidelity.footprint, seed=0)
    (chosen,) = choose_pixels(request, fidelity.pixels)
    assert chosen is not None
    lighting = Lighting(loaded.environment, (), fidelity)
    problem = Problem(chosen, lighting, SOLVERS["lm"], lambda stage, share: None)
    return problem, _traced_again(problem, trace, loaded)


def _traced_again(problem: Problem, trace: Tracer, loaded: Loaded) -> GBuffer:
    """Every pixel by FINE_SIDE² rays; a pixel is found again by the camera that its rays come from."""
    surface = problem.observed.surface
    middle, view = surface.position.mean(1), surface.view.mean(1)
    cameras = [thumbnail.camera for thumbnail in loaded.photographs.thumbnails]
    origins = torch.stack([camera.camera_to_world[:3, 3] for camera in cameras])
    towards = torch.nn.functional.normalize(origins - middle[:, None], dim=-1)
    which = (towards * view[:, None]).sum(-1).argmax(1)
    found = []
    for i, camera in enumerate(cameras):  # the pixels of one photograph follow each other
        row, column = _pixels_of(camera, middle[which == i])
        found.append(gbuffer.pixel_footprints(trace, camera, column, row, FINE_SIDE))
    return gbuffer.concatenate(found)


def _pixels_of(camera: Camera, points: Float[Tensor, "p 3"]) -> tuple[Tensor, Tensor]:
    """Rows and columns of the pixels that show points, by a perspective camera."""
    local = (points - camera.camera_to_world[:3, 3]) @ camera.camera_to_world[:3, :3]
    half = math.tan(math.radians(camera.fov) / 2)
    x, y = (local[:, i] / -local[:, 2] / half for i in (0, 1))
    return (camera.height / 2 - y * camera.width / 2).long(), ((x + 1) / 2 * camera.width).long()


def _shifts(problem: Problem, fine: GBuffer, fit: Fit) -> Iterator[tuple[str, Tensor]]:
    """Each error's name, and how far it moves the free vector."""
    table = fit.residuals.model.table
    assert table is not None
    fidelity, span = problem.fidelity, (table.low, table.high)

    def picture(surface: GBuffer = problem.observed.surface, levels: int = fidelity.levels, **better) -> Tensor:
        lighting = replace(problem.lighting, fidelity=replace(fidelity, **better))
        made: LightTable = lighting.table(surface, (*span, levels), fidelity.samples)
        return lighting.pixels(surface, body=False).under(made).radiance(fit.material)

    plain = picture()
    yield f"reflectance by {fidelity.degree} functions (24)", _moved(fit, plain - picture(degree=24))
    yield f"{fidelity.levels} levels of roughness (9)", _moved(fit, plain - picture(levels=9))
    yield "rays between 4 × 4 traced (7 × 7)", _moved(fit, plain - picture(surface=fine))
    yield "noise of the light table, its chance", _chance(fit)
    yield "… its bias, which the crossed halves remove", fit.solution.x - fit.x


def _moved(fit: Fit, error: Float[Tensor, "p 3"]) -> Float[Tensor, " x"]:
    """H⁻¹ JᵀWᵀW of an error of the picture."""
    whitening = fit.residuals.robust_whitening(fit.x)
    jacobian = torch.matmul(whitening, fit.residuals.slope(fit.x)).flatten(0, 1)
    return torch.linalg.lstsq(jacobian, torch.einsum("prc,pc->pr", whitening, error).flatten()[:, None]).solution[:, 0]


def _chance(fit: Fit) -> Float[Tensor, " x"]:
    """Half the way between what either half of the samples would have found: one draw of the table's noise."""
    first, second = (half.difference(fit.x) for half in fit.residuals.halves)
    return _moved(fit, (first - second) / 2)


def _in_errors(fit: Fit, shift: Float[Tensor, " x"]) -> list[float]:
    """The largest shift of F0, n, k and alpha, in their stated standard errors."""
    uncertainty, coordinates = sandwich_covariance(fit.residuals, fit.x), fit.residuals.coordinates
    numbers = (lambda m: m.f0, lambda m: m.n, lambda m: m.k, lambda m: m.width.value[None])
    found = []
    for number in numbers:

        def quantity(x: Tensor, number=number) -> Tensor:
            return number(coordinates.material(x))

        slope = torch.func.jacrev(quantity)(fit.x)
        found.append(float(((slope @ shift).abs() / standard_errors(quantity, fit.x, uncertainty)).max()))
    return found
