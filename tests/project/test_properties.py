"""What holds over whole domains: few examples here, thousands in `make stress`."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from fit_material.fitter.materials.coordinates import WidthInterval
from fit_material.fitter.materials.glossy import GlossyCoordinates
from fit_material.fitter.materials.matte import MatteCoordinates
from fit_material.fitter.materials.metal import MetalCoordinates
from fit_material.fitter.selftest.claims import FINITE, between, float32, near
from fit_material.fitter.selftest.experiments import references, small_scene
from fit_material.fitter.selftest.experiments.row import Claim, Formula, Numbers
from fit_material.fitter.selftest.materials import ROUNDINGS as CONDUCTOR
from fit_material.renderer.environment import cubemap, latlong
from fit_material.renderer.environment.cubemap import Cubemap
from fit_material.renderer.environment.environment import Environment
from fit_material.shaders import shade
from fit_material.shaders.lights import DirectionalLight
from fit_material.shaders.materials.types import Glossy, Matte, Metal
from fit_material.shaders.materials.widths import Blur
from fit_material.shaders.optics import diffuse, fresnel, microfacets, rough_plastic
from fit_material.shaders.shade import EnvironmentLight, Points

# Roundings that a formula takes, as `near` and `between` count them: its steps, doubled for each quotient of two sums.
DIELECTRIC = 48  # a root and two quotients, squared and averaged
PLASTIC = 64  # 40 for a share (facet, refraction, F, G1), 24 for weights and sum of 192 in 8 lanes
MASK = 4  # a root, a sum, a quotient
WALTER = 6.2e-5  # what Beckmann's rational G1 exceeds 1 by at a = 1.59, just before 1 takes its place [Walter 2007]
SHARES = 8  # of what is left of 1: the difference of two sums of shares
GUARD = 4  # a difference, a quotient and a product
SCHLICK = 8  # a difference, a power of five in three products, and two for what they weigh; it exceeds 1 by two at most

NUMBERS = [Numbers(torch.float32), Numbers(torch.float64)]

# cosines whose squares float32 has: what is smaller is 0 to every formula
cosines = (
    st.floats(0, 1).map(lambda cos: cos if cos > 1e-18 else 0.0)
    | st.floats(-8, 0).map(lambda power: 10**power)
    | st.sampled_from((0.0, 1e-8, 1.0))
)
indices = st.floats(-4, 3).map(lambda power: 10**power) | st.sampled_from((1.0, 1 + 1e-6, 0.6))
extinctions = st.just(0.0) | st.floats(-8, 3).map(lambda power: 10**power)
widths = st.floats(-6, 0.5).map(lambda power: 10**power) | st.sampled_from((0.0, 1.0))
shares = st.floats(0, 1) | st.sampled_from((0.0, 1e-12, 1 - 2.0**-24, 1.0))
radiances = st.just(0.0) | st.floats(-6, 9).map(lambda power: 10**power)


def broken(formula: Formula, *claims: Claim) -> list[str]:
    """What does not hold, in single or in double precision."""
    found = [claim.broken(formula, numbers) for numbers in NUMBERS for claim in claims]
    return [told for told in found if told is not None]


@given(cosines, indices, extinctions)
@example(1.0, 1e-8, 0.0)  # n² - 1 + c² loses n²
@example(0.5, 10.0, 10.0)  # |real| had the slope 0 where n² - k² = s²
def test_conductors_reflect_a_share_and_absorb_the_rest(cos_d, n, k):
    places = {"cos_d": (cos_d,), "n": (n,), "k": (k,)}
    assert not broken(
        Formula(fresnel.conductor, places), FINITE, between(0, 1), near(references.conductor, CONDUCTOR, relative=False)
    )
    assert not broken(
        Formula(fresnel.absorptance, places),
        FINITE,
        between(0, 1, SHARES),
        near(references.absorptance, CONDUCTOR, floor=1e-40),
    )


@given(cosines, st.floats(1, 100))
@example(0.0, 1.0)
def test_dielectrics_reflect_a_share_and_let_in_the_rest(cos_d, ior):
    places = {"cos_d": (cos_d,), "ior": (ior,)}
    assert not broken(
        Formula(fresnel.dielectric, places), FINITE, between(0, 1), near(references.dielectric, DIELECTRIC, floor=1e-30)
    )
    assert not broken(
        Formula(fresnel.transmittance, places),
        FINITE,
        between(0, 1, SHARES),
        near(references.transmittance, DIELECTRIC, floor=1e-30),
    )


@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
@given(cosines.filter(lambda cos: cos > 0), widths)
def test_lobes_are_finite_and_masks_are_shares(distribution, cos, alpha):
    places = {"cos": (cos,), "alpha": (alpha,)}
    assert not broken(
        Formula(lambda cos, alpha: microfacets.distribution_of_normals(cos, alpha, distribution), places), FINITE
    )
    masked = Formula(lambda cos, alpha: microfacets.smith_g1(cos, alpha, distribution), places)
    assert not broken(masked, FINITE, between(0, 1 + WALTER, MASK))


@given(cosines, st.floats(1e-3, 3), st.floats(1, 12))
def test_plastics_let_in_a_share(mu, alpha, eta):
    mu = max(mu, 1e-3)
    places = {"eta": (eta,), "alpha": (alpha,)}

    def passed(eta: torch.Tensor, alpha: torch.Tensor) -> torch.Tensor:
        return rough_plastic.transmittance(torch.full_like(eta, mu), eta, alpha, "ggx")

    assert not broken(Formula(passed, places), FINITE, between(0, 1, PLASTIC))


@given(shares, shares)
def test_guarded_colours_return_no_more_than_arrives(color, reflectance):
    places = {"color": (color,), "reflectance": (reflectance,)}

    def together(color: torch.Tensor, reflectance: torch.Tensor) -> torch.Tensor:
        return diffuse.energy_guard(color[:, None], reflectance[:, None])[:, 0] + reflectance

    assert not broken(Formula(together, places), FINITE, between(0, 1, GUARD))


@given(cosines, shares)
def test_schlick_in_single_precision(cos_d, f0):
    assert not broken(
        Formula(fresnel.schlick, {"cos_d": (cos_d,), "f0": (f0,)}), FINITE, between(0, 1, 2), float32(SCHLICK)
    )


vectors = st.tuples(*[st.floats(-1, 1) | st.sampled_from((0.0, 1.0, -1.0, 1e-30, 1e-9))] * 3).filter(
    lambda v: math.hypot(*v) > 1e-3
)


@given(vectors)
@example((0.0, 1.0, 6.9e-162))  # x² + z² underflows, by which the azimuth's slope divides
def test_lookups_are_between_their_texels_whatever_the_direction(v):
    towards = torch.nn.functional.normalize(torch.tensor([v], dtype=torch.float64), dim=-1).requires_grad_()
    generator = torch.Generator().manual_seed(5)
    map_ = latlong.of(Environment(torch.rand(4, 8, 3, generator=generator).double()))
    cube = Cubemap(torch.rand(6, 3, 3, 3, generator=generator).double())
    for found in (latlong.lookup(map_, *towards.unbind(-1)), cubemap.lookup(cube, towards)):
        (slope,) = torch.autograd.grad(found.sum(), towards)
        assert ((found >= 0) & (found <= 1)).all()
        assert slope.isfinite().all()


@given(st.lists(st.floats(-2000, 2000), min_size=7, max_size=7))
def test_every_free_vector_is_a_material(x):
    free = torch.tensor(x, dtype=torch.float64)
    for coordinates in (
        MetalCoordinates(WidthInterval(0.005, 1.2, True)),
        GlossyCoordinates(WidthInterval(0.005, 1.2)),
        MatteCoordinates(),
    ):
        material = coordinates.material(free[: coordinates.size])
        assert all(value.isfinite().all() and (value >= 0).all() for value in material.numbers.values())
        assert coordinates.free(material).isfinite().all()


@given(
    st.sampled_from(("metal", "glossy", "matte")),
    st.lists(shares, min_size=6, max_size=6),
    indices,
    extinctions,
    widths,
    st.lists(radiances, min_size=24, max_size=24),
    vectors,
    vectors,
    vectors,
)
@settings(suppress_health_check=[HealthCheck.too_slow, HealthCheck.large_base_example])
def test_random_scenes_have_finite_pictures_with_finite_slopes(kind, colors, n, k, rho, texels, normal, view, lamp):
    """The viewer's model end to end, suns, mirrors, turned-away normals; under brighter light a brighter picture."""
    unit = [torch.nn.functional.normalize(torch.tensor([v], dtype=torch.float64), dim=-1) for v in (normal, view, lamp)]
    color, reflectance = torch.tensor(colors, dtype=torch.float64).reshape(2, 3).requires_grad_()
    roughness = torch.tensor(rho, dtype=torch.float64, requires_grad=True)
    index = torch.full((3,), n, dtype=torch.float64, requires_grad=True)
    extinct = torch.full((3,), k, dtype=torch.float64, requires_grad=True)
    material, unknowns = {
        "metal": (Metal(index, extinct, Blur(roughness)), (index, extinct, roughness)),
        "glossy": (Glossy(color, reflectance, Blur(roughness)), (color, reflectance, roughness)),
        "matte": (Matte(color, reflectance), (color, reflectance)),
    }[kind]
    cube = Cubemap(torch.tensor(texels, dtype=torch.float64).reshape(6, 2, 2, 1).expand(6, 2, 2, 3).contiguous())

    def picture(factor: float) -> torch.Tensor:
        source = DirectionalLight(unit[2][0], torch.full((3,), factor, dtype=torch.float64))
        ambient = diffuse.constant_ambient(torch.full((3,), factor, dtype=torch.float64))
        light = EnvironmentLight(lambda r: factor * cubemap.lookup(cube, r), ambient, sources=(source,))
        return shade.shade(material, Points(unit[0], unit[1]), light)

    found = picture(1.0)
    assert (found.isfinite() & (found >= 0)).all()
    assert all(slope.isfinite().all() for slope in torch.autograd.grad(found.sum(), unknowns))
    torch.testing.assert_close(picture(1024.0), 1024 * found, rtol=1e-12, atol=1e-290)  # exact but for denormal numbers


@given(
    st.lists(st.floats(-12, 12), min_size=7, max_size=7),
    st.floats(-3, 0).map(lambda power: 10**power),
    st.integers(0, 2**31),
)
@settings(max_examples=max(3, settings().max_examples // 40))
def test_random_fits_end_finite_and_no_worse_than_they_began(x, noise, seed):
    """From anywhere, with any noise, by pixels of which one may be an outlier."""
    light = small_scene.table(torch.float64, torch.device("cpu"))
    seen = small_scene.photograph(light, noise, seed % 1000)
    seen = seen.index_fill(0, torch.tensor([seed % len(seen)]), 10.0 ** (seed % 9 - 2))
    residuals = small_scene.residuals_of(light, seen)
    start = torch.tensor(x, dtype=torch.float64)
    found = small_scene.fitted(residuals, start, steps=8).solution
    assert found.x.isfinite().all()
    assert found.cost <= 0.5 * float(residuals(start).square().sum()) * (1 + 1e-12)
    assert found.status in ("converged", "stopped")
    order = torch.randperm(len(seen), generator=torch.Generator().manual_seed(seed % 1000))
    assert float(small_scene.residuals_of(light, seen, order)(start).square().sum()) == pytest.approx(
        float(residuals(start).square().sum()), rel=1e-9
    )
