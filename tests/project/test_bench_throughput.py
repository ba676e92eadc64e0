"""What the comparison of throughputs counts, and that both sides integrate the same light."""

import statistics

import numpy as np
import pytest
import torch

from fit_material.fitter.forward.lighting import Lighting
from fit_material.renderer.mitsuba.conversion import variant_here
from fit_material.renderer.synthesis.studio import studio
from tests.bench import throughput
from tests.bench.throughput import Case, Taken, Way, further, in_turn, ratios, table


def test_both_sides_integrate_the_same_light():
    """Means over pictures of eight seeds each: a z-test, which wrong pixels, lobe or light fail by hundreds."""
    case, seeds = Case(6, 512, studio(64)), range(8)
    theirs = throughput.mitsuba_picture(case, variant_here())
    settings = [Lighting(case.environment, (), throughput.preset("standard"), seed) for seed in seeds]
    surface = case.surface
    own = [float(each.radiance(case.material, surface, 2 * case.pairs).mean()) for each in settings]
    other = [float(theirs(seed)[..., :3].mean(dtype=float)) for seed in seeds]
    error = ((statistics.variance(own) + statistics.variance(other)) / len(seeds)) ** 0.5
    assert error < 0.01 * statistics.mean(other)  # so that the test can tell anything
    # 5 of the standard error that eight draws each tell: by Student's t of 14 degrees of freedom one in 5000 fails
    assert abs(statistics.mean(own) - statistics.mean(other)) < 5 * error


def test_every_pixel_sees_the_sphere_and_nothing_but_it():
    case = Case(8, 4, studio(8))
    assert case.surface.front.all()
    assert case.samples == 8 * 8 * 4
    assert np.all(throughput.mitsuba_picture(case, variant_here())(0)[..., 3] == 1)


def test_ways_run_in_turn_once_before_they_are_timed():
    order: list[tuple[str, int]] = []
    first, second = (Way(name, 1, lambda seed, name=name: order.append((name, seed))) for name in "ab")
    found = in_turn([first, second], 2)
    assert order == [("a", 0), ("b", 0), ("a", 1), ("b", 1), ("a", 2), ("b", 2)]
    assert [len(taken) for taken in found.values()] == [2, 2]


def test_ratios_are_of_the_same_round():
    own, rivals = [Taken(2.0, 1.0), Taken(4.0, 3.0)], [Taken(1.0, 4.0), Taken(8.0, 3.0)]
    assert ratios(own, rivals, "seconds") == [0.5, 2.0]
    assert ratios(own, rivals, "cpu") == [4.0, 1.0]


def test_rows_say_samples_a_second_and_evaluations_of_all_levels():
    """By hand: 4 million in 2 s are 2 million a second, twice the rival's; five levels evaluate ten times as many."""
    rival, ours = Way("Mitsuba", 1, id), Way("ours", 5, id)
    *_, row = table({rival: [Taken(4.0, 8.0)], ours: [Taken(2.0, 2.0)]}, 4_000_000)
    cells = [cell.strip().split(" ")[0] for cell in row.strip("|").split("|")]
    assert cells == ["ours", "5", "2", "2", "2", "2", "4", "10"]


def test_what_further_samples_cost_leaves_out_what_a_pixel_costs():
    """Made of 1 s for the pixels and 1 s for each million: a million a second, however many the first ones were."""
    way = Way("ours", 1, id)
    *_, row = further({way: [Taken(2.0, 2.0)]}, {Way("ours", 1, abs): [Taken(5.0, 5.0)]}, 3_000_000)
    assert row.split("|")[5].split()[0] == "1"


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_no_gpu_no_row():
    ways = throughput.ways(Case(2, 4, studio(8)), variant_here(), slow=True)
    assert not [way for way in ways if "cuda" in way.name]
