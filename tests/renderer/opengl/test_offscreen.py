"""Off-screen pictures against closed forms, ray casting, and the environment itself."""

from __future__ import annotations

from dataclasses import replace

import moderngl
import numpy as np
import pytest
import torch

from fit_material.renderer.cameras.camera import Camera, look_at
from fit_material.renderer.environment import cubemap
from fit_material.renderer.environment.environment import Environment, directions
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.geometry.mesh import Mesh
from fit_material.renderer.materials.textured_material import Appearance
from fit_material.renderer.opengl import context as context_module
from fit_material.renderer.opengl import offscreen
from fit_material.renderer.opengl.drawing import Stage
from fit_material.renderer.opengl.offscreen import picture, render
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.synthesis.studio import studio
from fit_material.renderer.viewer_model.model import Model
from fit_material.renderer.viewer_model.viewer_light import Surroundings, surroundings
from fit_material.shaders.materials.types import Glossy, Matte, Metal
from fit_material.shaders.materials.widths import Blur
from tests.support import parity
from tests.support.parity import numbers

EPS = 2.0**-23
FRONT = look_at(numbers(0.0, 0.0, 4.0), numbers(0.0, 0.0, 0.0), numbers(0.0, 1.0, 0.0))
TILTED = look_at(numbers(1.5, 2.0, 3.0), numbers(0.1, 0.0, -0.2), numbers(0.2, 1.0, 0.1))
CAMERAS = {
    "wide": Camera(TILTED, 96, 48, fov=50.0),
    "tall": Camera(TILTED, 40, 72, fov=30.0),
    "orthographic": Camera(TILTED, 80, 60, projection="orthographic", scale=1.3),
    "inside": Camera(look_at(numbers(1.0, 0.1, 0.0), numbers(1.0, 0.0, 1.0), numbers(0.0, 1.0, 0.0)), 64, 64, fov=90.0),
}


def constant_light(*radiance: float) -> Surroundings:
    return surroundings(Environment(torch.tensor(radiance).expand(8, 16, 3).contiguous()))


def torus_of(material) -> Model:
    return Model(parity.mesh(parity.torus), (Appearance(material),))


def two_objects() -> Model:
    return parity.Case("metal", neighbours=True).model()


def square(z: float = 0.0, normal: float = 1.0) -> Mesh:
    """Two triangles that face +Z, or their back side, 2 wide."""
    corners = np.array([[-1.0, -1.0, z], [1.0, -1.0, z], [1.0, 1.0, z], [-1.0, 1.0, z]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return Mesh(corners, faces, np.tile([0.0, 0.0, normal], (4, 1)), None, np.zeros(2, int))


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_what_is_covered_is_what_rays_hit(camera, gl):
    """Mitsuba casts the rays; both round at edges, to some 1e-3 of a pixel, where few pixels have their centres."""
    model = torus_of(Matte(numbers(0.5, 0.5, 0.5), numbers(1.0, 1.0, 1.0)))
    drawn = render(model, camera, constant_light(1.0, 1.0, 1.0), sky=False, antialias=1)[..., 3]
    hit = gbuffer.pixel_centres(gbuffer.tracer(model.mesh), camera).hit.numpy()
    assert hit.mean() > 0.1
    assert np.isin(drawn, (0, 1)).all()
    assert (drawn != hit).sum() <= 2


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_the_sky_is_the_environment_where_rays_go(camera, gl):
    """float32 directions err by 2e-7, which is 1e-5 of a texel of 0.025, where texels differ by at most the range."""
    light = surroundings(studio(64), size=64)
    far_away = replace(square(), vertices=square().vertices * 1e-6 + 50)
    drawn = render(Model(far_away, (Appearance(parity.MATERIALS["matte"]),)), camera, light, antialias=1)
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    _, towards = camera.rays(torch.from_numpy(x), torch.from_numpy(y))
    exact = cubemap.Cubemap(light.cubemap.faces.double())
    expected = cubemap.lookup(exact, towards).numpy()
    assert drawn[..., 3].max() == 0
    np.testing.assert_allclose(drawn[..., :3], expected, rtol=EPS, atol=1e-5 * float(exact.faces.max()))


def test_lambertian_and_metal_under_constant_light(gl):
    """Seen straight from the front a matte surface sends out colour · L · F, and a metal L · F0."""
    light = constant_light(0.5, 1.0, 2.0)
    matte = Matte(numbers(0.2, 0.5, 0.9), numbers(1.0, 0.5, 0.25))
    metal = Metal(*parity.GOLD, Blur(numbers(0.3)))
    for material, share in ((matte, matte.color * matte.reflectance), (metal, metal.f0)):
        drawn = render(Model(square(), (Appearance(material),)), Camera(FRONT, 3, 3, fov=1.0), light, antialias=1)
        expected = (share * numbers(0.5, 1.0, 2.0)).numpy()
        np.testing.assert_allclose(drawn[1, 1, :3], expected, rtol=1e-5)  # of the ambient light's harmonics


def test_a_facet_without_normals_faces_where_its_corners_say(gl):
    light = replace(constant_light(1.0, 1.0, 1.0), ambient=torch.zeros(9, 3), sources=(parity.LIGHT,))
    white = Appearance(Matte(numbers(1.0, 1.0, 1.0), numbers(1.0, 1.0, 1.0)))
    faceted = replace(square(), normals=None)
    drawn = render(Model(faceted, (white,)), Camera(FRONT, 3, 3, fov=1.0), light, antialias=1)
    expected = parity.LIGHT.radiance * parity.LIGHT.towards[2]
    np.testing.assert_allclose(drawn[1, 1, :3], expected, rtol=8 * EPS)


def test_back_sides_are_drawn_and_mirror_as_if_at_the_edge(gl):
    """n·v is 0 there, where every metal reflects all."""
    light = constant_light(0.5, 1.0, 2.0)
    metal = Appearance(Metal(*parity.GOLD, Blur(numbers(0.0))))
    drawn = render(Model(square(normal=-1.0), (metal,)), Camera(FRONT, 3, 3, fov=1.0), light, antialias=1)
    np.testing.assert_allclose(drawn[1, 1], [0.5, 1.0, 2.0, 1.0], rtol=8 * EPS)


def test_the_nearer_surface_hides_the_farther(gl):
    near, far = square(0.5), square(-0.5)
    both = Mesh(
        np.concatenate([near.vertices, far.vertices]),
        np.concatenate([near.faces, far.faces + 4]),
        np.tile([0.0, 0.0, 1.0], (8, 1)),
        None,
        np.array([0, 0, 1, 1]),
        ("near", "far"),
    )
    colors = (
        Matte(numbers(1.0, 0.0, 0.0), numbers(1.0, 1.0, 1.0)),
        Matte(numbers(0.0, 1.0, 0.0), numbers(1.0, 1.0, 1.0)),
    )
    light, camera = constant_light(1.0, 1.0, 1.0), Camera(FRONT, 3, 3, fov=1.0)
    for order in ((0, 1), (1, 0)):  # whichever is drawn first
        model = Model(replace(both, material=np.array(order).repeat(2)), tuple(Appearance(colors[i]) for i in order))
        drawn = render(model, camera, light, antialias=1)
        np.testing.assert_allclose(drawn[1, 1, :3], [1, 0, 0], atol=1e-5)


def test_antialiasing_is_the_mean_over_a_regular_grid_of_the_pixel(gl):
    model, side = torus_of(parity.MATERIALS["matte"]), 3
    camera = Camera(TILTED, 24, 24, fov=45.0)
    drawn = render(model, camera, constant_light(1.0, 1.0, 1.0), sky=False, antialias=side)[..., 3]
    row, column = (index.flatten() for index in torch.meshgrid(torch.arange(24), torch.arange(24), indexing="ij"))
    inside = (torch.arange(side, dtype=torch.float64) + 0.5) / side
    rows, columns = (row + dy for dy in inside), [column + dx for dx in inside]
    rays = [camera.rays(x, y) for y in rows for x in columns]
    trace = gbuffer.tracer(model.mesh)
    expected = torch.stack([trace(*each).hit for each in rays]).double().mean(0).reshape(24, 24).numpy()
    assert ((expected > 0) & (expected < 1)).sum() > 50
    assert (np.abs(drawn - expected) > 1e-6).sum() <= 2


def test_a_turned_environment_is_one_that_was_read_turned(gl):
    """A map of slope 1, resampled at another angle, errs at a cube's edges by some tenth of a texel of 0.03."""
    x, y, z = directions(64, 128).unbind(-1)
    smooth = torch.stack([1 + 0.9 * x, 1 + 0.5 * z + 0.4 * y, 1 + 0.8 * x * z], -1).float()
    camera, model = Camera(TILTED, 32, 32, fov=45.0), two_objects()
    drawn = picture(gl, Stage(gl, model, surroundings(Environment(smooth), size=64)), camera, rotation=70, antialias=1)
    read_turned = render(model, camera, surroundings(Environment(smooth, 70.0), size=64), antialias=1)
    straight = render(model, camera, surroundings(Environment(smooth), size=64), antialias=1)
    np.testing.assert_allclose(drawn, read_turned, atol=4e-3)
    assert np.abs(drawn - straight).max() > 0.3


def test_a_stage_that_turns_captures_its_neighbours_anew(gl):
    light, camera = surroundings(studio(64), size=64), Camera(TILTED, 32, 32, fov=45.0)
    stage = Stage(gl, two_objects(), light)
    first = picture(gl, stage, camera, antialias=1)
    turned = picture(gl, stage, camera, rotation=120, antialias=1)
    again = picture(gl, stage, camera, antialias=1)
    assert np.array_equal(first, again)
    assert not np.allclose(first, turned)


def test_coordinates_far_from_the_origin_keep_their_digits(gl):
    """Vertices are told from the model's centre: a picture shifted with its camera by 1e5 stays the same."""
    model, light = torus_of(parity.MATERIALS["metal"]), surroundings(studio(64), size=64)
    shift = np.array([1e5, -2e5, 5e4])
    moved = Model(replace(model.mesh, vertices=model.mesh.vertices + shift), model.appearances)
    pose = TILTED.clone()
    pose[:3, 3] += torch.from_numpy(shift)
    here = render(model, Camera(TILTED, 48, 48, fov=45.0), light, sky=False, antialias=1)
    there = render(moved, Camera(pose, 48, 48, fov=45.0), light, sky=False, antialias=1)
    assert (here[..., 3] != there[..., 3]).sum() <= 2
    seen = here[..., 3] * there[..., 3] == 1
    np.testing.assert_allclose(there[seen], here[seen], rtol=1e-3, atol=1e-4)


def test_the_same_context_serves_everybody(gl):
    assert offscreen.offscreen_context() is gl


def test_missing_libraries_are_one_sentence(monkeypatch):
    def missing(*_args, **_options):
        raise Exception("libEGL.so not loaded")

    monkeypatch.setattr(moderngl, "create_context", missing)
    with pytest.raises(InputError) as raised:
        context_module.offscreen_context.__wrapped__()
    assert str(raised.value) == (
        "view: expected OpenGL 4.3 or newer through EGL (libEGL.so not loaded); "
        "on Debian or Ubuntu type: sudo apt-get install libegl1 libgl1 libgl1-mesa-dri"
    )


@pytest.mark.parametrize("roughness", [0.0, 1e-7, 0.5, 30.0])
def test_any_roughness_is_finite(roughness, gl):
    light = replace(surroundings(studio(64), size=64), sources=(parity.LIGHT,))
    glossy = Glossy(numbers(1.0, 0.0, 0.5), numbers(1.0, 0.0, 0.5), Blur(numbers(roughness)))
    drawn = render(torus_of(glossy), Camera(TILTED, 32, 32, fov=45.0), light, antialias=1)
    assert np.isfinite(drawn).all()


def test_what_the_graphics_card_has_no_room_for(gl):
    most = gl.info["GL_MAX_TEXTURE_SIZE"]
    with pytest.raises(InputError) as raised:
        render(two_objects(), Camera(FRONT, most + 1, 1), constant_light(1.0, 1.0, 1.0), antialias=1)
    sentence = f"view: size of a picture: is {most + 1} × 1, expected at most {most} pixels along each side"
    assert str(raised.value) == sentence
