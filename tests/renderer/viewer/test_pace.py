"""A moving picture keeps up with the hand, and one at rest is whole."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fit_material.renderer.viewer.pace import COARSEST, FRAME, REST, Pace


@pytest.mark.parametrize(("seconds", "coarseness"), [(0.001, 1), (FRAME, 1), (4 * FRAME, 2), (9 * FRAME, 3), (60.0, 4)])
def test_slow_pictures_are_coarse_while_they_move(seconds, coarseness):
    pace = Pace()
    pace.measure(seconds)
    pace.move(10.0)
    assert pace.coarseness(10.0 + 0.9 * REST) == coarseness
    assert pace.coarseness(10.0 + 1.1 * REST) == 1


@given(st.floats(0, 1e3))
def test_a_frame_takes_little_longer_than_it_may(seconds):
    pace = Pace()
    pace.measure(seconds)
    pace.move(0.0)
    coarseness = pace.coarseness(0.0)
    # a quarter of a step is forgiven: (1.25)² where a picture stays whole, less where it is coarser
    assert coarseness == COARSEST or seconds / coarseness**2 <= 1.25**2 * FRAME * (1 + 1e-9)


def test_before_anything_moved_all_is_whole():
    pace = Pace()
    pace.measure(60.0)
    assert pace.coarseness(0.0) == 1
    assert not pace.moving(0.0)
