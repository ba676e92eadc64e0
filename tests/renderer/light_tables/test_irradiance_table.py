"""Diffuse light against closed forms, sums over every texel, other quadratures, and Mitsuba's pictures."""

import functools
import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from fit_material.fitter.forward.lighting import MOST_DIFFUSE, Lighting
from fit_material.fitter.options.fidelity import preset
from fit_material.renderer.compute import chebyshev
from fit_material.renderer.environment import latlong
from fit_material.renderer.environment.environment import Environment, directions
from fit_material.renderer.environment.environment_file import read_environment
from fit_material.renderer.environment.latlong import texel_solid_angles
from fit_material.renderer.geometry.mesh import Sphere
from fit_material.renderer.light_sampling import fresnel_basis
from fit_material.renderer.light_tables import irradiance_table, light_table
from fit_material.renderer.mitsuba.conversion import envmap, mitsuba, mitsuba_shape, sensor
from fit_material.renderer.synthesis.studio import studio, sun_and_sky
from fit_material.shaders.materials.types import Matte
from fit_material.shaders.optics import fresnel, rough_plastic
from fit_material.shaders.optics.microfacets import Distribution
from tests.renderer.light_tables.test_light_table import ball, lit_room, table_at

MAPS = [
    "studio_small_03_1k",
    "rooitou_park_1k",
    *(
        pytest.param(name, marks=pytest.mark.slow)
        for name in ("adams_place_bridge_1k", "lebombo_1k", "potsdamer_platz_1k", "st_peters_square_night_1k")
    ),
]


def float64(value) -> torch.Tensor:
    return torch.as_tensor(value, dtype=torch.float64)


def all_round(count: int) -> torch.Tensor:
    """Unit normals, even over the sphere, by a spiral of golden angles."""
    y = 1 - (2 * torch.arange(count, dtype=torch.float64) + 1) / count
    turn = math.pi * (3 - math.sqrt(5)) * torch.arange(count)
    radius = (1 - y**2).sqrt()
    return torch.stack([radius * turn.sin(), y, radius * turn.cos()], -1)


def through(eta: float, alpha: float, distribution: Distribution = "ggx") -> torch.Tensor:
    """Coefficients of T."""
    return irradiance_table.coefficients(
        lambda cos: rough_plastic.transmittance(cos, float64(eta), float64(alpha), distribution), float64(0)
    )


@functools.cache
def made(name: str) -> Environment:
    return {"studio": studio, "sunsky": functools.partial(sun_and_sky, 256)}[name]()


def by_texel(environment: Environment, normals: torch.Tensor, degree: int) -> torch.Tensor:
    """D_b, summed over all texels in float64."""
    height, width = environment.radiance.shape[:2]
    light = environment.radiance.double() * torch.from_numpy(texel_solid_angles(height, width))[..., None]
    towards, light = directions(height, width).reshape(-1, 3), light.reshape(-1, 3)
    sums = []
    for normal in normals:
        cos = (towards @ normal).clamp(0, 1)
        kernels = chebyshev.polynomials(2 * cos.sqrt() - 1, degree) * cos
        sums.append(kernels @ light / math.pi)
    return torch.stack(sums)


def check_blocks(environment: Environment) -> None:
    """Relative to what a white surface, or the body under an interface, gets from every texel.

    A block of solid angle Ω at angle θ errs by about Ω/2π · K''/2 of its own light: 6144 of them, the brighter the
    smaller, leave 1e-3 of it, with either sign. Measured on eight maps, 4000 normals: at most 1.4e-3 and 2e-4 rms.
    """
    normals = all_round(16)
    ours, every = irradiance_table.diffuse_table(normals, environment).double(), by_texel(environment, normals, 10)
    for coefficients in (float64([[1.0]]), through(1.5, 0.1)):
        degree = len(coefficients)
        found, expected = (torch.einsum("pbc,bd->pc", d[:, :degree], coefficients) for d in (ours, every))
        error = found / expected - 1
        assert error.abs().max() < 2e-3
        assert error.square().mean().sqrt() < 3e-4


@pytest.mark.parametrize("name", ["studio", "sunsky"])
def test_blocks_are_as_good_as_texels(name):
    check_blocks(made(name))


@pytest.mark.parametrize("name", MAPS)
def test_blocks_of_real_maps_are_as_good_as_texels(shared_data, name):
    check_blocks(read_environment(shared_data / "env" / f"{name}.hdr"))


@pytest.mark.parametrize("height", [1, 2, 16, 400])
def test_even_light(height):
    """2 ∫ c T_b(2√c - 1) dc = 4 ∫ w³ T_b(2w - 1) dw, by Gauss–Legendre exact."""
    environment = Environment(torch.tensor([1.0, 2.0, 0.5]).expand(height, 2 * height, 3))
    x, weight = np.polynomial.legendre.leggauss(16)
    w = float64((x + 1) / 2)
    expected = (chebyshev.polynomials(2 * w - 1, 10) * 4 * w**3 * float64(weight / 2)).sum(1)
    found = irradiance_table.diffuse_table(all_round(30), environment)
    # blocks across the horizon see c T_b(2√c - 1) with a kink: some 1e-3 for the highest b, which no T has much of
    for channel, radiance in enumerate(environment.radiance[0, 0].tolist()):
        assert found[:, 0, channel].numpy() == pytest.approx(radiance, rel=5e-4)
        torch.testing.assert_close(
            found[..., channel].double(), (radiance * expected).expand(30, 10), rtol=0, atol=3e-3 * radiance
        )


def test_few_texels_are_bilinear_and_turn_with_the_map():
    """The lookup itself at 2 · 10⁶ directions, in world space, midpoints of even steps of y and azimuth."""
    environment, normals = lit_room(70.0), all_round(8)
    y = (2 * torch.arange(1000, dtype=torch.float64) + 1) / 1000 - 1
    azimuth = 2 * math.pi * (torch.arange(2000, dtype=torch.float64) + 0.5) / 2000
    y, azimuth = torch.meshgrid(y, azimuth, indexing="ij")
    radius = (1 - y**2).sqrt()
    towards = torch.stack([radius * azimuth.sin(), y, radius * azimuth.cos()], -1).reshape(-1, 3)
    radiance = latlong.lookup(latlong.of(environment), *towards.float().unbind(-1)).double()
    cos = (towards @ normals.T).clamp_min(0)
    expected = cos.T @ radiance * 4 / len(towards)
    found = irradiance_table.diffuse_table(normals, environment, 1)[:, 0].double()
    torch.testing.assert_close(found, expected, rtol=1e-3, atol=0)  # blocks as above; the lookup is of float32


@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
@pytest.mark.parametrize("eta", [1.1, 1.5, 2.5])
def test_ten_polynomials_carry_the_transmittance(distribution, eta):
    root = torch.linspace(0, 1, 200, dtype=torch.float64)
    cos, basis = root**2, irradiance_table.cosine_basis(root**2)
    for alpha in (0.01, 0.05, 0.2, 1.0):
        exact = rough_plastic.transmittance(cos, float64(eta), float64(alpha), distribution)
        error = (basis @ through(eta, alpha, distribution))[:, 0] - exact
        assert error.abs().max() < 8e-3  # at grazing angles, α = 0.01; the tenth node of √c lies at c = 0.0009
        assert (cos * error).abs().max() < 1.3e-3  # one lamp
        assert abs(float((4 * root**3 * error).mean())) < 2e-4  # even light


def test_the_light_of_many_pixels_is_that_of_each():
    """Looked up by normals, where there are many; every texel's sum for some of the lit ones.

    Light over normals is bent like a cosine, and chords of one lie below it: a fitted colour is off by their distance.
    """
    environment, few = made("studio"), all_round(200)
    surface = ball(8, 1)[3][:1, 0]
    many = surface[torch.zeros(MOST_DIFFUSE + 1, dtype=torch.long)]
    many = replace(many, normal=few[torch.arange(len(many.hit)) % len(few)])[:, None]
    pixels = Lighting(environment, (), preset("standard")).pixels(many, body=True)
    found = pixels.radiance(Matte(float64([1.0] * 3), float64([1.0] * 3)))[: len(few)]
    expected = by_texel(environment, few, 1)[:, 0]
    lit = expected > 0.1 * expected.max()
    error = (found / expected - 1)[lit]
    assert error.square().mean().sqrt() < 3e-4  # the blocks' own
    assert abs(float(error.mean())) < 3e-5


def test_black_surroundings_and_no_normals():
    dark = Environment(torch.zeros(16, 32, 3))
    assert not irradiance_table.diffuse_table(all_round(3), dark).any()


def rendered(bsdf: dict, camera, environment: Environment, repeats: int, spp: int) -> np.ndarray:
    mi = mitsuba("scalar_rgb")
    scene = mi.load_dict({
        "type": "scene",
        "integrator": {"type": "direct"},
        "shape": mitsuba_shape(Sphere(), bsdf),
        "light": envmap(environment),
        "sensor": sensor(camera),
    })  # fmt: skip
    return np.stack([np.array(mi.render(scene, spp=spp, seed=seed), np.float64)[..., :3] for seed in range(repeats)])


def check_picture(theirs: np.ndarray, ours: np.ndarray, own_variance: np.ndarray, limit: float) -> None:
    """Mean relative difference within 4σ and the error of the blocks and of 1 - R, `limit`."""
    difference = theirs.mean(0) / ours - 1
    variance = theirs.var(0, ddof=1) / len(theirs) / ours**2 + own_variance / ours**2
    # the channels of a pixel share their samples: the pixels alone are independent
    noise = math.sqrt((np.sqrt(variance).sum(1) ** 2).sum()) / difference.size
    ratio = (difference**2).sum() / variance.sum()
    told = f"mean {difference.mean():+.2e} ± {noise:.1e}, χ²/N {ratio:.2f}, {len(ours)} pixels"
    assert abs(difference.mean()) < 4 * noise + limit, told
    assert noise < 2e-3, told
    assert 0.3 < ratio < 1.5, told  # the table's halves may tell up to 2.5 times the variance; see test_transport


def test_a_matte_sphere_is_mitsubas():
    camera, column, row, surface = ball(24)
    environment = made("studio")
    color = {"type": "rgb", "value": [0.6, 0.2, 0.1]}
    theirs = rendered({"type": "diffuse", "reflectance": color}, camera, environment, 8, 256)[:, row, column]
    normal = torch.nn.functional.normalize(surface.normal.mean(1), dim=-1)
    ours = torch.tensor([0.6, 0.2, 0.1]) * irradiance_table.diffuse_table(normal, environment, 1)[:, 0]
    check_picture(theirs, ours.double().numpy(), np.zeros(ours.shape), limit=5e-4)


@pytest.mark.parametrize(
    ("f0", "alpha", "distribution"),
    [(0.04, 0.2, "ggx"), (0.04, 0.05, "beckmann"), (0.04, 0.5, "ggx"), (0.0963, 0.2, "beckmann")],
)
def test_a_sphere_of_rough_plastic_is_mitsubas(f0, alpha, distribution):
    """F0 = 0.0963 is η = 1.9."""
    eta, color = rough_plastic.ior(float64(f0)), float64([0.6, 0.2, 0.1])
    camera, column, row, surface = ball(24)
    environment = made("studio")
    bsdf = {
        "type": "roughplastic",
        "diffuse_reflectance": {"type": "rgb", "value": color.tolist()},
        "int_ior": eta.item(),
        "ext_ior": 1.0,
        "alpha": alpha,
        "distribution": distribution,
    }
    theirs = rendered(bsdf, camera, environment, 8, 256)[:, row, column]
    normal = torch.nn.functional.normalize(surface.normal.mean(1), dim=-1)
    light = irradiance_table.diffuse_table(normal, environment).double()
    t = through(eta.item(), alpha, distribution)
    let_out = irradiance_table.cosine_basis(surface.n_dot_v).mean(1) @ t
    outcoupling = rough_plastic.outcoupling(eta, float64(alpha), distribution)
    body = color * outcoupling * let_out * torch.einsum("pbc,bd->pc", light, t)
    table = table_at(surface, environment, alpha, distribution, samples=1024, degree=10)
    coefficients = fresnel_basis.coefficients(lambda cos: fresnel.dielectric(cos, eta).expand(-1, 3), 10, float64(0))
    weights = table.level_weights(float64(alpha))
    halves = [light_table.radiance(table.half(i).mean(torch.float64), weights, coefficients) for i in (0, 1)]
    ours = body + (halves[0] + halves[1]) / 2
    check_picture(theirs, ours.numpy(), ((halves[0] - halves[1]) ** 2 / 4).numpy(), limit=2e-3)
