"""Tangents against surfaces whose parametrisation is known, and normal maps against geometry."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from torch.nn.functional import normalize

from fit_material.renderer.geometry.mesh import Mesh
from fit_material.renderer.geometry.tangents import tangents, with_mirrored_apart
from fit_material.shaders.normal_map import perturbed


def grid_mesh(surface, uv_of=lambda p: p, size=33) -> Mesh:
    """`surface` over the unit square: positions and unit normals of parameters [n, 2]."""
    side = np.linspace(0, 1, size)
    parameter = np.stack(np.meshgrid(side, side, indexing="ij"), -1).reshape(-1, 2)
    index = np.arange(size**2).reshape(size, size)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    vertices, normals = surface(parameter)
    return Mesh(vertices, faces, normals, uv_of(parameter), np.zeros(len(faces), int))


def plane(p):
    return np.concatenate([p, 0 * p[:, :1]], 1), np.tile([0.0, 0, 1], (len(p), 1))


def torus(p):
    """Outer angle along the first parameter, a quarter each."""
    a, b = np.pi / 2 * p.T
    normal = np.stack([np.cos(a) * np.cos(b), np.sin(a) * np.cos(b), np.sin(b)], 1)
    return 2 * np.stack([np.cos(a), np.sin(a), 0 * a], 1) + 0.5 * normal, normal


def test_torus_has_the_tangents_of_calculus():
    mesh = grid_mesh(torus)
    found = tangents(mesh)
    angle = np.pi / 2 * mesh.uv[:, 0]
    expected = np.stack([-np.sin(angle), np.cos(angle), 0 * angle], 1)
    # a chord over an angle h = π/64 is turned by h/2 against the tangent, at the border with one side only
    assert np.abs(found[:, :3] - expected).max() < np.pi / 2 / 32 / 2 * 1.01
    assert (found[:, 3] == 1).all()


@pytest.mark.parametrize(
    ("uv_of", "tangent", "handedness"),
    [
        (lambda p: 3 * p + 7, [1, 0, 0], 1),
        (lambda p: p * [-1, 1], [-1, 0, 0], -1),
        (lambda p: p * [1, -1], [1, 0, 0], -1),
        (lambda p: p[:, ::-1], [0, 1, 0], -1),
        (lambda p: 1e-9 * p @ [[0, 1], [-1, 0]], [0, -1, 0], 1),  # u = -y, v = x
    ],
)
@pytest.mark.parametrize("scale", [1.0, 1e-7, 1e7])
def test_turned_and_mirrored_textures(uv_of, tangent, handedness, scale):
    found = tangents(grid_mesh(lambda p: (scale * plane(p)[0], plane(p)[1]), uv_of, size=3))
    np.testing.assert_allclose(found, np.tile([*tangent, handedness], (9, 1)), atol=1e-12)


@given(
    vertices=arrays(np.float64, (5, 3), elements=st.floats(-1, 1)),
    uv=arrays(np.float64, (5, 2), elements=st.sampled_from([0.0, 0.5, 1.0, 1e-300, -3.0, 1 / 3])),
    faces=arrays(np.int64, (4, 3), elements=st.integers(0, 4)),
    directions=arrays(np.float64, (5, 3), elements=st.sampled_from([0.0, 1.0, -1.0, 1e-5])),
)
def test_tangents_are_always_unit_and_perpendicular(vertices, uv, faces, directions):
    normals = directions + np.array([0, 0, 2.5])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    found = tangents(Mesh(vertices, faces, normals, uv, np.zeros(4, int)))
    # made perpendicular by subtraction, a vector as short as 1e-9 keeps 1e-16/1e-9 of its digits
    np.testing.assert_allclose((found[:, :3] * normals).sum(-1), 0, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(found[:, :3], axis=-1), 1, atol=1e-12)
    assert set(found[:, 3]) <= {1.0, -1.0}


@pytest.mark.parametrize("without", ["uv", "normals"])
def test_there_are_none_without_texture_coordinates_or_normals(without):
    mesh = grid_mesh(plane)
    assert tangents(Mesh(**{**vars(mesh), without: None})) is None


def test_mirrored_halves_get_vertices_of_their_own():
    mesh = grid_mesh(plane, lambda p: np.abs(p - [0.5, 0]), size=5)  # u falls to 0 in the middle, then grows
    apart = with_mirrored_apart(mesh)
    assert len(apart.vertices) == 25 + 5
    for name in ("vertices", "normals", "uv"):  # the same corners in the same order
        np.testing.assert_array_equal(getattr(apart, name)[apart.faces], getattr(mesh, name)[mesh.faces])
    middle = apart.vertices[apart.faces].mean(1)[:, None, 0]
    corner = tangents(apart)[apart.faces]
    np.testing.assert_allclose(corner[..., 0], np.sign(middle - 0.5) * np.ones((1, 3)), atol=1e-12)
    np.testing.assert_array_equal(corner[..., 3], corner[..., 0])
    assert with_mirrored_apart(grid_mesh(plane)).vertices.shape == grid_mesh(plane).vertices.shape


def test_map_of_a_height_field_gives_the_field_s_normals():
    """On a plane with texture coordinates turned by 30°, the map of z = h(u, v) is (-h_u, -h_v, 1), made unit."""
    generator = torch.Generator().manual_seed(3)
    slope = torch.randn(50, 2, dtype=torch.float64, generator=generator)
    across, along = torch.tensor([[0.75**0.5, 0.5, 0], [-0.5, 0.75**0.5, 0]], dtype=torch.float64)
    up = torch.tensor([0.0, 0, 1], dtype=torch.float64)
    map_normal = normalize(torch.cat([-slope, torch.ones(50, 1)], -1), dim=-1)
    expected = normalize(up - slope[:, :1] * across - slope[:, 1:] * along, dim=-1)
    one = torch.ones(50, 1, dtype=torch.float64)
    # lengths and the part of the tangent along the normal do not matter
    found = perturbed(3 * up.expand(50, 3), (2 * across + 0.7 * up).expand(50, 3), one, (map_normal + 1) / 2)
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-14)
    mirrored = perturbed(up.expand(50, 3), across.expand(50, 3), -one, (map_normal * torch.tensor([1, -1, 1]) + 1) / 2)
    torch.testing.assert_close(mirrored, expected, rtol=0, atol=1e-14)


vectors = arrays(np.float32, (3,), elements=st.floats(-1, 1, width=32))


@given(
    normal=vectors, tangent=vectors, handedness=st.floats(-1, 1, width=32), code=st.tuples(*[st.integers(0, 255)] * 3)
)
def test_perturbed_normals_are_unit_wherever_there_is_a_normal(normal, tangent, handedness, code):
    texel = torch.tensor(code) / 255
    found = perturbed(torch.from_numpy(normal), torch.from_numpy(tangent), torch.tensor([handedness]), texel)
    assert torch.isfinite(found).all()
    # below 1e-12, where a length is not divided by, and where squares leave float32, nothing is promised
    if np.abs(normal).max() > 1e-6 and abs(2 * code[2] - 255) > 1:
        assert abs(float(found.norm()) - 1) < 1e-5


def test_perturbed_has_the_derivatives_of_finite_differences():
    generator = torch.Generator().manual_seed(5)
    sizes = ((4, 3), (4, 3), (4, 1), (4, 3))
    inputs = [torch.rand(size, dtype=torch.float64, generator=generator, requires_grad=True) for size in sizes]
    assert torch.autograd.gradcheck(perturbed, inputs)
