"""Captured neighbours: the geometry of their depth in closed form, and what they hold against shading by hand."""

import dataclasses
import functools
import math

import numpy as np
import pytest
import torch
import trimesh

from fit_material.renderer.cameras.camera import Camera, look_at
from fit_material.renderer.environment import cubemap
from fit_material.renderer.environment.cubemap import Cubemap
from fit_material.renderer.geometry.mesh import Mesh
from fit_material.renderer.opengl import offscreen
from fit_material.renderer.viewer_model.captured_neighbours import NEVER_SKY, capture, depth, viewpoint
from fit_material.renderer.viewer_model.model import Appearance, Model
from fit_material.renderer.viewer_model.shading import far_light, illuminations, near_light, reflective_parts, render
from fit_material.renderer.viewer_model.viewer_light import Surroundings
from fit_material.shaders.materials.types import Glossy, Matte, Metal
from fit_material.shaders.materials.widths import Blur
from fit_material.shaders.optics import diffuse, fresnel
from fit_material.shaders.shade import EnvironmentLight

SIZE = 32
EPS32 = 2.0**-23


def rgb(*values: float) -> torch.Tensor:
    return torch.tensor(values if len(values) == 3 else values * 3)


MATTE = Appearance(Matte(rgb(0.2, 0.5, 0.9), rgb(1.0)))
GLOSSY = Appearance(Glossy(rgb(0.3), rgb(0.04), Blur(torch.tensor(0.2))))
GOLD = Appearance(Metal(rgb(0.146, 0.425, 1.431), rgb(3.578, 2.326, 1.85), Blur(torch.tensor(0.0))))
ONE = torch.ones(3)


def ball(centre, radius: float, subdivisions: int = 4) -> Mesh:
    found = trimesh.creation.icosphere(subdivisions)
    normals = np.asarray(found.vertices, np.float64)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    faces = np.asarray(found.faces)
    return Mesh(np.array(centre) + radius * normals, faces, normals, None, np.zeros(len(faces), int))


def scene(*balls: Mesh) -> Mesh:
    """One mesh; each ball is an object and has a material of its own."""
    offsets = np.cumsum([0, *(len(each.vertices) for each in balls)])
    index = np.repeat(np.arange(len(balls)), [len(each.faces) for each in balls])
    names = tuple(f"ball {i}" for i in range(len(balls)))
    return Mesh(
        np.concatenate([each.vertices for each in balls]),
        np.concatenate([each.faces + offset for each, offset in zip(balls, offsets, strict=False)]),
        np.concatenate([each.normals for each in balls if each.normals is not None]),
        None, index, names, index, names,
    )  # fmt: skip


def gradient_sky(size: int = 16) -> Surroundings:
    """Radiance and ambient light that differ from direction to direction."""
    towards = cubemap.face_directions(size).float()
    ambient = torch.cat([torch.ones(1, 3), 0.2 * torch.eye(8, 3)]).double()
    return Surroundings(Cubemap(1.5 + towards), ambient)


def white_sky() -> Surroundings:
    return Surroundings(Cubemap(torch.ones(6, 8, 8, 3)), diffuse.constant_ambient(ONE.double()))


def black(surface) -> torch.Tensor:
    return torch.zeros(*surface.hit.shape, 3)


@pytest.mark.parametrize("apart", [2.2, 3.0, 8.0])
def test_depth_is_the_distance_to_the_sphere_that_is_seen(apart):
    """From a point s away a sphere of radius R is s cos θ - √(R² - s² sin² θ) away [law of cosines].

    A facet of circumradius c lies within c²/2R of its sphere, and a ray that meets it at the cosine m of the normal
    finds it within c²/2Rm; away from the silhouette, m > 0.3.
    """
    centre, towards = np.array([0.3, -0.2, 0.5]), np.array([2.0, 1.0, -2.0]) / 3
    mesh = scene(ball(centre, 1.0), ball(centre + apart * towards, 1.0))
    found = capture(mesh, [0], gradient_sky().cubemap, black, SIZE)[0]
    assert found is not None
    near = math.sqrt(3)  # half the diagonal of the box round a unit sphere, whose vertices touch all six sides
    cosine = cubemap.face_directions(SIZE) @ torch.from_numpy(towards)
    discriminant = 1 - apart**2 * (1 - cosine**2)
    distance = apart * cosine - discriminant.clamp_min(0).sqrt()
    m = discriminant.clamp_min(0).sqrt()
    sure = (m > 0.3) & (cosine > 0)
    assert sure.sum() > 20
    expected = (1 - near / distance).clamp_min(0)[sure]
    circumradius = 0.1  # of the longest facets of an icosphere of four subdivisions, 0.08 a side, generously
    slack = near / distance[sure] ** 2 * circumradius**2 / 2 / m[sure]
    difference = (found.faces[..., 3][sure] - expected).abs()
    assert (difference <= slack + 4 * EPS32).all()
    beside = (discriminant < -0.1) | (cosine < 0)
    assert (found.faces[..., 3][beside] == 1).all()
    if apart == 2.2:
        assert found.faces[..., 3].min() == 0  # nearer than its bounding sphere


def test_depth_stays_between_zero_and_the_sky():
    point = viewpoint(np.array([[-1.0, -2.0, -2.0], [3.0, 2.0, 4.0]]))
    assert point.centre.tolist() == [1, 0, 1]
    assert point.near == pytest.approx(math.sqrt(17))
    away = torch.tensor([0.0, 1e-300, 1.0, math.sqrt(17), 2 * math.sqrt(17), 1e9, 1e300], dtype=torch.float64)
    found = depth(point, point.centre + away[:, None] * torch.tensor([0.6, 0.0, 0.8], dtype=torch.float64))
    torch.testing.assert_close(found[:5], torch.tensor([0, 0, 0, 0, 0.5]).double(), atol=1e-15, rtol=1e-12)
    assert found[-1] == NEVER_SKY
    assert found.float().max() < 1


def test_the_sky_is_the_environment_at_the_texels_centre():
    sky = gradient_sky()
    found = capture(scene(ball([0, 0, 0], 1.0), ball([0, 5, 0], 1.0)), [0, 1], sky.cubemap, black, SIZE)
    for each, up in zip(found, (1.0, -1.0), strict=True):
        assert each is not None
        directions = cubemap.face_directions(SIZE)
        thing = directions[..., 1] * up > math.cos(math.asin(1 / 5)) + 1e-3
        assert (each.faces[thing][:, :3] == 0).all()
        beside = directions[..., 1] * up < math.cos(math.asin(1 / 5)) - 1e-3
        torch.testing.assert_close(each.faces[..., :3][beside], cubemap.lookup(sky.cubemap, directions)[beside])


def light_on(mesh: Mesh, appearances, surroundings: Surroundings, part: int = 0) -> EnvironmentLight:
    found = illuminations(mesh, appearances, surroundings)[part]
    assert isinstance(found, EnvironmentLight)
    return found


def test_a_small_ball_far_away_looks_as_it_is_shaded():
    """Seen along -z from z, its middle faces +z: matte shows the ambient light of that normal, metal its F0."""
    mesh, surroundings = scene(ball([0, 0, 0], 1.0), ball([0, 0, -20], 1.0)), gradient_sky()
    behind = torch.tensor([[0.0, 0.0, -1.0]]).double()
    # two degrees around the middle the normal turns by half a unit at most: look at the middle texels' mean alone
    front = -behind.float()
    expected = {
        MATTE: MATTE.material.color * diffuse.ambient(surroundings.ambient, front[0]),
        GOLD: fresnel.normal_reflectance(rgb(0.146, 0.425, 1.431), rgb(3.578, 2.326, 1.85)) * (1.5 + front[0]),
    }
    for appearance, radiance in expected.items():
        seen = light_on(mesh, (GLOSSY, appearance), surroundings).radiance(behind)[0]
        # the four texels round the middle look (2·1/256)/2·20/1 = 0.08 off the ball's middle: its normal leans by
        # 5 degrees, a mirrored view by 10; both gradients are below 1 per unit, and cancel between opposite texels
        torch.testing.assert_close(seen, radiance.to(seen), rtol=0.02, atol=0)
    alone = cubemap.lookup(surroundings.cubemap, behind)[0]
    assert (seen - alone).abs().max() > 0.3


def test_things_in_a_capture_reflect_the_far_sky_alone():
    """Three balls in a row: the middle one does not show the first to the last, as a capture of captures would."""
    row = scene(*(ball([2.5 * i, 0, 0], 1.0) for i in range(3)))
    dark_first = (Appearance(Matte(rgb(0.0), rgb(1.0))), GOLD, GLOSSY)
    seen = light_on(row, dark_first, white_sky(), part=2).radiance(torch.tensor([[-1.0, 0, 0]]))[0]
    f0 = fresnel.normal_reflectance(GOLD.material.n, GOLD.material.k)
    torch.testing.assert_close(seen, f0, rtol=1e-5, atol=0)


def test_matte_objects_and_single_ones_capture_nothing():
    two = scene(ball([0, 0, 0], 1.0, 1), ball([0, 0, -4], 1.0, 1))
    sky = white_sky()
    assert reflective_parts(two, (MATTE, GLOSSY)) == (1,)
    assert reflective_parts(two, (GOLD, GLOSSY)) == (0, 1)
    assert reflective_parts(two, (MATTE, MATTE)) == ()
    captured = functools.partial(capture, two, environment=sky.cubemap, shade=black, size=4)
    assert [each is None for each in captured([1])] == [True, False]
    of_light = [light_on(two, (MATTE, GLOSSY), sky, part).depth is None for part in (0, 1)]
    assert of_light == [True, False]
    assert all(light_on(two, (GOLD, GOLD), sky, part).depth is not None for part in (0, 1))
    without = illuminations(two, (GOLD, GOLD), sky, neighbours=False)
    assert all(isinstance(each, EnvironmentLight) and each.depth is None for each in without)
    one = dataclasses.replace(two, part=None, part_names=("default",))
    same = dataclasses.replace(two, part=np.zeros(len(two.faces), int))  # two names, but one object
    for mesh in (one, same):
        assert capture(mesh, [0], sky.cubemap, black, 4) == (None,) * len(mesh.part_names)
        assert light_on(mesh, (GOLD, GOLD), sky).depth is None


def test_a_black_ball_in_a_white_room_is_sharper_the_nearer_it_is():
    """What of the room's light is blurred over it lies between plain blurs with its least and its greatest depth.

    The balls cover the same directions: nothing but depth tells how far they are, from the middle's to the rim's.
    """
    sky, rho, share, spilled = white_sky(), torch.tensor(0.6), 1 / 2.2, []
    turn = torch.linspace(0, math.asin(share) - 0.06, 40, dtype=torch.float64)  # two texels inside the rim
    inside = torch.stack([turn.sin(), 0 * turn, -turn.cos()], -1)
    for distance in (4.0, 8.0, 64.0):
        mesh = scene(ball([0, 0, 0], 1.0), ball([0, 0, -distance], distance * share))
        captured = capture(mesh, [0], sky.cubemap, black, 64)[0]
        assert captured is not None
        light = near_light(sky, captured)
        plain = dataclasses.replace(light, depth=None)
        away = torch.tensor([distance * (1 - share), distance * math.sqrt(1 - share**2)])
        least, greatest = (plain.blurred(inside, rho * (1 - math.sqrt(3) / d)).sum() for d in away)
        spilled.append(light.blurred(inside, rho).sum())
        assert least < spilled[-1] < greatest
    assert 2 * spilled[0] < spilled[1] < 0.8 * spilled[2]
    assert far_light(sky).depth is None


def russian_dolls() -> Mesh:
    """A ball that holds two others around its centre, and one beside it."""
    return scene(ball([0, 0, 0], 1.0), ball([0, 0, 0], 0.5), ball([0.1, 0, 0], 0.7), ball([0, 3, 0], 1.0))


def test_what_surrounds_the_viewpoint_is_looked_through():
    sky = gradient_sky()
    found = capture(russian_dolls(), [0], sky.cubemap, black, SIZE)[0]
    alone = capture(scene(ball([0, 0, 0], 1.0), ball([0, 3, 0], 1.0)), [0], sky.cubemap, black, SIZE)[0]
    assert found is not None
    assert alone is not None
    torch.testing.assert_close(found.faces, alone.faces)


def test_the_viewer_looks_through_the_same(gl):
    """Within 1e-3 at 99 % of the pixels: the rays of the small picture graze facets, and its mirror is sharp."""
    model = Model(russian_dolls(), (GOLD, MATTE, GLOSSY, MATTE))
    camera = Camera(look_at(*(torch.tensor(v) for v in ((0.0, 1.0, 9.0), (0.0, 1.0, 0.0), (0.0, 1.0, 0.0)))), 128, 128)
    drawn = torch.from_numpy(offscreen.render(model, camera, gradient_sky(), sky=False, antialias=1))
    expected = render(model, camera, gradient_sky())
    both = (drawn[..., 3] == 1) & (expected[..., 3] == 1)
    difference = ((drawn - expected).abs() / expected.clamp_min(0.01))[both][:, :3].amax(1)
    assert difference.quantile(0.99) < 1e-3
    inner = render(model, camera, gradient_sky(), neighbours=False)
    assert (inner - expected).abs()[both].max() > 0.1  # the ball above shows in the one below
