"""What Mitsuba reads back or sees, against what was asked for."""

import os
import subprocess
import sys

import numpy as np
import pytest
import torch

from fit_material.renderer.cameras.camera import Camera, look_at
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.geometry.mesh import Mesh, Sphere
from fit_material.renderer.materials.bsdf import conductor
from fit_material.renderer.mitsuba.conversion import envmap, mitsuba, mitsuba_shape, sensor, variant_here

pytestmark = pytest.mark.dr_jit

FLOAT32 = 1e-6  # what remains of unit vectors and colours after Mitsuba's float32


@pytest.fixture(scope="module")
def mi():
    return mitsuba("scalar_rgb")


def soup(smooth: bool, faces: int = 20) -> Mesh:
    """Triangles with no order or symmetry to hide a permutation."""
    rng = np.random.default_rng(7)
    vertices = rng.normal(size=(30, 3))
    return Mesh(
        vertices=vertices,
        faces=np.stack([rng.choice(30, size=3, replace=False) for _ in range(faces)]),
        normals=vertices / np.linalg.norm(vertices, axis=1, keepdims=True) if smooth else None,
        uv=rng.random((30, 2)),
        material=np.zeros(faces, dtype=int),
    )


def hit(mi, shape, face: int, weights: np.ndarray):
    """What a short ray meets at these barycentric weights of `face`, and the facet's unit normal."""
    corners = shape.vertices[shape.faces[face]]
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    normal /= np.linalg.norm(normal)
    origin = weights @ corners + 1e-3 * normal  # so near that no other triangle stands between
    scene = mi.load_dict({"type": "scene", "shape": mitsuba_shape(shape)})
    return scene.ray_intersect(mi.Ray3f(mi.Point3f(*origin), mi.Vector3f(*-normal))), normal


@pytest.mark.parametrize("face", range(0, 20, 3))
@pytest.mark.parametrize("smooth", [True, False])
def test_faces_keep_their_order_and_normals(mi, smooth, face):
    shape, weights = soup(smooth), np.array([0.5, 0.3, 0.2])
    found, flat = hit(mi, shape, face, weights)
    expected = flat
    if shape.normals is not None:
        expected = weights @ shape.normals[shape.faces[face]]
        expected /= np.linalg.norm(expected)
    assert found.prim_index == face
    # the ray starts 1e-3 away: float32 leaves 1e-4 of the position, hence of the interpolated normal and uv
    np.testing.assert_allclose(np.array(found.n), flat, atol=1e-5)
    np.testing.assert_allclose(np.array(found.sh_frame.n), expected, atol=1e-4)
    np.testing.assert_allclose(np.array(found.uv), weights @ shape.uv[shape.faces[face]], atol=1e-4)


def test_the_sphere_is_the_unit_sphere_at_the_origin(mi):
    box = mitsuba_shape(Sphere()).bbox()
    np.testing.assert_allclose([np.array(box.min), np.array(box.max)], [[-1] * 3, [1] * 3], atol=FLOAT32)


@pytest.mark.parametrize("size", [(40, 24), (24, 40)])
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_the_sensor_looks_where_the_camera_does(mi, projection, size):
    pose = look_at(*map(torch.tensor, ([1.0, 2.0, 3.0], [0.1, 0.2, -0.3], [0.2, 1.0, 0.1])))
    camera = Camera(pose, *size, projection, fov=50.0, scale=1.7)
    device = mi.load_dict(sensor(camera))
    for x, y in np.random.default_rng(3).random((20, 2)):
        ray, _ = device.sample_ray(0, 0.5, mi.Point2f(x, y), mi.Point2f(0.5))
        origin, direction = (
            v[0].numpy() for v in camera.rays(torch.tensor([x * size[0]]), torch.tensor([y * size[1]]))
        )
        offset = np.array(ray.o) - origin  # Mitsuba starts at its near plane: only across the ray must they agree
        np.testing.assert_allclose(np.array(ray.d), direction, atol=FLOAT32)
        np.testing.assert_allclose(offset - (offset @ direction) * direction, 0, atol=3 * FLOAT32)


@pytest.mark.parametrize("shape", [Sphere(), soup(smooth=True)])
def test_mitsuba_reads_back_the_indices_that_were_asked_for(mi, shape):
    n, k = (0.15, 1.4, 3.2), (3.5, 0.0, 7.5)  # below and above 1, where a colour might be clamped
    held = mi.traverse(mitsuba_shape(shape, conductor(n, k, 0.2, "beckmann")))
    assert list(held["bsdf.eta.value"]) == pytest.approx(n, abs=FLOAT32)
    assert list(held["bsdf.k.value"]) == pytest.approx(k, abs=FLOAT32)
    assert held["bsdf.alpha.value"] == pytest.approx(0.2, abs=FLOAT32)


def radiance_towards(mi, emitter, direction: np.ndarray) -> np.ndarray:
    interaction = mi.SurfaceInteraction3f()
    interaction.wi = mi.Vector3f(*-direction)
    return np.array(emitter.eval(interaction))


@pytest.mark.parametrize("rotation", [0.0, 35.0])
def test_the_map_keeps_colours_and_orientation(mi, rotation):
    """At the texels' own directions the map must read exactly, whatever its turn about +Y."""
    height, width = 6, 12
    radiance = torch.as_tensor(np.random.default_rng(5).uniform(0.01, 90, (height, width, 3)), dtype=torch.float32)
    emitter = mi.load_dict(envmap(Environment(radiance, rotation)))
    for row in range(1, height - 1):
        theta = np.pi * row / (height - 1)
        for column in range(width):
            phi = 2 * np.pi * (column + 0.5) / width
            # u = atan2(x, -z)/2π; turning the map by +90° carries what was seen along +Z to +X
            turned = phi - np.deg2rad(rotation)
            direction = np.array([np.sin(theta) * np.sin(turned), np.cos(theta), -np.sin(theta) * np.cos(turned)])
            seen = radiance_towards(mi, emitter, direction)
            # between neighbours that differ by up to 90, float32 places the lookup within 1e-5 texels
            np.testing.assert_allclose(seen, radiance[row, column].numpy(), atol=90 * 1e-5)


def test_an_unknown_variant_is_answered_with_the_known_ones():
    with pytest.raises(InputError, match=r"--variant: is gpu, expected one of scalar_rgb, llvm_ad_rgb"):
        mitsuba("gpu")


def test_without_llvm_the_user_learns_which_package_to_install():
    code = "from fit_material.renderer.mitsuba.conversion import mitsuba; mitsuba('llvm_ad_rgb')"
    environment = {**os.environ, "FIT_MATERIAL_LLVM": "none"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
    assert "InputError: --variant: is llvm_ad_rgb, expected LLVM's shared library" in done.stderr
    assert "libllvm19" in done.stderr


@pytest.mark.parametrize("without", [False, True])
def test_the_fast_variant_is_taken_where_llvm_is_and_else_the_one_that_needs_nothing(without):
    code = "from fit_material.renderer.mitsuba.conversion import variant_here; print(variant_here())"
    environment = {**os.environ, **({"FIT_MATERIAL_LLVM": "none"} if without else {})}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True)
    expected = "scalar_rgb" if without or not has_llvm() else "llvm_ad_rgb"
    assert done.stdout.split()[-1] == expected


def test_a_variant_asked_for_by_name_is_that_one_or_an_error(mi):
    assert variant_here("scalar_rgb") == "scalar_rgb"
    with pytest.raises(InputError, match=r"--variant: is gpu"):
        variant_here("gpu")


def has_llvm() -> bool:
    try:
        mitsuba("llvm_ad_rgb")
    except InputError:
        return False
    finally:
        mitsuba("scalar_rgb")
    return True
