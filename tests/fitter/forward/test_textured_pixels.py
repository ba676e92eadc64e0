"""The parts of a colour map's fit against closed forms: points, texels, holes and seams."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fit_material.fitter.forward.pixel_model import PixelModel
from fit_material.fitter.forward.textured_pixels import MultiViewPixels, TintedPixels
from fit_material.fitter.observations.multi_view_points import _interpolated, _interpolated_width
from fit_material.fitter.textures.texel_equations import TexelEquations
from fit_material.fitter.textures.texel_solver import solve, texture_size
from fit_material.renderer.geometry.mesh import read_mesh
from fit_material.renderer.images.textures import Texture, lookup, texel_weights
from fit_material.renderer.rays.gbuffer import equal_weight_nodes
from fit_material.renderer.rays.uv_atlas import Unwrapped, filled, unwrapped
from fit_material.shaders.materials.types import Glossy, Matte
from fit_material.shaders.materials.widths import Microfacet
from tests.support.textured import ball, pattern, seen_at

RANDOM = torch.Generator().manual_seed(0)


@dataclass(frozen=True)
class Lit(PixelModel):
    """Pixels of which it is known what they mirror and what a white body sends out."""

    mirrored: torch.Tensor
    body: torch.Tensor
    table = None

    def radiance(self, material):
        glossy = isinstance(material, Glossy)
        return material.color * self.body + (self.mirrored if glossy else 0)

    def under(self, table):
        return self


def random(*shape: int) -> torch.Tensor:
    return torch.rand(*shape, generator=RANDOM, dtype=torch.float64)


def of_color(kind: str, color: torch.Tensor) -> Glossy | Matte:
    one = torch.ones(3, dtype=torch.float64)
    return Glossy(color, 0.04 * one, Microfacet(one[0])) if kind == "glossy" else Matte(color, one)


@pytest.mark.parametrize("kind", ["glossy", "matte"])
def test_spots_have_the_colours_of_least_squares(kind):
    point = torch.tensor([3, 3, 3, 7, 7, 9, 9, 9, 9])
    model, seen, weight = Lit(random(9, 3), random(9, 3) + 0.1), random(9, 3) + 1, random(9, 3) + 0.5
    material = of_color(kind, torch.tensor([0.2, 0.4, 0.6], dtype=torch.float64))
    surface = model.mirrored if kind == "glossy" else torch.zeros_like(model.body)
    color = torch.zeros(9, 3, dtype=torch.float64)
    for number in (3, 7, 9):
        own = point == number
        for c in range(3):
            unknown, known = (weight * model.body)[own, c, None], (weight * (seen - surface))[own, c, None]
            color[own, c] = torch.linalg.lstsq(unknown, known).solution[0, 0]
    tint = color / torch.stack([color[point == number][0] for number in (3, 7, 9)]).mean(0)
    pixels = MultiViewPixels(model, point, seen, weight)
    torch.testing.assert_close(pixels.tint(material), tint)
    torch.testing.assert_close(pixels.radiance(material), surface + material.color * tint * model.body)


def test_a_tint_multiplies_the_body_and_not_what_is_mirrored():
    model, tint = Lit(random(5, 3), random(5, 3)), random(5, 3)
    material = of_color("glossy", torch.tensor([0.2, 0.4, 0.6], dtype=torch.float64))
    expected = model.mirrored + tint * material.color * model.body
    torch.testing.assert_close(TintedPixels(model, tint).radiance(material), expected)


@given(st.floats(2, 60), st.floats(2, 60))
def test_pixels_between_pixels_are_as_wide_as_what_their_rays_cover(x, y):
    # Of a film that shows x² and y², a pixel is the mean of a square of side 1: what lies between pixels mixes four.
    place, grid = (torch.tensor([each], dtype=torch.float64) for each in (x, y)), torch.arange(64) + 0.5
    squares = grid**2 + 1 / 12
    picture = torch.stack(torch.broadcast_tensors(squares[None], squares[:, None], torch.ones(64, 64)), -1)
    photograph = SimpleNamespace(radiance=picture, mask=torch.ones(64, 64, dtype=torch.bool))
    x, y = place
    (shown,), _ = _interpolated(photograph, x, y)  # type: ignore[arg-type]
    across, down = _interpolated_width(x), _interpolated_width(y)
    nodes = torch.tensor(equal_weight_nodes(3), dtype=torch.float64) - 0.5
    covered = [float(((each + width * nodes) ** 2).mean()) for each, width in ((x, across), (y, down))]
    assert shown.tolist() == pytest.approx([*covered, 1.0], rel=1e-6)


def test_texel_weights_are_the_lookup():
    texels, uv = random(5, 7, 3), 4 * random(200, 2) - 2
    index, weight = texel_weights(5, 7, uv)
    mixed = (weight[..., None] * texels.reshape(-1, 3)[index]).sum(1)
    torch.testing.assert_close(mixed, lookup(Texture(texels), uv))


def rows_of(texture: np.ndarray, pixels: int, noise: float, seed: int, across: float = 1.0) -> TexelEquations:
    """Pixels strewn over the lower `across` of a texture, each the mean of nine rays within a texel."""
    generator = torch.Generator().manual_seed(seed)

    def drawn(*shape: int) -> torch.Tensor:
        return torch.rand(*shape, generator=generator, dtype=torch.float64)

    size = len(texture)
    centre = drawn(pixels, 1, 2) * torch.tensor([1.0, across])
    uv = centre + (drawn(pixels, 9, 2) - 0.5) / size
    surface, body = 0.2 * drawn(pixels, 3), 0.5 + drawn(pixels, 3)
    color = lookup(Texture(torch.from_numpy(texture)), uv).mean(1)
    normal = torch.randn(pixels, 3, generator=generator, dtype=torch.float64)
    seen = (surface + body * color) * (1 + noise * normal)
    return TexelEquations(uv.float(), torch.full((pixels,), 1 / size**2), seen, surface, body, 0 * body, 0 * body)


def test_texels_are_found_again_from_photographs_without_noise():
    texture = pattern(32)
    solution = solve([rows_of(texture, 4096, 0.0, seed) for seed in range(4)], 32, texture.mean((0, 1)))
    assert solution.solved.all()
    # the equations are well posed, but for λ = σ²/τ² with σ at its floor of 1e-4, and CG's 1e-5
    assert np.abs(solution.color - texture).max() < 5e-3
    assert np.sqrt(((solution.color - texture) ** 2).mean()) < 5e-4


def test_noise_moves_no_texel_to_one_side():
    texture = np.full((32, 32, 3), 0.4)
    solution = solve([rows_of(texture, 1024, 0.1, seed) for seed in range(4)], 32, texture.mean((0, 1)))
    # 4096 pixels of 10 % leave 0.4 · 0.1 / √4096 = 6e-4 in the mean; weights by what was seen move it by 2 %, 8e-3
    assert np.abs(solution.color.mean((0, 1)) - 0.4).max() < 3 * 0.4 * 0.1 / np.sqrt(4096)


def test_what_no_pixel_sees_is_not_solved_for_and_photographs_are_counted():
    texture = pattern(32)
    whole, half = rows_of(texture, 8192, 0.01, 0), rows_of(texture, 8192, 0.01, 1, across=0.5)
    solution = solve([half, half], 32, texture.mean((0, 1)))
    assert not solution.solved[2:14].any()  # rows count from the top, v from the bottom, which the top one borders on
    assert solution.solved[18:].all()
    photographs = solve([whole, half], 32, texture.mean((0, 1))).photographs
    assert (photographs[2:14] == 1).all()
    assert (photographs[18:] == 2).all()


def test_a_texel_is_as_large_as_a_pixel():
    assert texture_size([rows_of(pattern(64), 10, 0.0, 0)], 16, 4096) == 64
    assert texture_size([rows_of(pattern(64), 10, 0.0, 0)], 16, 32) == 32


def test_the_layout_finds_the_places_of_texels(tmp_path):
    mesh = read_mesh(ball(tmp_path / "ball.obj", 48, 96))
    layout = unwrapped(mesh, 0, 16, 32)
    assert layout.inside.all()
    row, column = np.meshgrid(np.arange(16) + 0.5, np.arange(32) + 0.5, indexing="ij")
    theta, phi = np.pi * row / 16, 2 * np.pi * column / 32
    expected = np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)], -1)
    # facets of 1/48 of half a turn lie up to (π/96)²/2 = 5e-4 below the ball, and off along it by as little
    assert np.abs(layout.position - expected.reshape(-1, 3)).max() < 2e-3


def test_a_hole_at_a_seam_is_filled_alike_on_both_sides(tmp_path):
    layout = unwrapped(read_mesh(ball(tmp_path / "ball.obj", 48, 96)), 0, 32, 64)
    known = np.ones((32, 64), bool)
    known[12:20, :6], known[12:20, -6:] = False, False
    height = np.cos(np.pi * (np.arange(32) + 0.5) / 32)[:, None, None].repeat(64, 1)
    found = filled(np.where(known[..., None], height, 9.0), known, layout)
    assert np.array_equal(found[known], height[known])
    np.testing.assert_allclose(found[:, 0], found[:, -1], atol=0.02)  # neighbours over the seam, a 64th of a turn apart
    rim = np.sin(np.pi * 4.5 / 32)  # height of the hole's own rim over its middle: what is nearest is there
    assert np.abs(found - height)[~known].max() < rim


def test_beside_the_surface_texels_repeat_the_nearest():
    inside = np.zeros((8, 8), bool)
    inside[:, 2:5] = True
    values = np.zeros((8, 8, 1))
    values[:, 2], values[:, 3], values[:, 4] = 1.0, 2.0, 3.0
    place = np.stack(np.nonzero(inside), -1)
    layout = Unwrapped(inside, np.concatenate([place, 0 * place[:, :1]], -1).astype(float))
    found = filled(values, inside, layout)[0, :, 0]
    assert found.tolist() == [1, 1, 1, 2, 3, 3, 3, 3]


def test_the_true_texture_of_another_size_is_its_mean():
    texture = random(8, 8, 3).numpy()
    np.testing.assert_allclose(seen_at(texture, 4, 32).mean(), texture.mean(), rtol=1e-2)
