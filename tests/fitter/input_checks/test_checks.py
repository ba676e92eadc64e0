"""The preflight's parts, against closed forms and against scenes that were really turned, blurred or repeated."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from kornia.color import rgb_to_linear_rgb
from scipy import ndimage

from fit_material.fitter.input_checks.candidate_pictures import CoarseLight
from fit_material.fitter.input_checks.checks import Lit, up_axes
from fit_material.fitter.input_checks.duplicates import duplicate_findings, rows_of
from fit_material.fitter.input_checks.finding import Finding
from fit_material.fitter.input_checks.hypotheses import _decoded, _encoded
from fit_material.fitter.input_checks.orientation import GIVEN, Orientation, orientations
from fit_material.fitter.input_checks.pixel_values import pixel_findings
from fit_material.fitter.input_checks.sampled_pixels import SampledPixels
from fit_material.fitter.input_checks.sharpness import edge_width
from fit_material.fitter.input_checks.silhouette import MeshTurn, Sighting, mesh_turn, silhouette_findings
from fit_material.fitter.observations.photograph import Photograph
from fit_material.renderer.cameras.camera import Camera, look_at
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.environment.latlong import lookup, of
from fit_material.renderer.geometry.mesh import Mesh, Sphere
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.scene.lights import directional_light, light_option
from fit_material.renderer.synthesis.studio import studio

ROTATION = 30.0
STUDIO = Environment(studio(64).radiance, ROTATION)
SIZE = 64


def vector(*values: float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


def camera(origin: tuple[float, float, float] = (1.0, 2.0, 4.0)) -> Camera:
    return Camera(look_at(vector(*origin), vector(0, 0, 0), vector(0, 1, 0)), SIZE, SIZE)


def photograph(radiance: np.ndarray, outline: np.ndarray | None = None, clipped: int = 0) -> Photograph:
    light = torch.from_numpy(radiance.astype(np.float32))
    light = light[..., None].expand(*light.shape, 3) if light.dim() == 2 else light
    mask = torch.ones(light.shape[:2], dtype=torch.bool)
    drawn = None if outline is None else torch.from_numpy(outline)
    return Photograph("view", light, mask, camera(), 1.0, clipped, 0, (), drawn)


def test_there_are_48_orientations_and_each_is_another():
    every = orientations()
    assert every[0] == GIVEN
    assert len({tuple(each.to_map(0).round().flatten().tolist()) for each in every}) == 48


@pytest.mark.parametrize("turn", [0, 90, 180, 270])
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_turned_or_mirrored_direction_sees_what_the_turned_or_mirrored_map_shows(turn, mirrored):
    towards = torch.nn.functional.normalize(torch.randn(50, 3, generator=torch.Generator().manual_seed(1)).double())
    radiance = STUDIO.radiance.flip(1) if mirrored else STUDIO.radiance
    really = lookup(of(Environment(radiance, ROTATION + turn)), *towards.unbind(1))
    own = towards @ Orientation(turn=turn, mirrored=mirrored).to_map(ROTATION).T
    torch.testing.assert_close(lookup(of(Environment(STUDIO.radiance)), *own.unbind(1)), really, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize(("up", "axis"), [("+Z", (0, 0, 1)), ("-X", (-1, 0, 0)), ("-Y", (0, -1, 0))])
def test_the_axis_that_is_up_meets_the_upper_pole(up, axis):
    for turn in (0, 90):
        assert (Orientation(up, turn).to_map(ROTATION) @ vector(*axis)).tolist() == pytest.approx([0, 1, 0])


def test_pictures_of_an_orientation_are_those_in_a_map_that_was_really_changed(monkeypatch):
    monkeypatch.setattr("fit_material.fitter.input_checks.candidate_pictures.SAMPLES", 4096)
    surface = gbuffer.pixel_centres(gbuffer.tracer(Sphere()), camera()).reshape(-1)
    surface = surface[surface.front][::20][:, None]
    count = len(surface.hit)
    looks = SampledPixels(surface, torch.ones(3, count), torch.zeros(count, dtype=torch.long), torch.ones(count))
    turned = CoarseLight.of(STUDIO, ()).pictures(looks, [Orientation(turn=90, mirrored=True)])
    changed = Environment(STUDIO.radiance.flip(1).contiguous(), ROTATION + 90)
    really = CoarseLight.of(changed, ()).pictures(looks, [GIVEN])
    # diffuse light is looked up between normals 7.5° apart; what facets mirror has noise: 7 % by 128 directions, and so
    # 1.3 % by 4096
    torch.testing.assert_close(turned.diffuse, really.diffuse, rtol=0.02, atol=0.01)
    ratio = turned.white[0, -1] / really.white[0, -1]
    assert float((ratio - 1).abs().median()) < 0.03


def test_a_directional_light_adds_lamberts_cosine():
    spec = light_option((0.3, 0.8, 0.5, 3.0, 2.0, 1.0))
    surface = gbuffer.pixel_centres(gbuffer.tracer(Sphere()), camera()).reshape(-1)
    surface = surface[surface.front][::20][:, None]
    looks = SampledPixels(
        surface, torch.ones(3, len(surface.hit)), surface.material[:, 0], torch.ones(len(surface.hit))
    )
    lit, dark = (CoarseLight.of(STUDIO, lights).pictures(looks, [GIVEN]) for lights in ((directional_light(spec),), ()))
    towards = torch.nn.functional.normalize(vector(*spec.direction), dim=0)
    cosine = (surface.normal[:, 0] @ towards).clamp_min(0)
    expected = vector(*spec.irradiance)[:, None] / math.pi * cosine
    torch.testing.assert_close((lit.diffuse - dark.diffuse)[0].double(), expected, rtol=1e-4, atol=1e-5)
    assert bool((lit.white >= dark.white).all())


def test_decoding_is_kornias():
    code = torch.linspace(0, 1, 50)
    expected = rgb_to_linear_rgb(code.expand(3, 1, 50))[0, 0]
    torch.testing.assert_close(_decoded(code), expected)
    torch.testing.assert_close(_encoded(_decoded(code)), code)


@pytest.mark.parametrize("sigma", [1.5, 2.0])
def test_a_blurred_edge_is_as_wide_as_its_gaussian_says(sigma):
    row, column = np.mgrid[:SIZE, :SIZE]
    inside = np.hypot(row - 31.5, column - 31.5) < 24
    blurred = ndimage.gaussian_filter(inside.astype(float), sigma) ** 2  # widths are of roots of light
    width = edge_width(blurred, inside)
    assert width is not None
    # of the step, 5 % lie beyond the 3 pixels next to the edge; pixels and the lookup between them add √(σ² + ¼), 5 %
    assert width == pytest.approx(math.sqrt(2 * math.pi) * sigma, rel=0.1)
    sharp = edge_width(inside.astype(float), inside)
    assert sharp is not None
    assert sharp < 2


def test_an_edge_without_contrast_tells_nothing():
    inside = np.hypot(*np.mgrid[-32:32, -32:32]) < 24
    assert edge_width(np.ones((SIZE, SIZE)), inside) is None


def smooth(seed: int) -> np.ndarray:
    """A picture with one per cent of noise of its own."""
    row, column = np.mgrid[:SIZE, :SIZE]
    noise = np.random.default_rng(seed).normal(size=(SIZE, SIZE))
    return (1 + 0.3 * np.sin(row / 15) * np.cos(column / 20)) * (1 + 0.01 * noise)


def test_the_same_noise_twice_is_the_same_photograph():
    coded = np.rint(smooth(1) * 150) / 150  # saved once more, with fewer bits
    pictures = [smooth(1), smooth(2), 1.7 * coded]
    found = duplicate_findings([rows_of(photograph(each)) for each in pictures], ["a", "b", "c"])
    assert [each.where for each in found] == ["c"]
    assert "the same photograph as a" in found[0].value


def test_pictures_without_any_noise_in_even_light_are_no_duplicates():
    even = [rows_of(photograph(np.ones((SIZE, SIZE)))) for _ in range(2)]
    assert not duplicate_findings(even, ["a", "b"])


def kinds(radiance: np.ndarray, clipped: int = 0) -> list[str]:
    every = torch.ones(SIZE, SIZE, dtype=torch.bool)
    return [each.kind for each in pixel_findings(photograph(radiance, clipped=clipped), every, "view")]


def test_flat_tops_are_clipped_whether_or_not_the_file_says_so():
    light = smooth(1)
    top = np.quantile(light, 0.9)
    assert kinds(np.minimum(light, top)) == ["clipping"]
    assert kinds(np.minimum(light, top), clipped=500) == ["clipping"]
    assert kinds(np.minimum(light, np.quantile(light, 0.99)), clipped=50) == []
    assert kinds(light) == []


def test_few_values_are_told_but_not_of_even_light():
    assert kinds(np.rint(smooth(1) * 8) / 8 - 0.6) == ["values"]
    assert kinds(np.ones((SIZE, SIZE))) == []


def brick(turn: torch.Tensor) -> Mesh:
    """A brick of three different sides, its vertices turned."""
    import trimesh

    box = trimesh.creation.box((2.0, 1.0, 0.5))
    faces = np.asarray(box.faces)
    return Mesh(np.asarray(box.vertices) @ turn.numpy().T, faces, None, None, np.zeros(len(faces), dtype=np.int64))


def sighted(mesh: Mesh, seen: Mesh, drawn: bool) -> list[Sighting]:
    """Photographs of one mesh, white on black, beside what rays find of another."""
    found = []
    for origin in ((1.0, 2.0, 4.0), (3.0, -1.0, 3.0)):
        hit = gbuffer.pixel_centres(gbuffer.tracer(seen), camera(origin)).hit.numpy()
        taken = photograph(0.1 + hit, hit if drawn else None)
        taken = Photograph(taken.name, taken.radiance, taken.mask, camera(origin), 1.0, 0, 0, (), taken.outline)
        found.append(Sighting.of(taken, gbuffer.tracer(mesh)))
    return found


@pytest.mark.parametrize("drawn", [True, False], ids=["by its mask", "by the picture's edges"])
def test_a_mesh_that_is_z_up_is_told(drawn):
    upright = Orientation("+Z").to_map(0)
    given, meant = brick(torch.eye(3).double()), brick(upright)
    turn = mesh_turn(sighted(given, meant, drawn), gbuffer.tracer(given))
    assert turn is not None
    torch.testing.assert_close((turn.matrix @ upright.T).abs(), torch.eye(3).double())  # a brick has half turns, too
    assert mesh_turn(sighted(meant, meant, drawn), gbuffer.tracer(meant)) is None


def test_cameras_that_are_z_up_are_told_once():
    """They make the mesh and the light look wrong; a mesh that is z-up leaves the light alone."""
    cameras = Finding("up-axis", "environment", "fits", "turn both")
    against = MeshTurn("-Z", 0, True, 0.6, 0.99)  # what takes +Y to the cameras' +Z
    told = up_axes(against, Lit(Orientation("+Z"), (cameras,)))
    assert [(each.kind, each.where) for each in told] == [
        ("up-axis", "photographs' cameras against mesh and environment")
    ]
    assert told[0].remedy == "turn the cameras so that their +Z becomes +Y: (x, y, z) → (x, z, -y)"
    own = up_axes(MeshTurn("+Z", 0, True, 0.6, 0.99), Lit(GIVEN, ()))
    assert [(each.where, each.remedy) for each in own] == [
        ("geometry.mesh against photographs' cameras", "turn the mesh so that its +Z becomes +Y")
    ]


@pytest.mark.parametrize("drawn", [True, False], ids=["by its mask", "by the picture's edges"])
def test_a_silhouette_that_is_displaced_is_told(drawn):
    right, wide = brick(torch.eye(3).double()), brick(1.3 * torch.eye(3).double())
    found = silhouette_findings(sighted(wide, right, drawn), ["a", "b"])
    assert [each.kind for each in found] == ["silhouette", "silhouette"]
    assert not silhouette_findings(sighted(right, right, drawn), ["a", "b"])
