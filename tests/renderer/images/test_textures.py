"""Texture files against what was written, and lookups against scipy's interpolation."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image
from scipy.ndimage import map_coordinates

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.images.textures import Texture, lookup, read_texture
from tests.support.srgb_curve import decoded

CODES = np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3) * 14


@pytest.mark.parametrize("ending", ["png", "gif", "tga", "webp", "bmp", "tif"])
def test_lossless_files_give_their_numbers(tmp_path, ending):
    path = tmp_path / f"a.{ending}"
    Image.fromarray(CODES).save(path, **({"lossless": True} if ending == "webp" else {}))
    raw = read_texture(path, color=False).texels
    assert raw.dtype == torch.float32
    np.testing.assert_allclose(raw, CODES / 255, rtol=2**-22)  # a division in float32
    # one ulp of the argument, 2.4-fold by the power, and as much again for the power itself
    np.testing.assert_allclose(read_texture(path, color=True).texels, decoded(CODES / 255), rtol=1e-6)


def test_jpeg(tmp_path):
    Image.new("RGB", (8, 8), (200, 100, 50)).save(tmp_path / "a.jpg", quality=95)
    texels = read_texture(tmp_path / "a.jpg", color=False).texels
    np.testing.assert_allclose(texels[4, 4] * 255, [200, 100, 50], atol=2)  # JPEG rounds colours in YCbCr


def test_sixteen_bits_are_kept(tmp_path):
    codes = np.array([[0, 1, 257, 65535]], np.uint16)
    Image.fromarray(codes).save(tmp_path / "a.png")
    texels = read_texture(tmp_path / "a.png", color=False).texels
    assert torch.equal((texels * 65535).round().long()[0, :, 1], torch.tensor([0, 1, 257, 65535]))
    assert texels.shape == (1, 4, 3)


def test_formats_are_told_by_content_where_the_ending_says_nothing(tmp_path):
    Image.fromarray(CODES).save(tmp_path / "a.tex", format="png")
    np.testing.assert_allclose(read_texture(tmp_path / "a.tex", color=False).texels * 255, CODES, rtol=1e-6)


@pytest.mark.parametrize("name", ["none.png", "none.tga", "broken.png", "broken.tga", "no_ending"])
def test_what_cannot_be_read_is_one_sentence(tmp_path, name):
    if not name.startswith("none"):
        (tmp_path / name).write_bytes(b"\x00nothing\xff" * 9)
    with pytest.raises(InputError, match=rf"{name}: expected .*(none|image|picture)"):
        read_texture(tmp_path / name, color=True)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -0.5, 1.5])
def test_texels_outside_their_range(tmp_path, bad):
    np.save(tmp_path / "a.npy", np.array([[0.5, bad]], np.float32))
    with pytest.raises(InputError, match=r"texel: is .*, expected numbers in \[0, 1\]"):
        read_texture(tmp_path / "a.npy", color=False)


sizes = st.integers(1, 5)
coordinates = st.lists(st.tuples(*[st.floats(-9, 9)] * 2), min_size=1, max_size=8)


@given(data=st.data(), height=sizes, width=sizes, uv=coordinates)
def test_lookup_is_bilinear_and_repeats(data, height, width, uv):
    texels = data.draw(arrays(np.float64, (height, width, 2), elements=st.floats(0, 1)))
    uv = np.array(uv)
    # the coordinates of texel centres, from the top; grid-wrap has the texture's own period
    position = [(1 - uv[:, 1]) * height - 0.5, uv[:, 0] * width - 0.5]
    expected = [map_coordinates(texels[..., c], position, order=1, mode="grid-wrap") for c in range(2)]
    found = lookup(Texture(torch.from_numpy(texels)), torch.from_numpy(uv))
    # positions of at most 50 texels round to 50 · 2⁻⁵², and the texels differ by at most 1 along either axis
    np.testing.assert_allclose(found, np.stack(expected, -1), atol=1e-13)


def test_first_row_of_the_file_is_the_upper_one():
    texture = Texture(torch.tensor([[[1.0], [2.0]], [[3.0], [4.0]]]))
    centres = torch.tensor([[0.25, 0.75], [0.75, 0.75], [0.25, 0.25], [0.75, 0.25]])
    assert lookup(texture, centres)[:, 0].tolist() == [1, 2, 3, 4]
    assert lookup(texture, torch.zeros(2)).tolist() == [2.5]  # at a corner all four meet
    assert lookup(texture, torch.zeros(3, 5, 2, dtype=torch.float64)).shape == (3, 5, 1)
    assert lookup(texture, torch.zeros(2, dtype=torch.float64)).dtype == torch.float32


def test_lookup_has_the_derivatives_of_finite_differences():
    generator = torch.Generator().manual_seed(1)
    texels = torch.rand(3, 4, 2, dtype=torch.float64, generator=generator, requires_grad=True)
    # away from the lines between texel centres, where the slope changes
    uv = torch.tensor([[0.3, 0.4], [1.9, -0.1], [-3.05, 7.55]], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda t, x: lookup(Texture(t), x), (texels, uv))
