"""Light from a mirror ball: surroundings that Mitsuba mirrors in a ball of chromium come back."""

import math

import numpy as np
import pytest
import torch
from PIL import Image as PillowImage
from typer.testing import CliRunner

from fit_material.fitter.commands.app import app
from fit_material.renderer.cameras.camera import Camera, look_at
from fit_material.renderer.environment.environment import Environment, directions
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.geometry.mesh import Sphere
from fit_material.renderer.images.image_file import read_image, write_exr
from fit_material.renderer.light_probe.mirror_ball import Circle, find_ball
from fit_material.renderer.light_probe.probe import probe
from fit_material.renderer.materials.bsdf import conductor
from fit_material.renderer.materials.catalogue import metal
from fit_material.renderer.path_tracing.path_tracer import render
from tests.renderer.photographs.test_exposure import exif, srgb_codes

SIZE, HALF_WIDTH = 192, 1.5
RADIUS = SIZE / (2 * HALF_WIDTH)
CHROME = metal("Cr")


def sky(height: int) -> torch.Tensor:
    """Radiance from 0.2 to 1.8 without symmetry, that changes by about 1.5 a radian at most."""
    x, y, z = directions(height, 2 * height).unbind(-1)
    return torch.stack([1 + 0.5 * x + 0.2 * y * z, 1 + 0.5 * y + 0.2 * z * x, 1 + 0.5 * z - 0.2 * x * y], -1).float()


@pytest.fixture(scope="module")
def ball() -> np.ndarray:
    """The ball from far away in +Z, off the middle, before a bright wall."""
    origin, target = torch.tensor([0.2, -0.1, 5.0]), torch.tensor([0.2, -0.1, 0.0])
    pose = look_at(origin, target, torch.tensor([0.0, 1, 0]))
    camera = Camera(pose, SIZE, SIZE, "orthographic", scale=HALF_WIDTH)
    picture = render(Sphere(), camera, Environment(sky(64)), conductor(CHROME.n, CHROME.k, 0.0), spp=32)
    return picture[..., :3] + 3 * (1 - picture[..., 3:])


TRUTH = Circle(SIZE / 2 - 0.2 * RADIUS, SIZE / 2 - 0.1 * RADIUS, RADIUS)


def assert_is_the_sky(found: np.ndarray, tolerance: float) -> None:
    """But for what is straight behind the ball, of which it shows nothing."""
    height = len(found)
    seen = directions(height, 2 * height)[..., 2].numpy() > -math.cos(math.radians(25))
    np.testing.assert_allclose(found[seen], sky(height).numpy()[seen], atol=tolerance)


@pytest.mark.parametrize("given", [True, False])
def test_the_surroundings_come_back(ball, tmp_path, given):
    write_exr(tmp_path / "ball.exr", ball)
    found = probe([tmp_path / "ball.exr"], tmp_path / "map.exr", circle=TRUTH if given else None, height=32)
    assert found.clipped == 0
    # beside the rim, 25° from straight behind, a pixel spans 2/(64 · 0.22) = 0.14 rad, over which the sky changes by
    # 0.2: interpolation, or a circle that is a tenth of a pixel off, is off by a tenth of it
    assert_is_the_sky(read_image(tmp_path / "map.exr").radiance, 0.02)


def test_the_ball_is_found(ball, tmp_path):
    circle = find_ball(ball, tmp_path)
    # edges are told to a pixel, 0.3 rms, and 400 of them make the circle; those of the mirrored world do not lie on it
    assert math.hypot(circle.x - TRUTH.x, circle.y - TRUTH.y) < 0.25
    assert abs(circle.radius - TRUTH.radius) < 0.25


def test_exposures_are_merged(ball, tmp_path):
    """8-bit sRGB, of which the longest exposure clips most of the ball."""
    balls = []
    for i, time in enumerate((0.125, 0.5, 2.0)):
        balls.append(tmp_path / f"{i}.png")
        PillowImage.fromarray(srgb_codes(ball * time)).save(balls[-1], exif=exif(time))
    found = probe(balls, tmp_path / "map.exr", circle=TRUTH, height=32)
    assert found.clipped == 0
    assert_is_the_sky(read_image(tmp_path / "map.exr").radiance, 0.02 + 0.02)  # and what codes round off


def test_clipped_lamps_are_told(ball, tmp_path):
    PillowImage.fromarray(srgb_codes(ball)).save(tmp_path / "ball.png")
    arguments = ["probe", str(tmp_path / "ball.png"), "-o", str(tmp_path / "map.exr"), "--height", "16"]
    told = CliRunner().invoke(app, [*arguments, "--circle", *map(str, (TRUTH.x, TRUTH.y, TRUTH.radius))])
    assert told.exit_code == 0
    assert "clipped, or beside what is: " in told.stdout
    assert np.isfinite(read_image(tmp_path / "map.exr").radiance).all()


def test_another_metal_dims_otherwise(ball, tmp_path):
    write_exr(tmp_path / "ball.exr", ball)
    for name in ("Cr", "Ag"):
        probe([tmp_path / "ball.exr"], tmp_path / f"{name}.exr", circle=TRUTH, surface=name, height=9)
    front = [read_image(tmp_path / f"{name}.exr").radiance[4, 8:10].mean(0) for name in ("Cr", "Ag")]
    expected = np.divide(*(((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2) for n, k in map(_index, ("Ag", "Cr"))))
    np.testing.assert_allclose(front[0] / front[1], expected, rtol=1e-3)  # ±10° off, F is F0 to 10⁻⁴


def _index(name: str) -> tuple[np.ndarray, np.ndarray]:
    return np.array(metal(name).n), np.array(metal(name).k)


@pytest.mark.parametrize("name", [f"dir_{i}_chrome32.jpg" for i in (0, 7, 20)])
def test_real_chrome_balls(shared_data, tmp_path, name):
    """Cropped to their outline, so that it has to be given; each shows its flash, clipped by 8 bits, in a dim room."""
    folder = shared_data / "photos/multi_illum/tests/data/everett_kitchen2/probes"
    found = probe([folder / name], tmp_path / "map.exr", circle=Circle(16, 16, 16), height=32)
    radiance = read_image(tmp_path / "map.exr").radiance
    assert np.isfinite(radiance).all()
    assert radiance.max() >= 1  # white, dimmed by chromium
    assert found.clipped > 0


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"out": "map.png"}, r"-o: is .*map\.png, expected a file that ends in \.exr"),
        ({"surface": "chromite"}, "--metal: is 'chromite', expected a known metal"),
        (
            {"circle": Circle(math.nan, 20, 9)},
            r"--circle: is nan 20 9, expected a circle inside the picture of 40 × 30",
        ),
        ({"circle": Circle(500, 500, 20)}, "--circle: is 500 500 20, expected a circle inside the picture of 40 × 30"),
        ({"circle": Circle(10, 10, 100)}, "--circle: is 10 10 100, expected a circle inside the picture of 40 × 30"),
        ({"circle": Circle(20, 15, 0)}, "--circle: is 20 15 0, expected a circle inside the picture of 40 × 30"),
        ({}, r"flat\.png: expected a picture with the outline of a ball; or say where it is by --circle"),
    ],
)
def test_slips_about_balls(tmp_path, options, sentence):
    PillowImage.new("RGB", (40, 30), (90, 90, 90)).save(tmp_path / "flat.png")
    out = tmp_path / options.pop("out", "map.exr")
    with pytest.raises(InputError, match=sentence):
        probe([tmp_path / "flat.png"], out, **options)
    assert not out.exists()


def test_a_ball_that_is_all_clipped_is_no_map(tmp_path):
    PillowImage.new("RGB", (40, 30), (255, 255, 255)).save(tmp_path / "white.png")
    with pytest.raises(
        InputError, match=r"white\.png: is 100% of the ball at --circle .* clipped, expected a shorter exp"
    ):
        probe([tmp_path / "white.png"], tmp_path / "map.exr", circle=Circle(20, 15, 12))
    assert not (tmp_path / "map.exr").exists()
