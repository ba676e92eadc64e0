"""Photographs beside and over the render; what a display shows, against numpy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.images.image_file import png, write_exr
from fit_material.renderer.opengl.refinement import Refinement, sample_offsets
from fit_material.renderer.scene.scene_file import read_scene
from fit_material.renderer.viewer.compare import (
    DIFFERENCE_RANGE,
    GAP,
    Area,
    Photograph,
    Photographs,
    areas,
    exposure_factor,
)
from fit_material.renderer.viewer.display import Display, draw_whole
from fit_material.renderer.viewer.eye import Eye
from fit_material.renderer.viewer.look import COMPARISONS, Look
from fit_material.shaders.tone_mapping import CURVES, tone_mapped

WIDTH, HEIGHT = 12, 8
LOOK = Look(Eye((0.0, 0.0, 0.0), 5.0))
ONE_CODE = 1 / 255 * 0.5 + 1e-5  # half a step of 8 bits, and float32 arithmetic before it


def film(width: int, height: int) -> Camera:
    return Eye((0.0, 0.0, 0.0), 5.0).camera(width, height)


def ramp(width: int, height: int) -> np.ndarray:
    """Radiance that is different in every pixel, and coverage; the first row is the uppermost."""
    row, column = np.mgrid[0:height, 0:width].astype(np.float32)
    return np.stack([column / width, row / height, 0.5 + 0 * row, (row > 0).astype(np.float32)], -1)


class Wallpaper:
    """Stands for a stage: fills its target with a ramp, brighter by the sample's offset, darker without the sky."""

    def __init__(self) -> None:
        self.drawn = []

    def draw(self, framebuffer, camera, *, sky=True, rotation=0.0, offset=(0.0, 0.0)):
        self.drawn.append((camera, sky, rotation, offset))
        pixels = ramp(*framebuffer.size)[::-1] * (1.0 if sky else 0.5) + np.float32(offset[0])
        framebuffer.color_attachments[0].write(pixels.astype(np.float32).tobytes())


def photograph(**changes) -> Photograph:
    """Upright and unsymmetrical: like the ramp, but mirrored, three times as bright, and not compared at the left."""
    compared = np.ones((HEIGHT, WIDTH), bool)
    compared[:, :3] = False
    made = Photograph("p.exr", 3 * ramp(WIDTH, HEIGHT)[:, ::-1, :3], compared, film(WIDTH, HEIGHT), True, True)
    return replace(made, **changes)


def shown(gl, look: Look, over: Photograph | None = None, size=(WIDTH, HEIGHT), antialias=1) -> np.ndarray:
    """What the display shows, in [0, 1]."""
    display = Display(gl, antialias)
    codes = draw_whole(gl, display, size, Wallpaper(), look, over)  # type: ignore[arg-type]
    display.release()
    return codes / 255


def coded(radiance: np.ndarray, look: Look) -> np.ndarray:
    return tone_mapped(torch.from_numpy(np.ascontiguousarray(radiance)), look.exposure, look.curve).numpy()


sides = st.integers(30, 3000)


@given(st.sampled_from(COMPARISONS), sides, sides, sides, sides)
def test_areas_lie_in_the_window_apart_and_in_proportion(comparison, width, height, photo_width, photo_height):
    found = areas(comparison, width, height, film(photo_width, photo_height))
    assert len(found) == (2 if comparison == "beside" else 1)
    for area in found:
        assert 0 <= area.x <= area.x + area.width <= width
        assert 0 <= area.y <= area.y + area.height <= height
        assert min(area.width, area.height) >= 1
        if comparison != "off":  # each side is rounded to whole pixels, by half a pixel at most, but to one at least
            error = abs(area.width * photo_height - area.height * photo_width)
            assert error <= 1.01 * max(photo_width, photo_height)
    if comparison == "beside":
        one, two = found
        apart = two.x - one.x - one.width, one.y - two.y - two.height
        assert max(apart) >= GAP
        assert (one.width, one.height) == (two.width, two.height)


def test_beside_is_where_there_is_more_room():
    wide, high = areas("beside", 200, 100, film(10, 10)), areas("beside", 100, 200, film(10, 10))
    assert wide[0].width == wide[1].width == 98
    assert wide[0].x < wide[1].x  # the photograph at the left, or above
    assert high[0].height == high[1].height == 98
    assert high[0].y > high[1].y
    assert areas("swipe", 200, 100, film(10, 10)) == (Area(50, 0, 100, 100),)


def test_an_unknown_exposure_is_found():
    rendered = ramp(WIDTH, HEIGHT)[..., :3]
    compared = np.ones((HEIGHT, WIDTH), bool)
    assert exposure_factor(0.25 * rendered, rendered, compared) == pytest.approx(4)
    compared[0] = False
    spoiled = 0.25 * rendered
    spoiled[0] = 77
    assert exposure_factor(spoiled, rendered, compared) == pytest.approx(4)
    for black in (0 * rendered, 0 * rendered - 0.0):
        assert exposure_factor(black, rendered, compared) == exposure_factor(rendered, black, compared) == 1
    assert exposure_factor(rendered, rendered, compared & False) == 1


@pytest.mark.parametrize("curve", CURVES)
@pytest.mark.parametrize("exposure", [-1.5, 0.0, 2.0])
def test_the_display_is_the_twin_of_torch(gl, curve, exposure):
    look = replace(LOOK, curve=curve, exposure=exposure)
    np.testing.assert_allclose(shown(gl, look), coded(ramp(WIDTH, HEIGHT)[..., :3], look), atol=ONE_CODE)


def test_swipe_shows_the_photograph_at_the_left_of_the_edge(gl):
    look = replace(LOOK, comparison="swipe", edge=0.5)
    picture = shown(gl, look, photograph())
    rendered = coded(0.5 * ramp(WIDTH, HEIGHT)[..., :3], look)  # without the sky, since the photograph has none
    left, right = slice(0, WIDTH // 2 - 1), slice(WIDTH // 2 + 1, None)  # the edge itself is two pixels wide
    np.testing.assert_allclose(picture[:, left], coded(photograph().radiance, look)[:, left], atol=ONE_CODE)
    np.testing.assert_allclose(picture[:, right], rendered[:, right], atol=ONE_CODE)


def test_the_sky_is_drawn_behind_a_photograph_that_has_one(gl):
    look = replace(LOOK, comparison="swipe", edge=0.0)
    picture = shown(gl, look, photograph(cut_out=False))
    np.testing.assert_allclose(picture[:, 1:], coded(ramp(WIDTH, HEIGHT)[..., :3], look)[:, 1:], atol=ONE_CODE)


@pytest.mark.parametrize("curve", CURVES)
def test_the_difference_is_linear_signed_and_grey_where_nothing_is_compared(gl, curve):
    look = replace(LOOK, comparison="difference", exposure=-2.0, curve=curve)
    over = photograph()
    difference = (0.5 * ramp(WIDTH, HEIGHT)[..., :3] - over.radiance) / 4 * over.compared[..., None]
    expected = 0.5 + 0.5 * np.clip(difference / DIFFERENCE_RANGE, -1, 1)
    np.testing.assert_allclose(shown(gl, look, over), expected, atol=ONE_CODE)
    assert (difference > 0).any()
    assert (difference < 0).any()


def test_beside_shows_both(gl):
    look = replace(LOOK, comparison="beside", curve="reinhard")
    size = 2 * WIDTH + GAP, HEIGHT
    picture = shown(gl, look, photograph(), size)
    np.testing.assert_allclose(picture[:, :WIDTH], coded(photograph().radiance, look), atol=ONE_CODE)
    np.testing.assert_allclose(picture[:, -WIDTH:], coded(0.5 * ramp(WIDTH, HEIGHT)[..., :3], look), atol=ONE_CODE)


def test_an_unknown_exposure_makes_the_same_picture(gl):
    """The same render as a photograph of a tenth of the exposure: no difference."""
    over = photograph(radiance=0.05 * ramp(WIDTH, HEIGHT)[..., :3], exposure_known=False)
    np.testing.assert_allclose(shown(gl, replace(LOOK, comparison="difference"), over), 0.5, atol=ONE_CODE)
    np.testing.assert_allclose(
        shown(gl, replace(LOOK, comparison="swipe", edge=1.0), over)[:, :-1],
        coded(0.5 * ramp(WIDTH, HEIGHT)[..., :3], LOOK)[:, :-1],
        atol=ONE_CODE,
    )


def test_the_photographs_camera_is_used_as_it_is(gl):
    stage, over = Wallpaper(), photograph()
    display = Display(gl, 1)
    draw_whole(gl, display, (40, 40), stage, replace(LOOK, comparison="swipe"), over)  # type: ignore[arg-type]
    assert stage.drawn[-1][0] is over.camera
    draw_whole(gl, display, (40, 40), stage, LOOK, over)  # type: ignore[arg-type] — no comparison is on
    assert (stage.drawn[-1][0].width, stage.drawn[-1][0].height) == (40, 40)
    display.release()


def test_refinement_takes_the_mean_and_stops(gl):
    stage, refinement = Wallpaper(), Refinement(gl, 3)
    camera, size = film(4, 3), (4, 3)
    drawn = [refinement.add(stage, camera, size, True, 0.0) for _ in range(11)]  # type: ignore[arg-type]
    assert drawn == [True] * 9 + [False] * 2
    assert refinement.finished
    np.testing.assert_allclose(refinement.mean(), ramp(*size), atol=1e-6)  # offsets cancel, but for nine roundings
    for change in ((camera, (5, 3), True, 0.0), (camera, (5, 3), False, 0.0), (film(9, 3), (5, 3), False, 0.0)):
        assert refinement.add(stage, *change)  # type: ignore[arg-type]
        assert refinement.count == 1
    refinement.add(stage, *change)  # type: ignore[arg-type]
    assert refinement.count == 2
    refinement.forget()
    refinement.add(stage, *change)  # type: ignore[arg-type]
    assert refinement.count == 1
    refinement.release()


@pytest.mark.parametrize("antialias", [1, 2, 3, 4, 8])
def test_samples_fill_the_pixel(antialias):
    offsets = np.array(sample_offsets(antialias))
    grid = (np.arange(antialias) + 0.5) / antialias - 0.5
    expected = {(x, y) for x in grid for y in grid}
    assert {tuple(offset) for offset in offsets.tolist()} == expected
    # no half of the pixel has twice its share after any four samples of many
    if antialias >= 4:
        assert np.abs((offsets[:4] > 0).mean(0) - 0.5).max() <= 0.25


def test_photographs_are_read_when_they_are_wanted(tmp_path):
    scene = write_scene(tmp_path)
    photographs = Photographs(scene)
    (tmp_path / "two.exr").write_bytes(b"broken")
    assert len(photographs.cameras) == 3
    first = photographs[0]
    assert (first.camera.width, first.camera.height, first.camera.fov) == (WIDTH, HEIGHT, 40)
    np.testing.assert_allclose(first.radiance, ramp(WIDTH, HEIGHT)[..., :3] / 2)  # of exposure 2
    assert first.cut_out
    np.testing.assert_array_equal(first.compared[0], False)  # uncovered
    np.testing.assert_array_equal(first.compared[1:, 6:], True)
    np.testing.assert_array_equal(first.compared[:, :6], False)  # masked out
    assert photographs[0] is first
    with pytest.raises(InputError, match=r"two\.exr"):
        photographs[1]
    third = photographs[2]
    assert not third.cut_out
    assert not third.exposure_known
    assert not third.compared[2, 3]
    assert np.isfinite(third.radiance).all()
    with pytest.raises(InputError, match="--view: is 4, expected 1 to 3"):
        photographs[3]


def test_a_mask_of_another_size_is_told(tmp_path):
    scene = write_scene(tmp_path)
    Image.new("L", (3, 3)).save(tmp_path / "mask.png")
    with pytest.raises(InputError, match=r"photographs\[0\]\.mask: is 3 × 3, expected 12 × 8"):
        Photographs(scene)[0]


def test_a_png_keeps_its_codes(tmp_path):
    codes = (ramp(WIDTH, HEIGHT)[::-1, :, :3] * 255).astype(np.uint8)  # of negative strides, as they come from GL
    (tmp_path / "p.png").write_bytes(png(codes))
    np.testing.assert_array_equal(np.array(Image.open(tmp_path / "p.png")), codes)


def write_scene(folder):
    """Three photographs: masked and of known exposure; plain; of unknown exposure, with a pixel that is no number."""
    pixels = ramp(WIDTH, HEIGHT)
    write_exr(folder / "one.exr", pixels)
    write_exr(folder / "two.exr", pixels[..., :3])
    pixels[2, 3, 1] = np.nan
    write_exr(folder / "three.exr", pixels[..., :3])
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[:, 6:] = 255
    Image.fromarray(mask).save(folder / "mask.png")
    write_exr(folder / "map.exr", np.ones((4, 8, 3), np.float32))
    camera = "[photographs.camera]\norigin = [0.0, 0.0, 5.0]\ntarget = [0.0, 0.0, 0.0]\nfov = 40.0\n"
    tables = (
        'image = "one.exr"\nmask = "mask.png"\nexposure = 2.0',
        'image = "two.exr"',
        'image = "three.exr"\nexposure = "fit"',
    )
    head = '[geometry]\nshape = "sphere"\n[environment]\nmap = "map.exr"\n'
    path = folder / "scene.toml"
    path.write_text(head + "".join(f"[[photographs]]\n{table}\n{camera}" for table in tables), "utf-8")
    assert read_scene(path)
    return path
