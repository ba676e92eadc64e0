"""Rays between the traced ones, against rays that are traced."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import trimesh

from fit_material.renderer.cameras.camera import Camera, look_at
from fit_material.renderer.geometry.mesh import Mesh, Sphere
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.pixel_footprint import FEW, STRATA, Places, filled, is_smooth, rays_of, strata_of

POSE = look_at(*(torch.tensor(v, dtype=torch.float64) for v in ((1.0, 0.5, 4.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))))
CAMERA = Camera(POSE, 48, 48)


def covered(trace: gbuffer.Tracer, side: int) -> tuple[torch.Tensor, torch.Tensor, gbuffer.GBuffer]:
    """Columns, rows and footprints of the pixels that are wholly covered."""
    row, column = gbuffer.pixel_centres(trace, CAMERA).front.nonzero().T
    surface = gbuffer.pixel_footprints(trace, CAMERA, column, row, side)
    whole = surface.front.all(1)
    return column[whole], row[whole], surface[whole]


def numbers(surface: gbuffer.GBuffer) -> torch.Tensor:
    return torch.arange(len(surface.hit))


def test_interpolated_rays_are_those_that_tracing_finds():
    """On a sphere whose pixels are 0.02 to 0.1 of its radius; a share of 0.02 in the cubic leaves some thousandths."""
    trace = gbuffer.tracer(Sphere())
    column, row, surface = covered(trace, 4)
    smooth = is_smooth(surface.normal.reshape(-1, 4, 4, 3))
    assert smooth.double().mean() > 0.9
    column, row, surface = column[smooth], row[smooth], surface[smooth]
    place = Places.draw(numbers(surface), 6, 3)[:].double()
    found = filled(surface, place)
    x, y = column[:, None] + place[..., 1], row[:, None] + place[..., 0]
    traced = trace(*CAMERA.rays(x.flatten(), y.flatten())).reshape(*x.shape)
    off = (found.normal - traced.normal).norm(dim=-1)[traced.hit]
    assert off.median() < 1e-5
    assert off.max() < 0.02
    torch.testing.assert_close(found.view, traced.view, atol=1e-6, rtol=0)
    torch.testing.assert_close(found.normal.norm(dim=-1), torch.ones(found.normal.shape[:2]).double())


def test_where_an_edge_crosses_rays_are_traced_ones():
    """A cube without vertex normals: every ray has the normal of a side that the pixel was seen to have."""
    box = trimesh.creation.box()
    mesh = Mesh(np.asarray(box.vertices), np.asarray(box.faces), None, None, np.zeros(len(box.faces), dtype=np.int64))
    _, _, surface = covered(gbuffer.tracer(mesh), 4)
    edged = ~is_smooth(surface.normal.reshape(-1, 4, 4, 3))
    several = (surface.normal - surface.normal[:, :1]).norm(dim=-1).amax(1) > 0.1
    assert 10 < several.sum() < len(several) / 2
    assert torch.equal(edged, several)
    found = filled(surface, Places.draw(numbers(surface), 6, 1)[:])
    apart = (found.normal[:, :, None] - surface.normal[:, None]).norm(dim=-1)
    assert apart.amin(2).max() < 1e-12


@pytest.mark.parametrize("side", [1, 2, 3, 5])
def test_few_rays_stay_as_they_are_and_many_become_two_even_sets(side):
    _, _, surface = covered(gbuffer.tracer(Sphere()), side)
    found = filled(surface, Places.draw(numbers(surface), 6, 1)[:])
    assert found.normal.shape[1] == rays_of(surface, 6)
    assert (found.normal is surface.normal) == (side**2 < FEW)


def test_places_are_strata_of_the_pixel_and_every_pixels_own():
    _, _, surface = covered(gbuffer.tracer(Sphere()), 4)
    strata = 12
    found = Places.draw(numbers(surface), strata, 5)[:]
    assert ((found > 0) & (found < 1)).all()
    cell = (found * strata).long()
    number = cell[..., 0] * strata + cell[..., 1]
    for half in number.split(strata**2, 1):
        assert (half.sort(1).values == torch.arange(strata**2)).all()
    assert torch.equal(found, Places.draw(numbers(surface), strata, 5)[:])
    assert not torch.equal(found, Places.draw(numbers(surface), strata, 6)[:])
    assert (found[1:] != found[:1]).any(-1).all()


@pytest.mark.parametrize("alpha", [0.02, 0.05, 0.2])
def test_bent_pixels_get_strata_narrower_than_the_lobe(alpha):
    """How far normals turn from stratum to stratum, traced at a fine grid: at most a lobe's width, unless the strata
    are the finest. A grid of 24 tells the turn between 20 strata to a fifth."""
    trace, fine = gbuffer.tracer(Sphere()), 24
    column, row, surface = covered(trace, 4)
    strata = strata_of(surface, alpha, 2048)
    along = (torch.arange(fine) + 0.5) / fine
    y, x = (axis.flatten() for axis in torch.meshgrid(along, along, indexing="ij"))
    traced = trace(*CAMERA.rays((column[:, None] + x).flatten(), (row[:, None] + y).flatten()))
    normal = traced.normal.reshape(-1, fine, fine, 3)
    whole = traced.hit.reshape(len(column), -1).all(1) & is_smooth(surface.normal.reshape(-1, 4, 4, 3))
    across = torch.maximum(
        (normal[:, :, -1] - normal[:, :, 0]).norm(dim=-1).amax(1), (normal[:, -1] - normal[:, 0]).norm(dim=-1).amax(1)
    )
    turn = (across / strata)[whole & (strata < STRATA[-1])]
    assert turn.max() < 1.2 * alpha
    assert (strata[whole][across[whole] < alpha] == STRATA[0]).all()


def test_strata_are_no_more_than_the_directions():
    _, _, surface = covered(gbuffer.tracer(Sphere()), 4)
    assert set(strata_of(surface, 0.01, 2048).tolist()) == {*STRATA}
    assert set(strata_of(surface, 0.01, 1024).tolist()) == {*STRATA[:2]}
    assert set(strata_of(surface, 0.01, 256).tolist()) == {STRATA[0]}
