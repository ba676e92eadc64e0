"""The map's layout against Mitsuba's `envmap`, and the cleaning of what cannot be radiance."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fit_material.renderer.environment.cubemap import FACES, face_directions
from fit_material.renderer.environment.environment import Environment, directions
from fit_material.renderer.environment.environment_file import read_environment
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.images.image_file import write_exr

RNG = np.random.default_rng(11)


@pytest.fixture
def save(tmp_path):
    def write(pixels, name="map.exr"):
        write_exr(tmp_path / name, np.asarray(pixels, np.float32))
        return tmp_path / name

    return write


def random_map(height: int = 8) -> np.ndarray:
    return RNG.random((height, 2 * height, 3)).astype(np.float32)


def seen_by_mitsuba(environment: Environment, towards: np.ndarray) -> np.ndarray:
    """Radiance that Mitsuba's envmap sends from the world directions [p, 3]."""
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    turn = mi.ScalarTransform4f().rotate([0, 1, 0], environment.rotation)
    bitmap = mi.Bitmap(environment.radiance.numpy())
    scene = mi.load_dict({"type": "scene", "light": {"type": "envmap", "bitmap": bitmap, "to_world": turn}})
    rays = (mi.Ray3f(mi.Point3f(0), mi.Vector3f(*direction.tolist())) for direction in towards)
    return np.array([scene.environment().eval(scene.ray_intersect(ray)) for ray in rays])


@pytest.mark.parametrize("rotation", [0.0, 37.0, -200.0])
def test_mitsuba_sees_each_texel_in_its_direction(save, rotation):
    environment = read_environment(save(random_map()), rotation, scale=2.5)
    angle = math.radians(rotation)
    towards = directions(8, 16).numpy()[1:-1]  # on the poles themselves all columns meet
    x, y, z = np.moveaxis(towards, -1, 0)
    world = np.stack([x * math.cos(angle) + z * math.sin(angle), y, z * math.cos(angle) - x * math.sin(angle)], -1)
    found = seen_by_mitsuba(environment, world.reshape(-1, 3)).reshape(6, 16, 3)
    # float32 angles put a lookup about 1e-6 of a turn beside the texel's centre
    np.testing.assert_allclose(found, environment.radiance[1:-1].numpy(), atol=1e-4)


def test_centre_column_looks_along_z_and_top_row_along_y():
    found = directions(5, 9)
    torch.testing.assert_close(found[2, 4], torch.tensor([0.0, 0.0, 1.0]).double(), atol=1e-15, rtol=0)
    torch.testing.assert_close(found[0], torch.tensor([0.0, 1.0, 0.0]).double().expand(9, 3), atol=1e-15, rtol=0)
    torch.testing.assert_close(found[-1, :, 1], -torch.ones(9).double())


@given(st.integers(2, 40), st.integers(1, 40))
def test_directions_come_back_as_rows_and_columns(height, width):
    x, y, z = directions(height, width).unbind(-1)
    row = torch.acos(y) / math.pi * (height - 1)
    column = (torch.atan2(x, -z) / (2 * math.pi) % 1) * width - 0.5
    expected_row, expected_column = torch.meshgrid(
        torch.arange(height).double(), torch.arange(width).double(), indexing="ij"
    )
    # acos loses half of float64's digits at the poles, where moreover no column can be told
    torch.testing.assert_close(row, expected_row, atol=1e-6, rtol=0)
    torch.testing.assert_close(column[1:-1], expected_column[1:-1], atol=1e-9, rtol=0)


def test_smallest_map_lies_on_the_horizon(save):
    assert read_environment(save(random_map(1))).radiance.shape == (1, 2, 3)
    expected = torch.tensor([[[1.0, 0, 0], [-1.0, 0, 0]]]).double()
    torch.testing.assert_close(directions(1, 2), expected, atol=1e-15, rtol=0)


def test_broken_texels_are_repaired_and_counted(save):
    pixels = random_map()
    pixels[3, 3, 1] = -2
    pixels[5, 9] = np.nan
    pixels[0, 0, 2] = np.inf
    found = read_environment(save(pixels))
    assert found.repaired == 3
    assert found.radiance[3, 3, 1] == 0
    around = np.delete(pixels[4:7, 8:11].reshape(9, 3), 4, axis=0)
    np.testing.assert_allclose(found.radiance[5, 9], around.mean(0), rtol=1e-6)
    corner = (pixels[0, 1, 2] + pixels[1, 0, 2] + pixels[1, 1, 2]) / 3
    np.testing.assert_allclose(found.radiance[0, 0, 2], corner, rtol=1e-6)
    untouched = np.isfinite(pixels) & (pixels >= 0)
    np.testing.assert_array_equal(found.radiance.numpy()[untouched], pixels[untouched])


def test_texel_without_finite_neighbours_becomes_black(save):
    pixels = random_map()
    pixels[2:5, 2:5] = np.inf
    found = read_environment(save(pixels))
    assert not found.radiance[3, 3].any()
    assert found.repaired == 9


def radiance_by_direction(towards: torch.Tensor) -> torch.Tensor:
    """Smooth, and different along each axis and its opposite."""
    return torch.stack([2 + towards[..., 0], 2 + towards[..., 1], 2 + 0.5 * towards[..., 2]], -1)


def test_six_faces_become_the_map_they_surround(save):
    for name, towards in zip(FACES, face_directions(16), strict=True):
        path = save(radiance_by_direction(towards), f"{name}.exr")
    found = read_environment(path.parent)
    assert found.radiance.shape == (32, 64, 3)
    expected = radiance_by_direction(directions(32, 64)).numpy()
    # a texel of a 16² face spans 1/8 at the distance 1; interpolation errs by the square of half of that, 4e-3,
    # and by a third of it, 0.04, at the corners, where three texels are averaged
    np.testing.assert_allclose(found.radiance, expected, atol=0.04)
    assert np.abs(found.radiance.numpy() - expected).mean() < 2e-3


def test_missing_face_is_named(save):
    for name in FACES[:-1]:
        path = save(np.ones((4, 4, 3)), f"{name}.exr")
    with pytest.raises(InputError, match="nz: is 0 files, expected one image per face"):
        read_environment(path.parent)


@pytest.mark.parametrize(
    ("shape", "sentence"),
    [
        ((4, 5), r"pz\.exr: size: is 5 × 4, expected a square face"),
        ((8, 8), "pz: is 8 × 8, expected the size of px"),
    ],
)
def test_uneven_faces_are_named(save, shape, sentence):
    for name in FACES:
        path = save(np.ones((*(shape if name == "pz" else (4, 4)), 3)), f"{name}.exr")
    with pytest.raises(InputError, match=sentence):
        read_environment(path.parent)


@pytest.mark.parametrize("shape", [(4, 4), (4, 9), (8, 4), (1, 1)])
def test_wrong_aspect_ratio(save, shape):
    with pytest.raises(InputError, match=rf"map\.exr: size: is {shape[1]} × {shape[0]}, expected a map twice as wide"):
        read_environment(save(np.ones((*shape, 3))))


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan])
def test_black_maps_show_nothing(save, value):
    with pytest.raises(
        InputError, match=r"map\.exr: expected light from somewhere, but no texel is a finite number above 0"
    ):
        read_environment(save(np.full((4, 8, 3), value)))


@pytest.mark.parametrize("scale", [0.0, -1.0, math.inf, math.nan, 1e39])
def test_impossible_scale(save, scale):
    with pytest.raises(InputError, match=r"map\.exr: scale: is .*, expected a (finite number > 0|factor)"):
        read_environment(save(np.ones((4, 8, 3))), scale=scale)


def test_impossible_rotation(save):
    with pytest.raises(InputError, match=r"map\.exr: rotation: is nan, expected a finite angle in degrees"):
        read_environment(save(np.ones((4, 8, 3))), rotation=math.nan)


def test_missing_map(tmp_path):
    with pytest.raises(InputError, match=r"none\.hdr: expected an image file here, but there is none"):
        read_environment(tmp_path / "none.hdr")
