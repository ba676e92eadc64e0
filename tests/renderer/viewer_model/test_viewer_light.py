"""Ambient light of maps against brute-force sums over their lookups; lights as the scene file means them."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fit_material.renderer.environment import cubemap, latlong
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.scene.lights import DirectionalLightSpec, directional_light
from fit_material.renderer.synthesis.studio import studio
from fit_material.renderer.viewer_model.viewer_light import VIEWER_FACE_SIZE, harmonic_moments, surroundings
from fit_material.shaders.optics import diffuse


def noise(height: int, width: int, rotation: float = 0.0) -> Environment:
    return Environment(torch.rand(height, width, 3, generator=torch.Generator().manual_seed(height)), rotation)


def brute_force(environment: Environment, rows: int = 800) -> torch.Tensor:
    """Σ L h over bands of equal height and equal azimuths, which have equal solid angles [Archimedes]."""
    y = torch.linspace(-1, 1, 2 * rows + 1, dtype=torch.float64)[1::2]
    phi = (torch.arange(2 * rows, dtype=torch.float64) + 0.5) * math.pi / rows
    y, phi = torch.meshgrid(y, phi, indexing="ij")
    sine = (1 - y**2).sqrt()
    towards = torch.stack([sine * phi.cos(), y, sine * phi.sin()], -1).reshape(-1, 3)
    radiance = latlong.lookup(latlong.of(environment), *towards.float().unbind(-1)).double()
    return torch.einsum("pi,pc->ic", diffuse.harmonics(towards), radiance) * 4 * math.pi / len(towards)


@pytest.mark.parametrize(
    "environment",
    [noise(8, 16), noise(8, 16, 33.0), noise(2, 4, -200.0), noise(1, 2, 70.0), noise(3, 6, 1e4), studio(64)],
    ids=["noise", "turned", "two rows", "one row", "turned often", "studio"],
)
def test_moments_are_those_of_the_looked_up_map(environment):
    expected = brute_force(environment)
    # midpoints of 800 bands err by (2/800)²/24 of a second derivative, some (8/π)² times the contrast for eight rows;
    # towards the poles, where sin θ has no derivative in y, by its power 3/2; lookups are float32
    scale = 4 * math.pi * float(environment.radiance.max())
    torch.testing.assert_close(harmonic_moments(environment), expected, atol=1.5e-5 * scale, rtol=0)


def test_constant_maps_give_constant_ambient_light():
    radiance = torch.tensor([0.5, 1.0, 20.0])
    for height in (1, 2, 7, 64):
        environment = Environment(radiance.expand(height, 2 * height, 3).contiguous(), 12.0)
        expected = diffuse.constant_ambient(radiance.double())
        torch.testing.assert_close(surroundings(environment).ambient, expected, atol=1e-12, rtol=1e-13)


@given(st.floats(-720, 720))
def test_ambient_light_turns_with_the_map(degrees):
    """By `degrees` about +Y, counter-clockwise seen from above: (x, z) → (x cos + z sin, z cos - x sin)."""
    turn = math.radians(degrees)
    drawn = torch.randn(9, 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    normals = torch.nn.functional.normalize(drawn, dim=-1)
    x, y, z = normals.unbind(-1)
    turned = torch.stack([math.cos(turn) * x + math.sin(turn) * z, y, math.cos(turn) * z - math.sin(turn) * x], -1)
    before, after = (diffuse.ambient_coefficients(harmonic_moments(noise(6, 12, angle))) for angle in (0.0, degrees))
    expected = diffuse.ambient(before, normals)
    torch.testing.assert_close(diffuse.ambient(after, turned), expected, atol=1e-12, rtol=0)


def test_a_lamp_lights_the_side_that_faces_it():
    """A map that is black but for one texel: the coefficients follow from the texel's direction and light alone."""
    height, row, column = 64, 20, 77
    radiance = torch.zeros(height, 2 * height, 3)
    radiance[row, column] = 1000.0
    found = harmonic_moments(Environment(radiance))
    theta, phi = math.pi * row / (height - 1), 2 * math.pi * (column + 0.5) / (2 * height)
    towards = torch.tensor([math.sin(theta) * math.sin(phi), math.cos(theta), -math.sin(theta) * math.cos(phi)])
    # the tent over the texel, π/63 wide each way, dims second harmonics by (2δ)²/12 and shifts its mean by δ²/6 · cot θ
    assert found[0, 0] == pytest.approx(1000 * math.sin(theta) * (math.pi / 63) * (math.pi / 64), rel=1e-3)
    torch.testing.assert_close(found[:, 0] / found[0, 0], diffuse.harmonics(towards.double()), atol=3e-3, rtol=0)


def test_what_is_given_is_what_there_is():
    environment = studio(64)
    light = DirectionalLightSpec(type="directional", direction=(0.0, 3.0, 4.0), irradiance=(3.0, 2.0, 1.0))
    found = surroundings(environment, [light, light], ambient=(0.1, 0.2, 0.3))
    assert found.cubemap.faces.shape == (6, VIEWER_FACE_SIZE, VIEWER_FACE_SIZE, 3)
    assert found.cubemap.faces.dtype == torch.float32
    normals = torch.eye(3).double()
    torch.testing.assert_close(diffuse.ambient(found.ambient, normals), torch.tensor([[0.1, 0.2, 0.3]] * 3).double())
    assert len(found.sources) == 2
    torch.testing.assert_close(found.sources[1].towards, torch.tensor([0.0, 0.6, 0.8]).double())
    torch.testing.assert_close(found.sources[0].radiance, torch.tensor([3.0, 2.0, 1.0]).double() / math.pi)
    small = surroundings(environment, size=16)
    assert small.sources == ()
    torch.testing.assert_close(small.cubemap.faces, cubemap.from_environment(environment, 16).faces)


@given(st.tuples(*[st.floats(-1e300, 1e300)] * 3).filter(any))
def test_directions_of_any_length_become_unit_vectors(direction):
    spec = DirectionalLightSpec(type="directional", direction=direction, irradiance=(1.0, 1.0, 1.0))
    found = directional_light(spec).towards.numpy()
    assert np.linalg.norm(found) == pytest.approx(1, rel=1e-12)
    largest = int(np.abs(direction).argmax())
    expected = np.array(direction) / abs(direction[largest])
    # below float64's smallest normal number digits are lost
    np.testing.assert_allclose(found / abs(found[largest]), expected, rtol=1e-12, atol=np.finfo(float).tiny)
