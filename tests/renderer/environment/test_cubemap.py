"""Cubemaps against the table in GL's specification, and what seamless bilinear lookups promise."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fit_material.renderer.environment import cubemap, latlong
from fit_material.renderer.environment.cubemap import FACES, Cubemap
from fit_material.renderer.environment.environment import Environment, directions

# [OpenGL 4.6 core, table 8.19]: major axis, s_c, t_c, m_a as signed axes
SPECIFICATION = {
    "px": ("-z", "-y", "+x"),
    "nx": ("+z", "-y", "-x"),
    "py": ("+x", "+z", "+y"),
    "ny": ("+x", "-z", "-y"),
    "pz": ("+x", "-y", "+z"),
    "nz": ("-x", "-y", "-z"),
}
# upper left, upper right and lower left corner of each face's picture, read off a cube drawn on paper
CORNERS = {
    "px": ((1, 1, 1), (1, 1, -1), (1, -1, 1)),
    "nx": ((-1, 1, -1), (-1, 1, 1), (-1, -1, -1)),
    "py": ((-1, 1, -1), (1, 1, -1), (-1, 1, 1)),
    "ny": ((-1, -1, 1), (1, -1, 1), (-1, -1, -1)),
    "pz": ((-1, 1, 1), (1, 1, 1), (-1, -1, 1)),
    "nz": ((1, 1, -1), (-1, 1, -1), (1, -1, -1)),
}


def signed(vector, axis: str) -> float:
    return (1 if axis[0] == "+" else -1) * vector["xyz".index(axis[1])]


def random_faces(size: int, seed: int = 3) -> torch.Tensor:
    return torch.rand(6, size, size, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))


def float64(value) -> torch.Tensor:
    return torch.as_tensor(value, dtype=torch.float64)


@given(st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: sorted(map(abs, v))[2] > sorted(map(abs, v))[1] + 1e-9))
def test_each_direction_meets_the_face_of_the_specification(direction):
    face, right, down = cubemap.face_position(float64(direction))
    major = max(range(3), key=lambda axis: abs(direction[axis]))
    name = ("n" if direction[major] < 0 else "p") + "xyz"[major]
    sc, tc, ma = (signed(direction, axis) for axis in SPECIFICATION[name])
    assert FACES[face] == name
    # s = ½(s_c/|m_a| + 1) runs from 0 to 1, ours from -1 to 1
    assert (right.item(), down.item()) == pytest.approx((sc / ma, tc / ma), abs=1e-15)


@pytest.mark.parametrize("name", FACES)
def test_pictures_hang_the_right_way_round(name):
    towards = cubemap.face_directions(1000)[FACES.index(name)]
    centre = towards[499:501, 499:501].mean((0, 1))
    np.testing.assert_allclose(centre, axis(name), atol=1e-5)
    for (row, column), corner in zip([(0, 0), (0, -1), (-1, 0)], CORNERS[name], strict=True):
        # the texel's centre lies half a texel, 1/1000, inside
        np.testing.assert_allclose(towards[row, column] * math.sqrt(3), corner, atol=2e-3)


def axis(name: str) -> np.ndarray:
    return (1 if name[0] == "p" else -1) * np.eye(3)["xyz".index(name[1])]


@pytest.mark.parametrize("size", [1, 2, 5])
def test_texels_are_found_at_their_own_directions(size):
    faces = random_faces(size)
    found = cubemap.lookup(Cubemap(faces), cubemap.face_directions(size))
    torch.testing.assert_close(found, faces, atol=1e-12, rtol=0)


@given(st.integers(1, 9), st.floats(0, 10), st.integers(0, 10**6))
def test_a_constant_stays_constant(size, value, seed):
    towards = torch.randn(50, 3, generator=torch.Generator().manual_seed(seed)).double()
    found = cubemap.lookup(Cubemap(torch.full((6, size, size, 3), value).double()), towards)
    torch.testing.assert_close(found, torch.full((50, 3), value).double(), atol=1e-13 * value, rtol=0)


def test_linear_functions_are_exact_within_a_face():
    size = 8
    position = (2 * torch.arange(size).double() + 1) / size - 1
    down, right = torch.meshgrid(position, position, indexing="ij")
    faces = torch.stack([1 + 2 * right - 3 * down, right, down], -1).expand(6, size, size, 3)
    towards = torch.randn(2000, 3, generator=torch.Generator().manual_seed(1)).double()
    _, right, down = cubemap.face_position(towards)
    inside = torch.maximum(right.abs(), down.abs()) < 1 - 1 / size
    expected = torch.stack([1 + 2 * right - 3 * down, right, down], -1)
    torch.testing.assert_close(cubemap.lookup(Cubemap(faces), towards)[inside], expected[inside], atol=1e-12, rtol=0)
    assert inside.sum() > 1000


EDGES = [(major, minor, a, b) for major in range(3) for minor in range(major) for a in (-1, 1) for b in (-1, 1)]


@pytest.mark.parametrize("size", [1, 2, 6])
@pytest.mark.parametrize(("major", "minor", "a", "b"), EDGES)
def test_nothing_jumps_at_an_edge(size, major, minor, a, b):
    """The difference between two points 2ε apart, one on each side, is bounded by the slope: n/2 per unit of each
    position and texel difference, where a position moves by 2ε."""
    epsilon = 1e-7
    along = torch.linspace(-1, 1, 101, dtype=torch.float64)
    edge = torch.zeros(101, 3, dtype=torch.float64)
    edge[:, major], edge[:, minor], edge[:, 3 - major - minor] = a, b, along
    one, other = edge.clone(), edge.clone()
    one[:, major] *= 1 + epsilon
    other[:, minor] *= 1 + epsilon
    cube = Cubemap(random_faces(size))
    sides = cubemap.face_position(one[1:-1])[0] != cubemap.face_position(other[1:-1])[0]
    assert sides.all()
    jump = (cubemap.lookup(cube, one) - cubemap.lookup(cube, other)).abs().max()
    assert jump <= 4 * epsilon * size


@pytest.mark.parametrize("corner", [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
def test_three_texels_meet_at_a_corner(corner):
    size = 4
    faces = random_faces(size)
    nearest = cubemap.face_directions(size).reshape(-1, 3) @ float64(corner)
    touching = nearest.topk(3).indices
    found = cubemap.lookup(Cubemap(faces), float64(corner))
    torch.testing.assert_close(found, faces.reshape(-1, 3)[touching].mean(0), atol=1e-12, rtol=0)


def test_a_margin_holds_the_neighbours_texels():
    size = 5
    faces = random_faces(size)
    padded = cubemap.with_margin(faces)
    # GL's px shows +Z to its left and -Z to its right, +Y above with its right column, -Y below likewise
    px, py, ny, pz, nz = (faces[FACES.index(name)] for name in ("px", "py", "ny", "pz", "nz"))
    torch.testing.assert_close(padded[0, 1:-1, 0], pz[:, -1], atol=0, rtol=0)
    torch.testing.assert_close(padded[0, 1:-1, -1], nz[:, 0], atol=0, rtol=0)
    torch.testing.assert_close(padded[0, 0, 1:-1], py[:, -1].flip(0), atol=0, rtol=0)
    torch.testing.assert_close(padded[0, -1, 1:-1], ny[:, -1], atol=0, rtol=0)
    torch.testing.assert_close(padded[0, 0, 0], (px[0, 0] + pz[0, -1] + py[-1, -1]) / 3)


def smooth(x: torch.Tensor, y: torch.Tensor, z: torch.Tensor) -> torch.Tensor:
    return torch.stack([2 + x, 2 + y * z, 2 + x * y - 0.5 * z], -1)


@pytest.mark.parametrize("rotation", [0.0, 40.0])
def test_an_environment_looks_the_same_as_a_cube(rotation):
    height, size = 128, 64
    towards = torch.randn(4000, 3, generator=torch.Generator().manual_seed(2)).double()
    towards = torch.nn.functional.normalize(towards, dim=-1).float()
    radiance = smooth(*directions(height, 2 * height).unbind(-1)).float()
    environment = Environment(radiance, rotation)
    found = cubemap.lookup(cubemap.from_environment(environment, size), towards)
    expected = latlong.lookup(latlong.of(environment), *towards.unbind(-1))
    _, right, down = cubemap.face_position(towards)
    inside = torch.maximum(right.abs(), down.abs()) < 1 - 1 / size
    error = (found - expected).abs().amax(-1)
    # second derivatives up to 4 within a face, steps of 2/n and π/h: (4/8)(2/n)² twice and (4/8)(π/h)² twice
    assert error[inside].max() < 4 * ((1 / size) ** 2 * 4 + (math.pi / height) ** 2) / 4 + 1e-5
    # a neighbour's texel lies up to 1/n beside its place in the border; it counts half at most, with slopes up to 2
    assert error.max() < 1 / size


def test_a_finer_map_is_averaged():
    radiance = torch.rand(128, 256, 3, generator=torch.Generator().manual_seed(4))
    environment, size, side = Environment(radiance), 2, 90
    found = cubemap.from_environment(environment, size).faces
    x, y, z = cubemap.face_directions(size * side).float().unbind(-1)
    dense = latlong.lookup(latlong.of(environment), x, y, z).reshape(6, size, side, size, side, 3).mean((2, 4))
    # 1300 texels of noise of σ = 0.29 to each mean; 32² points and 90² ones weight them a little differently
    torch.testing.assert_close(found, dense, atol=4 * 0.29 / math.sqrt(1300), rtol=0)


def test_derivatives_meet_finite_differences():
    size = 4
    towards = torch.randn(60, 3, generator=torch.Generator().manual_seed(3)).double()
    _, right, down = cubemap.face_position(towards)
    places = torch.stack([right, down], -1) * size / 2
    kinks = (places - places.round() - 0.5).abs().minimum((places - places.round() + 0.5).abs()).amin(-1)
    edges = 1 - torch.maximum(right.abs(), down.abs())
    towards = towards[(kinks > 1e-3) & (edges > 1e-3)][:10].requires_grad_()
    assert len(towards) == 10
    faces = random_faces(size).requires_grad_()
    assert torch.autograd.gradcheck(lambda d: cubemap.lookup(Cubemap(faces.detach()), d), towards)
    assert torch.autograd.gradcheck(lambda f: cubemap.lookup(Cubemap(f), towards.detach()), faces)


@pytest.mark.parametrize("size", [4, 12])
def test_polynomials_of_degree_five_are_looked_up_as_they_are(size):
    """On each face's plane, of its own; up to the faces' edges and corners."""
    generator = torch.Generator().manual_seed(5)
    factors = torch.rand(6, 6, 6, dtype=torch.float64, generator=generator)

    def value(directions):
        face, right, down = cubemap.face_position(directions)
        powers = [place[..., None] ** torch.arange(6) for place in (down, right)]
        return torch.einsum("...i,...ij,...j->...", powers[0], factors[face], powers[1])[..., None]

    centre = (2 * torch.arange(-3, size + 3, dtype=torch.float64) + 1) / size - 1
    powers = centre[:, None] ** torch.arange(6)
    bordered = torch.einsum("ri,fij,cj->frc", powers, factors, powers)[..., None]
    towards = torch.randn(500, 3, dtype=torch.float64, generator=generator)
    towards = torch.cat([towards, float64([[1.0, 0.999999, -0.999999], [-1.0, 0.2, 0.9999], [0.0, 0.0, 1.0]])])
    torch.testing.assert_close(cubemap.smooth_lookup(bordered, 3, towards), value(towards), rtol=1e-9, atol=1e-9)
