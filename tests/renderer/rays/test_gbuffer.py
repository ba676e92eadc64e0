"""What rays meet: the analytic sphere and meshes against Mitsuba, extended precision and geometry."""

import dataclasses
import math

import numpy as np
import pytest
import torch
import trimesh

from fit_material.renderer.cameras.camera import Camera, look_at
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.geometry.mesh import Mesh, Sphere
from fit_material.renderer.mitsuba.conversion import mitsuba, mitsuba_shape
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import concatenate, pixel_centres, pixel_footprints, tracer

pytestmark = pytest.mark.dr_jit

EPS32 = 2.0**-23


def camera(origin=(1.0, 2.0, 3.0), size=(24, 20), **options) -> Camera:
    pose = look_at(*(torch.tensor(v) for v in (origin, (0.05, -0.1, 0.0), (0.0, 1.0, 0.1))))
    return Camera(pose, *size, **({"fov": 40.0} | options))


CAMERAS = {
    "perspective": camera(),
    "orthographic": camera(projection="orthographic", scale=1.3),
    "close": camera(origin=(0.7, 0.6, 0.6), fov=100.0),
}


def icosphere(subdivisions: int, smooth: bool = True) -> Mesh:
    found = trimesh.creation.icosphere(subdivisions)
    vertices = np.asarray(found.vertices, np.float64)
    vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
    faces = np.asarray(found.faces)
    rng = np.random.default_rng(2)
    return Mesh(
        vertices=vertices,
        faces=faces,
        normals=vertices if smooth else None,
        uv=rng.random((len(vertices), 2)),
        material=rng.integers(0, 3, len(faces)),
        material_names=("a", "b", "c"),
    )


def bumpy() -> Mesh:
    """An icosphere whose vertex normals lean at random: nothing but interpolation explains them."""
    mesh = icosphere(1)
    normals = mesh.vertices + 0.3 * np.random.default_rng(4).normal(size=mesh.vertices.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Mesh(mesh.vertices, mesh.faces, normals, mesh.uv, mesh.material, mesh.material_names)


def mitsubas(shape, view: Camera):
    """Mitsuba's surface interactions along the rays through the pixels' centres."""
    mi = mitsuba("scalar_rgb")
    scene = mi.load_dict({"type": "scene", "shape": mitsuba_shape(shape)})
    row, column = np.mgrid[: view.height, : view.width]
    origins, directions = view.rays(torch.tensor(column.ravel() + 0.5), torch.tensor(row.ravel() + 0.5))
    rays = zip(origins.tolist(), directions.tolist(), strict=True)
    return [scene.ray_intersect(mi.Ray3f(origin, direction)) for origin, direction in rays]


@pytest.mark.parametrize("view", CAMERAS.values(), ids=CAMERAS)
@pytest.mark.parametrize("shape", [Sphere(), bumpy(), icosphere(1, smooth=False)], ids=["sphere", "bumpy", "faceted"])
def test_every_attribute_is_mitsubas(shape, view):
    expected = mitsubas(shape, view)
    found = pixel_centres(tracer(shape), view).reshape(-1)
    hit = np.array([si.is_valid() for si in expected])
    assert 0.1 < hit.mean() < 1 or view is CAMERAS["close"]
    np.testing.assert_array_equal(found.hit, hit)

    def of_mitsuba(name: str) -> np.ndarray:
        get = {"normal": lambda si: si.sh_frame.n, "geometric_normal": lambda si: si.n}.get(name)
        return np.array(
            [get(si) if get else getattr(si, name) for si, valid in zip(expected, hit, strict=True) if valid]
        )

    # grazing rays, n·v down to 0.05, move along the surface by their own float32 error, 4ε of the distance, over n·v;
    # the bumps turn normals and texture coordinates five times as fast as the position
    slack = 5 * 16 * EPS32 / found.n_dot_v[found.hit].abs().clamp_min(0.05).numpy()[:, None]
    geometric = found.geometric_normal[found.hit].numpy()
    for name, values in (
        ("p", found.position), ("normal", found.normal), ("geometric_normal", found.geometric_normal), ("uv", found.uv)
    ):  # fmt: skip
        difference = np.abs(values[found.hit].numpy() - of_mitsuba(name))
        if name == "uv" and isinstance(shape, Sphere):
            rounded = np.hypot(geometric[:, :1], geometric[:, 1:2])  # around the poles ±Z azimuth is ill-conditioned
            difference = np.minimum(difference, 1 - difference) * rounded
        assert (difference <= slack).all(), name


@pytest.mark.parametrize("view", CAMERAS.values(), ids=CAMERAS)
def test_the_material_is_that_of_the_face(view):
    mesh = icosphere(1)
    expected = [mesh.material[si.prim_index] if si.is_valid() else 0 for si in mitsubas(mesh, view)]
    np.testing.assert_array_equal(pixel_centres(tracer(mesh), view).material.flatten(), expected)
    assert len({*expected}) == 3


@pytest.mark.parametrize("distance", [3.0, 1e3, 1e6])
def test_the_sphere_keeps_its_digits_from_far_away(distance):
    view = camera(origin=(0.48 * distance, 0.6 * distance, 0.64 * distance), fov=math.degrees(2.2 / distance))
    row, column = torch.meshgrid(torch.arange(20), torch.arange(24), indexing="ij")
    origins, directions = view.rays(column.flatten() + 0.5, row.flatten() + 0.5)
    found = tracer(Sphere())(origins, directions)
    o, d = (v.numpy().astype(np.longdouble) for v in (origins, directions))
    d /= np.sqrt((d**2).sum(-1, keepdims=True))
    along = (o * d).sum(-1)
    nearest = o - along[:, None] * d  # in 80 bits, 1e-19 of the distance beside its place
    half = np.sqrt(np.maximum(0, 1 - (nearest**2).sum(-1)))
    expected = nearest - half[:, None] * d
    sure = found.hit.numpy() & (half > 0.05)
    assert sure.sum() > 150
    # the ray itself, distance · ε beside its place, meets the surface that much over n·v away
    tolerance = 16 * 2.0**-52 * distance / 0.05 + 1e-12
    np.testing.assert_allclose(found.position.numpy()[sure], expected[sure].astype(float), atol=tolerance)
    np.testing.assert_allclose(found.normal.numpy()[sure], expected[sure].astype(float), atol=tolerance)


@pytest.mark.parametrize("subdivisions", [1, 2, 3])
def test_an_icosphere_lies_within_its_sagitta(subdivisions):
    """A facet of circumradius R, inscribed in the unit sphere, lies √(1-R²) … 1 from the centre, and its normal at
    most asin R from the radius; vertex normals that are the vertices interpolate to the radius itself."""
    smooth, faceted, view = icosphere(subdivisions), icosphere(subdivisions, smooth=False), CAMERAS["perspective"]
    corner = smooth.vertices[smooth.faces]
    a, b, c = (np.linalg.norm(corner[:, i] - corner[:, (i + 1) % 3], axis=1) for i in range(3))
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1) / 2
    circumradius = (a * b * c / (4 * area)).max()
    found = {mesh.normals is None: pixel_centres(tracer(mesh), view) for mesh in (smooth, faceted)}
    hit, position = found[False].hit, found[False].position
    length = position[hit].norm(dim=-1)
    assert length.min() >= math.sqrt(1 - circumradius**2) - 8 * EPS32
    assert length.max() <= 1 + 8 * EPS32
    assert length.min() < 1 - 0.1 * (1 - math.sqrt(1 - circumradius**2))  # and not on the sphere itself
    radius = position[hit] / length[:, None]
    torch.testing.assert_close(found[False].normal[hit], radius, atol=8 * EPS32, rtol=0)
    assert ((found[True].normal[hit] * radius).sum(-1) >= math.sqrt(1 - circumradius**2) - 8 * EPS32).all()

    exact = pixel_centres(tracer(Sphere()), view)
    assert not (hit & ~exact.hit).any()
    both = hit & exact.hit
    # with n·v = c on the unit sphere, a ray reaches the sphere of radius √(1-R²) after c - √(c²-R²), if ever;
    # if not, it may meet a facet anywhere on its chord 2c
    c = exact.n_dot_v[both]
    apart = (position - exact.position).norm(dim=-1)[both]
    bound = torch.where(c > circumradius, c - (c**2 - circumradius**2).clamp_min(0).sqrt(), 2 * c)
    assert (apart <= bound + 64 * EPS32).all()


@pytest.mark.parametrize("shape", [Sphere(), icosphere(2)], ids=["sphere", "mesh"])
def test_from_inside_one_sees_the_back(shape):
    found = pixel_centres(tracer(shape), camera(origin=(0.2, 0.1, 0.0), fov=90.0))
    assert found.hit.all()
    assert not found.front.any()
    assert (found.n_dot_v < 0).all()
    # outside, the sphere is seen from its front, wherever it is seen
    outside = pixel_centres(tracer(shape), CAMERAS["perspective"])
    assert (outside.front[outside.hit & (outside.n_dot_v > 0.2)]).all()


def test_nothing_behind_the_camera_is_met():
    away = Camera(look_at(*(torch.tensor(v) for v in ([0.0, 0, 3], [0.0, 0, 6], [0.0, 1, 0]))), 8, 8)
    for shape in (Sphere(), icosphere(1)):
        found = pixel_centres(tracer(shape), away)
        assert not found.hit.any()
        assert not found.front.any()
        for values in (found.position, found.normal, found.geometric_normal, found.uv, found.material):
            assert not values.any()


def test_normals_that_lean_over_the_edge_are_no_front():
    """A triangle seen from its outer side, shaded by normals that point away from the camera."""
    corner = np.array([[-9.0, -9, 0], [9, -9, 0], [0, 9, 0]])
    away = np.tile([[0.0, 0.6, -0.8]], (3, 1))
    for normals, front in ((away, False), (-away, True), (None, True)):
        mesh = Mesh(corner, np.array([[0, 1, 2]]), normals, None, np.zeros(1, int))
        found = pixel_centres(tracer(mesh), camera(origin=(0.0, 0.0, 2.0)))
        assert found.hit.all()
        assert bool(found.front.all()) is front
        assert not found.uv.any()


def test_footprints_cover_the_exact_area():
    """Per pixel, coverage differs from ∫ chord by the cells that the boundary crosses, fewer than 2·side."""
    size, side, scale = 16, 16, 1.25
    pose = look_at(torch.tensor([0.0, 0, 5]), torch.zeros(3), torch.tensor([0.0, 1, 0]))
    view = Camera(pose, size, size, "orthographic", scale=scale)
    row, column = (grid.flatten() for grid in torch.meshgrid(torch.arange(size), torch.arange(size), indexing="ij"))
    found = pixel_footprints(tracer(Sphere()), view, column, row, side).hit.double().mean(1).reshape(size, size).numpy()
    pixel = 2 * scale / size
    edges = -scale + pixel * np.arange(size + 1)
    fine = 1000
    x = -scale + pixel * (np.arange(size * fine) + 0.5) / fine
    half = np.sqrt(np.maximum(0, 1 - x**2))
    chord = np.clip(edges[1:, None], -half, half) - np.clip(edges[:-1, None], -half, half)
    exact = chord.reshape(size, size, fine).mean(2) / pixel
    assert np.abs(found - exact).max() <= 2 / side
    assert np.abs(found - exact)[(exact == 0) | (exact == 1)].max() == 0
    # counting lattice points in a circle of radius r leaves less than 2√2πr [Gauss], in practice r^(2/3)
    radius = side / pixel
    assert found.sum() * pixel**2 == pytest.approx(math.pi, abs=4 * radius ** (2 / 3) / radius**2)


def test_footprints_are_centred_in_their_pixels():
    pose = look_at(torch.tensor([0.0, 0, 5]), torch.zeros(3), torch.tensor([0.0, 1, 0]))
    view = Camera(pose, 10, 6, "orthographic", scale=1.0)
    found = pixel_footprints(tracer(Sphere()), view, torch.tensor([3, 6]), torch.tensor([2, 4]), 4)
    assert found.hit.all()
    pixel = 0.2
    for position, (column, row) in zip(found.position.numpy(), ((3, 2), (6, 4)), strict=True):
        x, y = (column + 0.5) * pixel - 1, 0.6 - (row + 0.5) * pixel
        np.testing.assert_allclose(position[:, :2].mean(0), [x, y], atol=1e-12)
        assert len(np.unique(position[:, 0].round(9))) == 4
        assert position[0, 0] < x
        assert position[0, 1] > y  # rows count downwards


@pytest.mark.parametrize(("side", "degree"), [(2, 3), (3, 3), (4, 5), (5, 5), (6, 7), (7, 7), (8, 3), (12, 3)])
def test_means_over_a_footprint_are_means_over_the_pixel(side, degree):
    """Moments of the place within a pixel, against ∫ xᵏ dx = 1/(k + 1) from 0 to 1."""
    pose = look_at(torch.tensor([0.0, 0, 5]), torch.zeros(3), torch.tensor([0.0, 1, 0]))
    view = Camera(pose, 10, 6, "orthographic", scale=1.0)
    found = pixel_footprints(tracer(Sphere()), view, torch.tensor([3]), torch.tensor([2]), side)
    x, y = (found.position[0, :, 0] + 1) / 0.2 - 3, (0.6 - found.position[0, :, 1]) / 0.2 - 2
    assert (x > 0).all() & (x < 1).all() & (y > 0).all() & (y < 1).all()
    for k in range(1, degree + 1):
        assert (x**k).mean().item() == pytest.approx(1 / (k + 1), abs=1e-12)
        assert (y**k).mean().item() == pytest.approx(1 / (k + 1), abs=1e-12)
    assert (x * y).mean().item() == pytest.approx(1 / 4, abs=1e-12)


def test_a_footprint_of_one_ray_is_the_centre():
    view, trace = CAMERAS["perspective"], tracer(bumpy())
    column, row = torch.tensor([5, 12, 20]), torch.tensor([4, 10, 3])
    found, expected = pixel_footprints(trace, view, column, row, 1)[:, 0], pixel_centres(trace, view)[row, column]
    for name in ("hit", "position", "normal", "geometric_normal", "uv", "view", "material", "part", "tangent"):
        torch.testing.assert_close(getattr(found, name), getattr(expected, name), atol=1e-5, rtol=0)


def test_buffers_are_joined_in_order():
    trace = tracer(Sphere())
    one, other = (pixel_centres(trace, CAMERAS[name]).reshape(-1) for name in ("perspective", "orthographic"))
    joined = concatenate([one, other])
    torch.testing.assert_close(joined.normal, torch.cat([one.normal, other.normal]))
    torch.testing.assert_close(joined[len(one.hit) :].view, other.view)


@pytest.mark.parametrize("shape", [Sphere(), icosphere(2)], ids=["sphere", "mesh"])
def test_rays_in_blocks_meet_what_all_at_once_meet(shape, monkeypatch):
    trace, asked = tracer(shape), []
    whole = pixel_centres(trace, CAMERAS["perspective"])
    monkeypatch.setattr(gbuffer, "RAYS", 100)
    monkeypatch.setattr(gbuffer, "concatenate", lambda parts: asked.extend(parts) or concatenate(parts))
    found = pixel_centres(trace, CAMERAS["perspective"])
    assert [len(part.hit) for part in asked] == [100, 100, 100, 100, 80]
    for field in dataclasses.fields(whole):
        assert torch.equal(getattr(found, field.name), getattr(whole, field.name)), field.name


def test_rays_one_by_one_meet_what_all_at_once_meet(monkeypatch):
    """Without LLVM there is a slower way; which face is met, at this coarse mesh, hangs on no rounding."""
    view, mesh = CAMERAS["perspective"], bumpy()
    before = mitsuba("scalar_rgb").variant()
    at_once = pixel_centres(tracer(mesh), view)
    assert mitsuba().variant() == before
    calls = []

    def without_llvm(variant: str):
        calls.append(variant)
        if "llvm" in variant:
            raise InputError("--variant", value=variant, expected="LLVM")
        return mitsuba(variant)

    monkeypatch.setattr("fit_material.renderer.mitsuba.conversion.mitsuba", without_llvm)
    one_by_one = pixel_centres(tracer(mesh), view)
    assert calls == ["llvm_ad_rgb", "scalar_rgb"]
    for field in dataclasses.fields(at_once):
        torch.testing.assert_close(getattr(one_by_one, field.name), getattr(at_once, field.name), atol=0, rtol=0)


def test_the_part_is_that_of_the_face_and_no_rays_meet_nothing():
    mesh = icosphere(1)
    mesh = dataclasses.replace(mesh, part=mesh.material, material=np.zeros_like(mesh.material))
    found, expected = (pixel_centres(tracer(each), CAMERAS["perspective"]) for each in (mesh, icosphere(1)))
    torch.testing.assert_close(found.part, expected.material)
    assert not found.material.any()
    assert not expected.part.any()
    for shape in (mesh, Sphere()):
        assert tracer(shape)(torch.empty(0, 3).double(), torch.empty(0, 3).double()).tangent.shape == (0, 4)
