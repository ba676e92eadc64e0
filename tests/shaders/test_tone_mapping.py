"""Tone mapping in closed form. GLSL is held against this in tests/renderer/viewer/test_compare.py."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from kornia.color import rgb_to_linear_rgb
from torch.testing import assert_close

from fit_material.shaders.tone_mapping import CURVES, REINHARD_WHITE, aces, reinhard, srgb, tone_mapped

channels = st.floats(0, 2.0**127, width=32)


def grey(value: float) -> torch.Tensor:
    return torch.full((3,), value, dtype=torch.float64)


def test_the_srgb_code_is_that_of_another_program():
    """kornia decodes by the same standard, whose two pieces meet within 1e-7 at its rounded threshold."""
    code = torch.linspace(0, 1, 300, dtype=torch.float64).reshape(3, 10, 10)
    encoded = srgb(rgb_to_linear_rgb(code).movedim(0, -1))
    assert_close(encoded.movedim(-1, 0), code, atol=1e-7, rtol=0)


@given(st.tuples(channels, channels, channels), st.floats(-40, 40), st.sampled_from(CURVES))
def test_whatever_the_radiance_a_display_can_show_it(radiance, exposure, curve):
    shown = tone_mapped(torch.tensor(radiance), exposure, curve)
    assert shown.isfinite().all()
    assert ((shown >= 0) & (shown <= 1)).all()


@pytest.mark.parametrize("curve", CURVES)
def test_brighter_is_never_darker(curve):
    radiance = torch.logspace(-6, 6, 2000, dtype=torch.float64)[:, None].expand(-1, 3)
    shown = tone_mapped(radiance, 0.0, curve)
    assert (shown.diff(dim=0) >= -1e-12).all()
    assert_close(shown[-1, 0], shown.new_tensor(1.0))


def test_a_stop_is_a_factor_of_two():
    radiance = torch.rand(20, 3, generator=torch.Generator().manual_seed(1))
    for curve in CURVES:
        assert_close(tone_mapped(radiance, 1.0, curve), tone_mapped(2 * radiance, 0.0, curve))


def test_reinhard_maps_its_white_to_one_and_the_dark_to_itself():
    assert_close(reinhard(grey(REINHARD_WHITE)), grey(1.0))
    assert_close(reinhard(grey(1e-9)), grey(1e-9))


def test_reinhard_keeps_the_hue():
    red = torch.tensor([3.0, 0.3, 0.1], dtype=torch.float64)
    assert_close(reinhard(red) / reinhard(red)[0], red / red[0])


def test_aces_has_its_published_values():
    """At 0, at infinity, and at x = 1 of the published curve, which is at 1/0.6 of ours."""
    assert_close(aces(grey(0.0)), grey(0.0))
    assert_close(aces(grey(1e12)), grey(2.51 / 2.43))
    assert_close(aces(grey(1 / 0.6)), grey(2.54 / 3.16))
