"""The picture as a sum over lobes: under one light and nothing else, against BRDFs written out in numpy."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.forward.pixel_model import ExactPixels
from fit_material.fitter.options.fidelity import preset
from fit_material.renderer.cameras.camera import Camera, look_at
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.geometry.mesh import Sphere
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.shaders.lights import DirectionalLight
from fit_material.shaders.materials.kinds import KINDS
from fit_material.shaders.materials.lobes import Diffuse
from fit_material.shaders.materials.types import TYPES, Glossy, Material, Matte, Metal, made_of
from fit_material.shaders.materials.widths import Microfacet, blur_like
from fit_material.shaders.optics import rough_plastic
from tests.support.quadrature import masking

SIZE, ALPHA = 12, 0.3
N, K, COLOR, F0 = (0.2, 0.9, 1.4), (3.0, 2.5, 2.0), (0.3, 0.5, 0.7), 0.05


def float64(*values: float) -> torch.Tensor:
    return torch.tensor(values if len(values) > 1 else values[0], dtype=torch.float64)


LIGHT = DirectionalLight(float64(0.0, 0.6, 0.8), float64(1.0, 2.0, 3.0))
MATERIALS = {
    "metal": Metal(float64(*N), float64(*K), Microfacet(float64(ALPHA))),
    "glossy": Glossy(float64(*COLOR), torch.full((3,), F0).double(), Microfacet(float64(ALPHA))),
    "matte": Matte(float64(*COLOR), float64(0.9, 0.8, 1.0)),
}


@pytest.fixture(scope="module")
def surface() -> GBuffer:
    """Pixels that a ball covers wholly, a few rays in each."""
    camera = Camera(look_at(float64(0.0, 0.0, 4.0), float64(0.0, 0.0, 0.0), float64(0.0, 1.0, 0.0)), SIZE, SIZE, fov=40)
    row, column = torch.meshgrid(torch.arange(SIZE), torch.arange(SIZE), indexing="ij")
    seen = gbuffer.pixel_footprints(gbuffer.tracer(Sphere()), camera, column.flatten(), row.flatten(), 2)
    return seen[seen.front.all(-1)]


def model_of(material: Material, surface: GBuffer) -> ExactPixels:
    """In surroundings that are all but black."""
    dark = Environment(torch.full((8, 16, 3), 1e-12))
    model = Lighting(dark, (LIGHT,), preset("preview")).model(material, surface, samples=16)
    assert isinstance(model, ExactPixels)
    return model


def cosines(surface: GBuffer) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of view, light and half vector against the normal, and of the half vector against the view."""
    normal, view, towards = surface.normal.numpy(), surface.view.numpy(), LIGHT.towards.numpy()
    half = view + towards
    half = half / np.linalg.norm(half, axis=-1, keepdims=True)
    dots = (normal * view).sum(-1), normal @ towards, (normal * half).sum(-1), (view * half).sum(-1)
    return tuple(np.clip(each, 0, 1)[..., None] for each in dots)  # type: ignore[return-value]


def facets(surface: GBuffer) -> np.ndarray:
    """D G1 G1 / (4 n·v) of GGX, D = α² / (π ((n·h)² (α² - 1) + 1)²) [Walter 2007, eq. 33]."""
    cos_v, cos_l, cos_h, _ = cosines(surface)
    normals = ALPHA**2 / (math.pi * (cos_h**2 * (ALPHA**2 - 1) + 1) ** 2)
    return normals * masking(cos_v, ALPHA, "ggx") * masking(cos_l, ALPHA, "ggx") / (4 * cos_v)


def fresnel(cosine: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Unpolarised reflectance by Fresnel's two equations at a complex index."""
    inside = np.sqrt(1 - (1 - cosine**2) / index**2 + 0j)
    s = (cosine - index * inside) / (cosine + index * inside)
    p = (index * cosine - inside) / (index * cosine + inside)
    return (np.abs(s) ** 2 + np.abs(p) ** 2) / 2


def shown(brdf_cos: np.ndarray) -> np.ndarray:
    """Radiance in the light: its irradiance times BRDF · n·l, the mean over each pixel's rays."""
    return (math.pi * LIGHT.radiance.numpy() * brdf_cos).mean(1)


def test_a_metal_is_its_surface(surface):
    expected = shown(fresnel(cosines(surface)[3], np.array(N) + 1j * np.array(K)) * facets(surface))
    found = model_of(MATERIALS["metal"], surface).radiance(MATERIALS["metal"])
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-10)


def test_a_matte_surface_is_its_body(surface):
    """color/π · F(n·v) n·l; polynomials of degree 11 stand for F, which is one of degree 5."""
    cos_v, cos_l, *_ = cosines(surface)
    f = np.array([0.9, 0.8, 1.0])
    expected = shown(np.array(COLOR) / math.pi * (f + (1 - f) * (1 - cos_v) ** 5) * cos_l)
    found = model_of(MATERIALS["matte"], surface).radiance(MATERIALS["matte"])
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)


def test_a_glossy_material_is_surface_and_body(surface):
    """The body lets light in and out by T, whose polynomials are good to a few ten-thousandths."""
    cos_v, cos_l, _, cos_d = cosines(surface)
    eta = (1 + math.sqrt(F0)) / (1 - math.sqrt(F0))
    mirrored = fresnel(cos_d, np.array(eta)) * facets(surface)
    t = [rough_plastic.transmittance(torch.from_numpy(c), float64(eta), float64(ALPHA), "ggx") for c in (cos_v, cos_l)]
    albedo = np.array(COLOR) * float(rough_plastic.outcoupling(float64(eta), float64(ALPHA), "ggx"))
    below = albedo / math.pi * t[0].numpy() * t[1].numpy() * cos_l
    model, material = model_of(MATERIALS["glossy"], surface), MATERIALS["glossy"]
    np.testing.assert_allclose(model.radiance(material), shown(mirrored + below), rtol=2e-3, atol=1e-4)
    assert isinstance(material, Glossy)
    np.testing.assert_allclose(model.sent_by_body(material), shown(below), rtol=2e-3, atol=1e-4)


@pytest.mark.parametrize("name", MATERIALS)
def test_lobes_are_what_the_type_says_of_them(name):
    material, of_type = MATERIALS[name], KINDS[name]
    for lobes in (
        material.microfacet_lobes("ggx", type(material).exact_reflectance),
        (material if material.width is None else material.with_width(blur_like(material.width))).thesis_lobes(
            type(material).viewer_reflectance
        ),
    ):
        assert any(isinstance(lobe, Diffuse) for lobe in lobes) == of_type.has_body
        assert any(not isinstance(lobe, Diffuse) for lobe in lobes) == of_type.mirrors
    assert (material.width is not None, material.color is not None) == (of_type.mirrors, of_type.has_body)
    assert (material.f0 is not None) == of_type.mirrors


def test_types_are_found_by_name():
    assert TYPES.keys() == KINDS.keys() == MATERIALS.keys()
    for name, material in MATERIALS.items():
        made = made_of(name, lambda quantity, of=material: getattr(of, quantity.name), lambda of=material: of.width)
        assert type(made) is type(material)
        assert made.numbers == material.numbers
    with pytest.raises(KeyError):
        KINDS["glass"]
