"""Distortion against OpenCV, and lenses as a scene file may have them."""

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.cameras.lens import Lens
from fit_material.renderer.cameras.undistortion import rectified
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.validation import check
from fit_material.renderer.scene.scene_file import CameraSpec, camera_of

POSE = np.eye(4)
WIDTH, HEIGHT = 640, 480
INTRINSICS = {"fx": 500.0, "fy": 510.0, "cx": 330.0, "cy": 225.0}
LENSES = [
    {},
    {"k1": -0.28, "k2": 0.09},  # a wide lens: barrel
    {"k1": 0.12, "k2": -0.02, "k3": 0.01},  # cushion
    {"p1": 0.003, "p2": -0.002},
    {"k1": -0.28, "k2": 0.07, "p1": 0.001, "p2": 0.002, "k3": 0.003},
]
coefficient = st.floats(-0.02, 0.02)


def film(count=200) -> tuple[torch.Tensor, torch.Tensor]:
    positions = np.random.default_rng(3).random((count, 2)) * [WIDTH, HEIGHT]
    return torch.from_numpy(positions[:, 0]), torch.from_numpy(positions[:, 1])


def opencv(lens: Lens) -> tuple[np.ndarray, np.ndarray]:
    """The lens in OpenCV's words; any origin of pixels will do, if both sides have the same."""
    matrix = np.array([[lens.fx, 0, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1]])
    return matrix, np.array([lens.k1, lens.k2, lens.p1, lens.p2, lens.k3])


def unit(points: np.ndarray) -> np.ndarray:
    """Directions in our axes through points of OpenCV's plane z = 1, which has y downwards."""
    directions = np.stack([points[:, 0], -points[:, 1], -np.ones(len(points))], -1)
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


@pytest.mark.parametrize("distortion", LENSES)
def test_rays_are_those_of_opencv(distortion):
    lens = Lens(**INTRINSICS, **distortion)
    camera = Camera(torch.from_numpy(POSE), WIDTH, HEIGHT, lens=lens)
    x, y = film()
    _, direction = camera.rays(x, y)
    pixels = torch.stack([x, y], -1).numpy()[:, None]
    until = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 1000, 1e-12)
    points = cv2.undistortPoints(pixels, *opencv(lens), criteria=until)[:, 0]
    np.testing.assert_allclose(direction.numpy(), unit(points), atol=1e-10)  # OpenCV stops at 10⁻¹²


@pytest.mark.parametrize("distortion", LENSES)
def test_what_a_ray_meets_is_projected_back_to_its_pixel(distortion):
    """OpenCV's forward projection has no iteration to agree with ours by chance."""
    lens = Lens(**INTRINSICS, **distortion)
    x, y = film()
    right, down = lens.plane(x, y)
    points = torch.stack([right, down, torch.ones_like(right)], -1).numpy() * 3
    pixels, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), *opencv(lens))
    np.testing.assert_allclose(pixels[:, 0], torch.stack([x, y], -1).numpy(), atol=1e-8)


@given(coefficient, coefficient, coefficient, coefficient, coefficient)
def test_small_distortions_can_be_undone(k1, k2, p1, p2, k3):
    """With r² < 1, no slope of the distortion is beyond (3 + 5 + 7 + 2·8) · 0.02 = 0.62: the picture cannot fold."""
    lens = Lens(**INTRINSICS, k1=k1, k2=k2, p1=p1, p2=p2, k3=k3)
    assert lens.can_be_undone(WIDTH, HEIGHT)
    x, y = film(20)
    right, down = lens.plane(x, y)
    again = lens.distorted(right, down)
    torch.testing.assert_close(again[0] * lens.fx + lens.cx, x, atol=1e-8, rtol=0)
    torch.testing.assert_close(again[1] * lens.fy + lens.cy, y, atol=1e-8, rtol=0)


def test_a_radial_lens_folds_where_its_polynomial_turns():
    """r(1 + k r²) rises up to r = 1/√(-3k), where it is ⅔ of that: beyond, no direction is seen."""
    k1 = -0.3
    furthest = 2 / 3 / np.sqrt(-3 * k1)
    for share, whole in ((0.99, True), (1.01, False)):
        half_diagonal = share * furthest * 100
        side = np.sqrt(2) * half_diagonal
        lens = Lens(100, 100, side / 2, side / 2, k1=k1)
        assert lens.can_be_undone(side, side) is whole


def test_a_lens_without_anything_is_the_pinhole():
    table = {"matrix": POSE.tolist(), "lens": {"width": WIDTH, "height": HEIGHT, "fx": 500.0}}
    camera = camera_of(CameraSpec.model_validate(table), WIDTH, HEIGHT)
    assert camera.lens is None
    x, y = film()
    straight = Camera(camera.camera_to_world, WIDTH, HEIGHT, lens=Lens(500, 500, WIDTH / 2, HEIGHT / 2))
    torch.testing.assert_close(camera.rays(x, y)[1], straight.rays(x, y)[1], atol=1e-14, rtol=0)


def test_a_photograph_of_another_size_is_the_same_view():
    table = {"matrix": POSE.tolist(), "lens": {"width": WIDTH, "height": HEIGHT, **INTRINSICS, "k1": -0.2}}
    spec = CameraSpec.model_validate(table)
    whole, half = (camera_of(spec, WIDTH // n, HEIGHT // n) for n in (1, 2))
    x, y = film()
    torch.testing.assert_close(half.rays(x / 2, y / 2)[1], whole.rays(x, y)[1], atol=1e-14, rtol=0)
    assert whole.fov == pytest.approx(2 * np.degrees(np.arctan(320 / 500)))


SIZE = {"width": WIDTH, "height": HEIGHT}


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        ({"lens": SIZE}, r"lens\.fx: expected a value here, but it is missing"),
        ({"lens": {**SIZE, "fx": 500.0}, "fov": 30.0}, "lens: expected no fov, scale or projection beside it"),
        ({"lens": {**SIZE, "fx": 500.0, "k9": 1.0}}, r"lens\.k9: is 1\.0, expected a known key, the nearest is k"),
        (
            {"lens": {**SIZE, "fx": 500.0, "k1": -2.0}},
            "lens: is .k1 = -2, .*, expected distortion that does not",
        ),
        ({"lens": {**SIZE, "fx": 500.0, "k3": float("nan")}}, r"lens\.k3: is nan, expected a finite number"),
        (
            {"lens": {**SIZE, "fx": 1e-300}},
            r"lens\.fx: is 1e-300, expected a focal length in pixels, of a hori",
        ),
    ],
)
def test_slips_about_lenses_are_one_sentence(table, sentence, tmp_path):
    with pytest.raises(InputError, match=sentence):
        check(CameraSpec, {"matrix": POSE.tolist(), **table}, tmp_path / "scene.toml")


@pytest.mark.parametrize("distortion", LENSES)
def test_rectified_pictures_are_opencv_s(distortion):
    lens = Lens(**INTRINSICS, **distortion)
    camera = Camera(torch.from_numpy(POSE), WIDTH, HEIGHT, lens=lens)
    row, column = np.mgrid[:HEIGHT, :WIDTH]
    picture = np.stack([column / WIDTH, row / HEIGHT, np.sin(column / 40)], -1).astype(np.float32)
    matrix, coefficients = opencv(lens)
    matrix[:2, 2] -= 0.5  # its pixels have their centres at whole numbers
    straight = np.array([[500.0, 0, WIDTH / 2 - 0.5], [0, 500.0, HEIGHT / 2 - 0.5], [0, 0, 1]])
    maps = cv2.initUndistortRectifyMap(matrix, coefficients, np.eye(3), straight, (WIDTH, HEIGHT), cv2.CV_32FC1)
    expected = cv2.remap(picture, *maps, cv2.INTER_LINEAR)
    found = rectified(torch.from_numpy(picture), camera).numpy()
    inside = (maps[0] > 0) & (maps[0] < WIDTH - 1) & (maps[1] > 0) & (maps[1] < HEIGHT - 1)
    assert inside.mean() > 0.7
    # OpenCV interpolates at 32nds of a pixel, so that it is off by 1/64, where these pictures rise by 1/40 at most
    np.testing.assert_allclose(found[inside], expected[inside], atol=1 / 64 / 40 + 1e-5)
    assert not found[(maps[0] < -1) | (maps[0] > WIDTH) | (maps[1] < -1) | (maps[1] > HEIGHT)].any()
