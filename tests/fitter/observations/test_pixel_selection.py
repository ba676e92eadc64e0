"""Which pixels a fit looks at."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from fit_material.fitter.observations import pixel_selection
from fit_material.fitter.observations.photograph import Photograph
from fit_material.fitter.observations.pixel_request import PixelRequest
from fit_material.fitter.observations.pixel_selection import ANGLE_BINS, EDGED, choose_pixels
from fit_material.renderer.cameras.camera import Camera, look_at
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.geometry.mesh import Mesh, Shape, Sphere
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.self_visibility import hidden_share
from tests.renderer.rays.test_self_visibility import balls, bowl


def photograph(origin=(0.0, 0.0, 4.0), target=(0.0, 0.0, 0.0), size: int = 96, mask=None) -> Photograph:
    pose = look_at(*(torch.tensor(v, dtype=torch.float64) for v in (origin, target, (0.0, 1.0, 0.0))))
    radiance = torch.rand(size, size, 3, generator=torch.Generator().manual_seed(0))
    mask = torch.ones(size, size, dtype=torch.bool) if mask is None else mask
    return Photograph("view", radiance, mask, Camera(pose, size, size), 1.0, 0, 0)


def choose(
    *photographs: Photograph,
    shape: Shape = Sphere(),  # noqa: B008
    count: int = 800,
    seed: int = 0,
    footprint: int = 2,
):
    trace = gbuffer.tracer(shape)
    (found,) = choose_pixels(PixelRequest(photographs, trace, Path("scene.toml"), footprint, seed), count)
    assert found is not None
    return found


def facets() -> Mesh:
    """A ball of 1280 flat faces: at 96 pixels across, an edge crosses most of them."""
    ball = trimesh.creation.icosphere(3)
    return Mesh(
        np.asarray(ball.vertices), np.asarray(ball.faces), None, None, np.zeros(len(ball.faces), dtype=np.int64)
    )


def test_every_chosen_pixel_is_covered_wholly_and_from_the_front():
    found = choose(photograph())
    assert found.surface.hit.shape == (800, 4)
    assert found.surface.front.all()
    assert found.radiance.dtype == torch.float64


def test_a_photograph_that_is_left_out_changes_nothing():
    """Neither is it looked at, nor does it take a share of the pixels."""
    trace = gbuffer.tracer(Sphere())
    one_photograph = PixelRequest([photograph()], trace, Path("scene.toml"), footprint=2, seed=0)
    (one,) = choose_pixels(one_photograph, 300)
    (two,) = choose_pixels(replace(one_photograph, photographs=[photograph(), photograph()], left_out={1}), 300)
    assert one is not None
    assert two is not None
    assert torch.equal(one.radiance, two.radiance)


def test_angles_are_spread_evenly():
    """A sphere seen from afar shows cos θ with density 2 cos θ; chosen in turn, no bin has more than its share + 1."""
    n_dot_v = choose(photograph(), photograph((4.0, 0.0, 0.0))).surface.n_dot_v.mean(1)
    counts = torch.histc(n_dot_v.float(), ANGLE_BINS, 0, 1)
    grazing = counts[n_dot_v.min().mul(ANGLE_BINS).ceil().int() : ANGLE_BINS // 4]
    uniform_density = (n_dot_v < 0.25).double().mean().item()
    assert uniform_density > 1.5 * 0.25**2  # half as much again as their share of the picture's area, rim left out
    assert grazing.min() > 0


def test_the_mask_is_kept_to():
    mask = torch.zeros(96, 96, dtype=torch.bool)
    mask[40:50, 40:60] = True
    seen = photograph(mask=mask)
    found = choose(seen)
    allowed = {tuple(value) for value in seen.radiance[mask].double().tolist()}
    assert {tuple(value) for value in found.radiance.tolist()} <= allowed
    assert 0 < len(found.radiance) <= mask.sum()


def test_the_seed_chooses():
    first, again, other = (choose(photograph(), seed=seed).radiance for seed in (1, 1, 2))
    assert torch.equal(first, again)
    assert not torch.equal(first, other)


@pytest.mark.parametrize(("footprint", "rays"), [(1, 1), (2, 4), (4, EDGED**2), (9, 81)])
def test_facets_smaller_than_pixels_take_more_rays_where_not_few_were_wanted(footprint, rays):
    found = choose(photograph(), shape=facets(), footprint=footprint)
    assert found.surface.hit.shape[1] == rays
    assert found.edged or footprint < 3  # of two rays a side no edge is told from a bend


def test_the_odd_edge_takes_no_more_rays_and_its_pixels_are_left_out():
    box = trimesh.creation.box()
    found = choose(
        photograph((1.0, 0.5, 4.0)),
        shape=Mesh(
            np.asarray(box.vertices), np.asarray(box.faces), None, None, np.zeros(len(box.faces), dtype=np.int64)
        ),
        footprint=4,
    )
    assert found.surface.hit.shape[1] == 16
    assert not found.edged
    assert (found.surface.normal - found.surface.normal[:, :1]).norm(dim=-1).max() < 1e-9


def test_of_very_many_pixels_each_has_an_equal_chance(monkeypatch):
    """600 drawings of 50 of 1000: a count of mean 30 scatters by less than a binomial one's √(600 · 0.05 · 0.95) = 5.3.

    Five of these are not exceeded once in 1000 in a thousand such tests.
    """
    monkeypatch.setattr(pixel_selection, "MANY", 100)
    generator = torch.Generator().manual_seed(0)
    drawn = [pixel_selection._drawn(1000, 50, generator) for _ in range(600)]
    assert all(len(each.unique()) == len(each) == 50 for each in drawn)
    counts = torch.bincount(torch.cat(drawn), minlength=1000)
    assert (counts - 30).abs().max() < 5 * 5.3
    first = torch.stack([each[0] for each in drawn]).double()  # in any order: the first may lie anywhere
    assert abs(first.mean() - 499.5) < 5 * 1000 / (12 * 600) ** 0.5


def test_a_sample_of_very_many_pixels_is_spread_over_the_angles_as_all_are(monkeypatch):
    every = choose(photograph())
    monkeypatch.setattr(pixel_selection, "MANY", 100)
    some = choose(photograph())
    assert len(some.radiance) == len(every.radiance) == 800
    histograms = [torch.histc(each.surface.n_dot_v.mean(1).float(), 8, 0, 1) for each in (every, some)]
    assert (histograms[0] - histograms[1]).abs().max() < 5 * 100**0.5  # bins of some hundred, 5 standard deviations


def test_a_convex_object_does_not_see_itself():
    assert choose(photograph()).self_seeing == 0


def test_pixels_that_see_the_object_are_left_out():
    """Two balls. A pixel is judged by its centre: its corners may see a little more."""
    trace = gbuffer.tracer(balls())
    found = choose(photograph((1.0, 2.0, 6.0)), shape=balls(), count=400)
    assert 0.3 < found.self_seeing < 0.9
    everywhere = gbuffer.pixel_centres(trace, photograph((1.0, 2.0, 6.0)).camera)
    taken, all_of_it = (hidden_share(trace, s[s.front]).mean() for s in (found.surface, everywhere))
    assert taken < 1 / 64 < all_of_it / 2  # one direction of those that are asked


def test_where_all_pixels_see_the_object_those_that_do_so_the_least_are_taken():
    """In a bowl, an eighth of the pixels wanted: none of them hides more than any that was left."""
    trace = gbuffer.tracer(bowl())
    view = photograph()
    found = choose(view, shape=bowl(), count=800)
    assert found.self_seeing == 1
    assert 0.8 * 100 < len(found.radiance) <= 100
    everywhere = gbuffer.pixel_centres(trace, view.camera)
    shares = hidden_share(trace, everywhere[everywhere.front]).sort().values
    taken = hidden_share(trace, found.surface.reshape(-1)).mean()
    assert taken < shares[: len(shares) // 2].mean()


@pytest.mark.parametrize(
    ("view", "words"),
    [
        (photograph(target=(0.0, 0.0, 8.0)), "outside the frame"),
        (photograph(origin=(0.0, 0.0, 0.5), target=(0.0, 0.0, 4.0)), "inside the object"),
    ],
)
def test_cameras_that_see_no_front_are_told(view, words):
    with pytest.raises(InputError, match=words) as caught:
        choose(photograph(), view)
    assert caught.value.field == "photographs[1].camera"


def halves() -> Mesh:
    """A ball of two materials, one above z = 0 and one below, and a third that no triangle has."""
    ball = trimesh.creation.icosphere(subdivisions=4)
    below = (ball.triangles_center[:, 2] < 0).astype(int)
    vertices, faces = np.asarray(ball.vertices), np.asarray(ball.faces)
    return Mesh(vertices, faces, vertices, None, below, ("above", "below", "nowhere"))


def test_each_material_gets_its_own_pixels():
    """Seen along x and along z; both photographs show the upper material, only one the lower."""
    seen = [photograph((4.0, 0.0, 0.0)), photograph((0.0, 0.001, 4.0))]
    request = PixelRequest(seen, gbuffer.tracer(halves()), Path("scene.toml"), footprint=2, seed=0, materials=3)
    above, below, nowhere = choose_pixels(request, 400)
    assert nowhere is None
    for index, found in enumerate((above, below)):
        assert (found.surface.material == index).all()
    assert (above.surface.position[..., 2] > -0.05).all()  # an icosphere's edge is 0.07 long
    assert (below.surface.position[..., 2] < 0.05).all()
    assert len(above.radiance) == 400
    assert 150 < len(below.radiance) <= 200


def test_a_photograph_of_which_no_pixel_is_whole_is_refused():
    with pytest.raises(InputError, match="covers wholly"):
        choose(photograph((0.0, 0.0, 150.0)))


def test_blocks_of_jpeg_err_together():
    """Of two photographs, the second in blocks of 16: its pixels that share one, and no others, have one number."""
    place = torch.tensor([[0, 0, 0], [0, 0, 1], [1, 0, 0], [1, 15, 15], [1, 0, 16], [1, 16, 0]])
    observed = replace(choose(photograph()), place=place)
    assert observed.clusters is None
    found = replace(observed, lossy=frozenset([1])).clusters
    assert found is not None
    assert found[2] == found[3]
    assert len(found.unique()) == 5
