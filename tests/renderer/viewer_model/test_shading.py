"""Whole pictures in the viewer's model: closed forms on the sphere, one effect at a time on a plane."""

import dataclasses
import math

import numpy as np
import pytest
import torch
import trimesh

from fit_material.renderer.cameras.camera import Camera, look_at
from fit_material.renderer.environment.cubemap import Cubemap
from fit_material.renderer.environment.environment import Environment, directions
from fit_material.renderer.geometry.mesh import Mesh, Sphere
from fit_material.renderer.images.textures import Texture
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.scene.lights import DirectionalLightSpec
from fit_material.renderer.viewer_model import shading
from fit_material.renderer.viewer_model.model import Appearance, Maps, Model
from fit_material.renderer.viewer_model.shading import applicable, render, render_shape, shade_surface
from fit_material.renderer.viewer_model.viewer_light import Surroundings, surroundings
from fit_material.shaders.materials.types import Glossy, Matte, Metal
from fit_material.shaders.materials.widths import Blur
from fit_material.shaders.optics import diffuse

GOLD = (0.146, 0.425, 1.431), (3.578, 2.326, 1.85)


def tensor(*values: float, dtype=torch.float64) -> torch.Tensor:
    return torch.tensor(values, dtype=dtype)


def view(origin=(1.0, 2.0, 3.0), size=(24, 20), **options) -> Camera:
    pose = look_at(*(torch.tensor(v) for v in (origin, (0.0, 0.0, 0.0), (0.0, 1.0, 0.1))))
    return Camera(pose, *size, **({"fov": 40.0} | options))


def sky(towards: torch.Tensor) -> torch.Tensor:
    """Radiance of which every second derivative is below 1, and no two directions are alike."""
    x, y, z = towards.unbind(-1)
    return torch.stack([1.5 + 0.5 * x + 0.2 * y, 1.5 + 0.4 * y - 0.3 * z + 0.1 * x * y, 1.5 + 0.6 * z], -1)


def metal(rho: float = 0.0, dtype=torch.float64) -> Appearance:
    return Appearance(Metal(*(tensor(*values, dtype=dtype) for values in GOLD), Blur(torch.tensor(rho, dtype=dtype))))


def matte(*color: float, maps: Maps | None = None) -> Appearance:
    return Appearance(Matte(tensor(*color), tensor(1.0, 1.0, 1.0)), maps or Maps())


def white_room() -> Surroundings:
    return Surroundings(Cubemap(torch.ones(6, 4, 4, 3)), diffuse.constant_ambient(tensor(1.0, 1.0, 1.0)))


@pytest.mark.parametrize("degrees", [0.0, 70.0])
def test_a_mirror_ball_shows_the_sky_under_lazanyis_reflectance(degrees):
    """The sphere's normals and mirrored views are known, and so is the sky, turned about +Y."""
    camera = view()
    found = render_shape(
        Sphere(), [metal()], camera, surroundings(Environment(sky(directions(128, 256)).float(), degrees))
    )
    row, column = torch.meshgrid(torch.arange(20), torch.arange(24), indexing="ij")
    origins, along = camera.rays(column + 0.5, row + 0.5)
    b, c = (origins * along).sum(-1), (origins**2).sum(-1) - 1
    hit = b**2 > c
    normal = origins + (-b - (b**2 - c).clamp_min(0).sqrt())[..., None] * along
    cosine = -(normal * along).sum(-1, keepdim=True)
    x, y, z = (along + 2 * cosine * normal).unbind(-1)
    turn = math.radians(-degrees)
    r = torch.stack([math.cos(turn) * x + math.sin(turn) * z, y, math.cos(turn) * z - math.sin(turn) * x], -1)
    n, k = (tensor(*values) for values in GOLD)
    f = ((n - 1) ** 2 + 4 * n * (1 - cosine) ** 5 + k**2) / ((n + 1) ** 2 + k**2)
    assert (found[..., 3] == hit).all()
    assert 0.3 < hit.double().mean() < 0.9
    assert (found[~hit] == 0).all()
    # bilinear lookups in a map of rows π/127 apart, and in a cubemap resampled from it with texels 2/256 wide
    apart = (found[..., :3] - sky(r) * f)[hit].abs()
    within = apart <= 2 * (math.pi / 127) ** 2 / 8 + 2 * (2 / 256) ** 2 / 8
    assert within.double().mean() > 0.95
    # where faces meet, a lookup takes in texels of another grid, half a texel beside its own, at half weight
    assert apart.max() < 0.7 * (2 / 256) / 4


def quad(uv: bool = True, normals: bool = True) -> Mesh:
    """The square [-1, 1]² in the plane z = 0, seen from +z; u grows with x, v with y."""
    corner = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    facing = np.tile([[0.0, 0.0, 1.0]], (4, 1))
    return Mesh(
        corner, np.array([[0, 1, 2], [0, 2, 3]]), facing if normals else None,
        corner[:, :2] / 2 + 0.5 if uv else None, np.zeros(2, int),
    )  # fmt: skip


FRONT = view(origin=(0.0, 0.0, 5.0), size=(8, 8), projection="orthographic", scale=1.0)
RAMP = torch.linspace(0.1, 0.9, 9)[None, :, None].expand(4, 9, 3) * tensor(1.0, 0.5, 0.25, dtype=torch.float32)


def picture(mesh: Mesh, appearance: Appearance, light: Surroundings | None = None) -> torch.Tensor:
    found = render(Model(mesh, (appearance,)), FRONT, light or white_room())
    assert (found[..., 3] == 1).all()
    return found[..., :3]


def at_pixels(texture: torch.Tensor) -> torch.Tensor:
    """A row of texels at u = (i + ½)/8, linear between texel centres and repeated, by numpy."""
    width = texture.shape[1]
    centres = (np.arange(-1, width + 1) + 0.5) / width
    values = np.concatenate([texture[:1, -1:], texture[:1], texture[:1, :1]], 1)[0]
    return torch.tensor(np.stack([np.interp((np.arange(8) + 0.5) / 8, centres, values[:, c]) for c in range(3)], -1))


def test_color_maps_multiply_the_color():
    found = picture(quad(), matte(0.5, 1.0, 0.8, maps=Maps(color=Texture(RAMP))))
    expected = at_pixels(RAMP) * tensor(0.5, 1.0, 0.8)
    torch.testing.assert_close(found, expected.expand(8, 8, 3), atol=1e-6, rtol=0)  # float32 lookups
    assert picture(quad(), dataclasses.replace(metal(), maps=Maps(color=Texture(RAMP)))).std(dim=1).max() < 1e-12


def test_occlusion_dims_what_is_scattered_and_doubles_reflections():
    maps = Maps(ambient_occlusion=Texture(RAMP[..., :1].contiguous()))
    openness = at_pixels(RAMP)[:, :1]
    torch.testing.assert_close(
        picture(quad(), matte(0.5, 1.0, 0.8, maps=maps)), (openness * tensor(0.5, 1.0, 0.8)).expand(8, 8, 3), atol=1e-6,
        rtol=0,
    )  # fmt: skip
    gold = dataclasses.replace(metal(), maps=maps)
    f = gold.material.f0
    torch.testing.assert_close(
        picture(quad(), gold), (openness * f + (1 - openness) * f**2).expand(8, 8, 3), atol=1e-6, rtol=0
    )


def test_normal_maps_turn_the_normal():
    """A map of one leaning normal: the plane is lit by a lamp as the leaning plane would be."""
    lean = tensor(0.36, 0.48, 0.8)
    maps = Maps(normal=Texture(((lean + 1) / 2).float().expand(2, 2, 3).contiguous()))
    lamp = DirectionalLightSpec(type="directional", direction=(0.0, 0.8, 0.6), irradiance=(math.pi, 1.0, 0.5))
    environment = Environment(torch.ones(2, 4, 3))
    light = surroundings(environment, [lamp], ambient=(0.0, 0.0, 0.0), size=4)
    found = picture(quad(), matte(1.0, 1.0, 1.0, maps=maps), light)
    expected = tensor(math.pi, 1.0, 0.5) / math.pi * (0.8 * 0.48 + 0.6 * 0.8)
    torch.testing.assert_close(found, expected.expand(8, 8, 3), atol=1e-6, rtol=0)
    plain = picture(quad(), matte(1.0, 1.0, 1.0), light)
    torch.testing.assert_close(plain, (tensor(math.pi, 1.0, 0.5) / math.pi * 0.6).expand(8, 8, 3))


def test_maps_need_what_they_are_laid_out_by():
    everything = Maps(Texture(RAMP), Texture(RAMP), Texture(RAMP[..., :1]))
    appearance = matte(0.5, 1.0, 0.8, maps=everything)
    torch.testing.assert_close(picture(quad(uv=False), appearance), tensor(0.5, 1.0, 0.8).expand(8, 8, 3))
    for shape in (quad(normals=False), Sphere()):
        (kept,) = applicable(shape, [appearance])
        assert kept.maps == dataclasses.replace(everything, normal=None)
    assert applicable(quad(), [appearance]) == (appearance,)


def painted() -> tuple[Mesh, tuple[Appearance, ...]]:
    found = trimesh.creation.icosphere(2)
    normals = np.array(found.vertices) / np.linalg.norm(found.vertices, axis=1, keepdims=True)
    material = np.random.default_rng(2).integers(0, 3, len(found.faces))
    mesh = Mesh(normals, np.asarray(found.faces), normals, None, material, ("a", "b", "c"))
    return mesh, (matte(0.9, 0.1, 0.2), matte(0.1, 0.8, 0.3), matte(0.2, 0.1, 0.7))


def test_every_face_is_of_its_material():
    mesh, appearances = painted()
    found = render(Model(mesh, appearances), view(), white_room())
    surface = gbuffer.pixel_centres(gbuffer.tracer(mesh), view())
    colors = torch.stack([each.material.color for each in appearances if isinstance(each.material, Matte)])
    torch.testing.assert_close(found[..., :3][surface.hit], colors[surface.material[surface.hit]])
    assert len(found[..., :3][surface.hit].unique(dim=0)) == 3


def test_pieces_and_shapes_make_no_difference(monkeypatch):
    mesh, _ = painted()
    glossy = Appearance(Glossy(tensor(0.9, 0.1, 0.2), tensor(0.1, 0.1, 0.1), Blur(tensor(0.3)[0])))
    appearances = (metal(0.2), glossy, matte(0.2, 0.1, 0.7))
    light = [shading.far_light(surroundings(Environment(sky(directions(16, 32)).float()), size=16))]
    surface = gbuffer.pixel_centres(gbuffer.tracer(mesh), view())
    whole = shade_surface(surface, appearances, light)
    monkeypatch.setattr(shading, "_CHUNK", 7)
    for other in (surface, surface.reshape(-1, 4)):
        found = shade_surface(other, appearances, light).reshape(whole.shape)
        torch.testing.assert_close(found, whole, atol=8 * 2.0**-23, rtol=0)  # lookups round as they are vectorised
    nothing = surface[torch.zeros_like(surface.hit)]
    assert shade_surface(nothing, appearances, light).shape == (0, 3)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_pictures_dtype_is_the_materials(dtype):
    lamp = DirectionalLightSpec(type="directional", direction=(0.0, 0.8, 0.6), irradiance=(1.0, 1.0, 1.0))
    light = surroundings(Environment(torch.ones(2, 4, 3)), [lamp], size=4)
    assert render_shape(Sphere(), [metal(0.1, dtype)], view(), light).dtype == dtype


@pytest.mark.parametrize("kind", ["metal", "glossy"])
def test_a_pictures_derivatives_meet_finite_differences(kind):
    """By n, k (or color, reflectance) and ρ at once."""
    light = [shading.far_light(surroundings(Environment(sky(directions(64, 128)).float()), size=64))]
    surface = gbuffer.pixel_centres(gbuffer.tracer(Sphere()), view(size=(6, 5)))
    low = tensor(0.3, 0.5, 1.4, 3.5, 2.3, 1.8, 0.3) if kind == "metal" else tensor(0.3, 0.2, 0.1, 0.1, 0.2, 0.3, 0.3)
    made = Metal if kind == "metal" else Glossy

    def shown(x: torch.Tensor) -> torch.Tensor:
        return shade_surface(surface, [Appearance(made(x[:3], x[3:6], Blur(x[6])))], light)

    found = torch.func.jacrev(shown)(low)
    step = 1e-2
    for i, axis in enumerate(torch.eye(7, dtype=torch.float64)):
        numerical = (shown(low + step * axis) - shown(low - step * axis)) / (2 * step)
        # third derivatives below 20 times step²/6, and lookups whose float32 rounding is divided by the step; along ρ
        # a bilinear lookup is smooth between texels alone: its slope jumps by second derivative · texel = 1/32, at
        # another place for each of the 49 taps
        bound = 20 * step**2 / 6 + 4 * 2.0**-23 / step + (i == 6) / 32 / 7
        torch.testing.assert_close(found[..., i], numerical, atol=bound, rtol=0)
    assert found.abs().amax((0, 1, 2)).min() > 5e-3  # every one of them shows


def test_only_what_reflects_shows_its_neighbours():
    """Two balls in a white room, one matte and black: the metal one darkens where it is mirrored, and only there."""
    mesh, _ = painted()
    both = Mesh(
        np.concatenate([mesh.vertices - np.array([1.1, 0, 0]), mesh.vertices + np.array([1.1, 0, 0])]),
        np.concatenate([mesh.faces, mesh.faces + len(mesh.vertices)]), np.tile(mesh.vertices, (2, 1)), None,
        *[np.repeat([0, 1], len(mesh.faces)), ("a", "b")] * 2,
    )  # fmt: skip
    model, camera = Model(both, (metal(), matte(0.0, 0.0, 0.0))), view((0.0, 0.5, 8.0), (48, 40))
    far, near = (render(model, camera, white_room(), neighbours=flag)[..., 0] for flag in (False, True))
    part = gbuffer.pixel_centres(gbuffer.tracer(both), camera).part
    darker = near < 0.5 * far
    assert darker.sum() > 5
    assert (part[darker] == 0).all()
    column = torch.arange(48).expand(40, 48)
    assert column[darker].double().mean() > column[(part == 0) & (far > 0)].double().mean() + 1  # where the other is
    torch.testing.assert_close(near[part == 1], far[part == 1])
