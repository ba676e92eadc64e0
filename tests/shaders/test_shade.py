"""The shading model against MODEL.md written out in plain numbers, a white furnace, and finite differences."""

import dataclasses
import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fit_material.shaders.lights import DirectionalLight
from fit_material.shaders.materials.types import Glossy, Matte, Metal
from fit_material.shaders.materials.widths import Blur
from fit_material.shaders.optics import blur, diffuse
from fit_material.shaders.shade import EnvironmentLight, Points, double_bounce, reflection, shade

DTYPES = [torch.float32, torch.float64]
GOLD = (0.146, 0.425, 1.431), (3.578, 2.326, 1.85)


def float64(value) -> torch.Tensor:
    return torch.as_tensor(value, dtype=torch.float64)


def unit(*vector) -> torch.Tensor:
    return torch.nn.functional.normalize(float64(vector), dim=-1)


def sky(directions: torch.Tensor) -> torch.Tensor:
    """A smooth environment, unlike itself in every direction, > 0."""
    x, y, z = directions.unbind(-1)
    return torch.stack([2 + x + 0.5 * y * z, torch.exp(0.5 * y - 0.3 * x), 1.5 + torch.sin(2 * z + x)], -1)


def mist(directions: torch.Tensor) -> torch.Tensor:
    """Depth by direction, in (0, 1)."""
    return 0.6 + 0.3 * directions[..., 0] * directions[..., 1]


AMBIENT = torch.cat([float64([[3.0, 2.0, 1.0]]), 0.3 * torch.randn(8, 3, generator=torch.Generator().manual_seed(2))])
SUN = DirectionalLight(unit(0.2, 0.7, 0.6), float64([2.0, 1.5, 1.0]))
LAMP = DirectionalLight(unit(-0.8, 0.1, 0.5), float64([0.3, 0.6, 0.9]))
LIGHTS = {
    "sky": EnvironmentLight(sky, AMBIENT),
    "sky and lamps": EnvironmentLight(sky, AMBIENT, sources=(SUN, LAMP)),
    "neighbours": EnvironmentLight(sky, AMBIENT, mist, (SUN,)),
}
POINTS = Points(unit(0.1, 0.3, 0.9)[None], unit(0.4, -0.2, 0.8)[None])
MAPPED = dataclasses.replace(POINTS, openness=float64([[0.6]]), tint=float64([[0.9, 0.5, 0.7]]))


def materials(rho: float = 0.3) -> dict[str, Metal | Glossy | Matte]:
    color, reflectance, rho_ = float64([0.8, 0.4, 0.1]), float64([0.25, 0.3, 0.04]), float64(rho)
    return {
        "metal": Metal(float64(GOLD[0]), float64(GOLD[1]), Blur(rho_)),
        "glossy": Glossy(color, reflectance, Blur(rho_)),
        "matte": Matte(color, reflectance),
    }


def made(kind: type[Metal | Glossy | Matte], numbers) -> Metal | Glossy | Matte:
    """The material of these numbers, of which ρ is the last."""
    return kind(*numbers) if kind is Matte else kind(*numbers[:-1], Blur(numbers[-1]))


def written_out(material, normal, view, light: EnvironmentLight, openness=1.0, tint=(1.0, 1.0, 1.0)) -> list[float]:
    """MODEL.md 1, 3 and 4 for one point, channel by channel, in Python's own numbers."""
    dot = sum(a * b for a, b in zip(normal, view, strict=True))
    cos = min(max(dot, 0.0), 1.0)
    r = np.array([2 * dot * a - b for a, b in zip(normal, view, strict=True)])
    rho = 0.0 if material.type == "matte" else float(material.width.value)
    radius = rho * (1.0 if light.depth is None else float(light.depth(float64(r))))
    k_h = np.array([r[2], 0, -r[0]]) / math.hypot(r[0], r[2])
    taps, total = np.zeros(3), 0.0
    for i in range(-3, 4):
        for j in range(-3, 4):
            towards = r + i / 3 * radius * k_h + j / 3 * radius * np.cross(k_h, r)
            weight = math.exp(-0.5 * ((i / 1.5) ** 2 + (j / 1.5) ** 2))
            taps += weight * light.radiance(float64(towards / np.linalg.norm(towards))).numpy()
            total += weight
    shown = []
    for c in range(3):
        if material.type == "metal":
            n, k = float(material.n[c]), float(material.k[c])
            f = ((n - 1) ** 2 + 4 * n * (1 - cos) ** 5 + k**2) / ((n + 1) ** 2 + k**2)
        else:
            f0 = float(material.reflectance[c])
            f = f0 + (1 - f0) * (1 - cos) ** 5
        scattered = float(diffuse.ambient(light.ambient, float64(normal))[c]) * openness
        mirrored = taps[c] / total
        for source in light.sources:
            scattered += float(source.radiance[c]) * max(0.0, float(float64(normal) @ source.towards))
            if rho > 0:
                apart = math.dist(r, source.towards.tolist())
                gaussian = math.exp(-(apart**2) / (2 * (rho / 2) ** 2)) / math.sqrt(2 * math.pi * (rho / 2) ** 2)
                mirrored += float(source.radiance[c]) * gaussian
        bounced = openness * f + (1 - openness) * f * f
        if material.type == "metal":
            shown.append(bounced * mirrored)
            continue
        color = [float(value) * t for value, t in zip(material.color, tint, strict=True)]
        if material.type == "matte":
            shown.append(color[c] * scattered * f)
            continue
        everywhere = [f0 + (1 - f0) * (1 - cos) ** 5 for f0 in material.reflectance.tolist()]
        divisor = max([1.0, *(a / max(1 - b, 1e-300) for a, b in zip(color, everywhere, strict=True))])
        shown.append(color[c] / divisor * scattered + bounced * mirrored)
    return shown


@pytest.mark.parametrize("rho", [0.0, 0.05, 0.7])
@pytest.mark.parametrize("light", LIGHTS.values(), ids=LIGHTS)
@pytest.mark.parametrize("name", ["metal", "glossy", "matte"])
def test_every_material_is_the_model_written_out(name, light, rho):
    material, generator = materials(rho)[name], torch.Generator().manual_seed(7)
    normal, view = (
        torch.nn.functional.normalize(torch.randn(10, 3, generator=generator, dtype=torch.float64), dim=-1)
        for _ in range(2)
    )
    openness, tint = (torch.rand(10, c, generator=generator, dtype=torch.float64) for c in (1, 3))
    assert ((normal * view).sum(-1) < 0).any()  # normals turned away are among them
    found = {
        "plain": shade(material, Points(normal, view), light),
        "mapped": shade(material, Points(normal, view, openness, tint), light),
    }
    for p in range(10):
        place = normal[p].tolist(), view[p].tolist(), light
        expected = float64(written_out(material, *place))
        torch.testing.assert_close(found["plain"][p], expected, rtol=1e-12, atol=1e-14)
        expected = float64(written_out(material, *place, openness[p].item(), tint[p].tolist()))
        torch.testing.assert_close(found["mapped"][p], expected, rtol=1e-12, atol=1e-14)


def test_a_perfect_mirror_shows_the_sky_where_it_is_seen():
    mirror = Metal(float64([1e-9] * 3), float64([1.0] * 3), Blur(float64(0.0)))
    plane = Points(unit(0.0, 1.0, 0.0)[None], unit(0.6, 0.8, 0.0)[None])
    found = shade(mirror, plane, EnvironmentLight(sky, AMBIENT, sources=(SUN,)))  # and no lamp
    torch.testing.assert_close(found[0], sky(float64([-0.6, 0.8, 0.0])), rtol=1e-8, atol=0)


def test_a_white_matte_surface_is_lambertian():
    white = Matte(float64([1.0] * 3), float64([1.0] * 3))
    plane = Points(unit(0.0, 1.0, 0.0).expand(3, 3), torch.stack([unit(0.0, 1, 0), unit(3.0, 1, 0), unit(-1.0, 0, 0)]))
    dark = EnvironmentLight(sky, 0 * AMBIENT, sources=(SUN, LAMP))
    found = shade(white, plane, dark)
    expected = SUN.radiance * SUN.towards[1] + LAMP.radiance * LAMP.towards[1]
    torch.testing.assert_close(found, expected.expand(3, 3))


@pytest.mark.parametrize("rho", [0.02, 0.3, 1.5])
def test_a_lamps_reflection_is_a_normal_density_of_its_distance(rho):
    """∫ G(x; ρ/2) dx = 1 over all x, with standard deviation ρ/2 [MODEL.md 3.2: one-dimensional]."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(40)
    towards = float64([0.0, 1.0, 0.0])
    distance = torch.linspace(0, 2, 9, dtype=torch.float64)
    sine = distance * (1 - distance**2 / 4).sqrt()  # of the angle whose chord is `distance`
    r = torch.stack([sine, 1 - distance**2 / 2, 0 * sine], -1)
    found = blur.light_reflection(r, towards, float64(rho))[:, 0].numpy()
    sigma = rho / 2
    expected = np.exp(-(distance.numpy() ** 2) / (2 * sigma**2)) / (sigma * weights.sum())  # Σ w = √(2π)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-300)
    assert (weights * nodes**2).sum() == pytest.approx(weights.sum())  # of a standard normal density


def test_a_lamp_is_seen_where_it_is_mirrored_and_under_the_reflectance():
    """At r = l a metal of F = 1 adds E/(√(2π) σ)."""
    mirror = Metal(float64([1e-9] * 3), float64([1.0] * 3), Blur(float64(0.2)))
    view = unit(0.3, 0.9, -0.1)
    halfway = Points(unit(*(view + SUN.towards).tolist())[None], view[None])
    with_lamp, without = (shade(mirror, halfway, EnvironmentLight(sky, AMBIENT, sources=s)) for s in ((SUN,), ()))
    expected = SUN.radiance / (math.sqrt(2 * math.pi) * 0.1)
    torch.testing.assert_close((with_lamp - without)[0], expected, rtol=1e-8, atol=0)


@given(st.floats(0, 1), st.floats(0, 1))
def test_light_in_creases_is_reflected_once_or_twice(f, openness):
    found = double_bounce(float64([[f]]), float64([[openness]])).item()
    assert found == pytest.approx(openness * f + (1 - openness) * f * f, rel=1e-14, abs=1e-300)
    assert f * f * (1 - 1e-15) <= found <= f * (1 + 1e-15)
    assert double_bounce(float64([[f]]), None).item() == f


@pytest.mark.parametrize("depth", [0.0, 0.25, 1.0])
def test_nearer_things_are_less_blurred_but_lamps_are_as_before(depth):
    f, rho = torch.ones(1, 3).double(), float64(0.8)
    near = EnvironmentLight(sky, AMBIENT, lambda directions: torch.full(directions.shape[:-1], depth).double(), (SUN,))
    lamp = SUN.radiance * blur.light_reflection(POINTS.reflected, SUN.towards, rho)
    expected = blur.blur(sky, POINTS.reflected, rho * depth) + lamp
    torch.testing.assert_close(reflection(f, rho, POINTS, near), expected)


def test_normals_turned_away_reflect_all_as_at_grazing():
    away = dataclasses.replace(POINTS, normal=-POINTS.normal)
    assert (away.normal * away.view).sum() < 0
    found = shade(materials(0.0)["metal"], away, LIGHTS["sky"])
    torch.testing.assert_close(found, sky(away.reflected))  # F(n·v = 0) = 1
    torch.testing.assert_close(away.reflected, POINTS.reflected)  # a mirror has two equal sides


shares = st.one_of(st.floats(0, 1), st.sampled_from([0.0, 1e-40, 1e-12, 1 - 2**-24, 1.0]))
triples = st.tuples(shares, shares, shares)
blur_radii = st.one_of(st.floats(0, 4), st.sampled_from([0.0, 1e-45, 1e-30, 1e-12, 1e-6, 1.1e-6, 1e-3, 50.0]))
indices = st.one_of(st.floats(1e-3, 100), st.sampled_from([1e-6, 1.0, 1e3]))
anywhere = st.one_of(
    st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: math.hypot(*v) > 0.1),
    st.sampled_from([(0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (1e-13, 1.0, 0.0), (1e-30, -1.0, 1e-25), (0.0, 0.0, 1.0)]),
)
any_material = st.one_of(
    st.tuples(st.just(Metal), st.tuples(*[indices] * 3), st.tuples(*[st.floats(0, 100)] * 3), blur_radii),
    st.tuples(st.just(Glossy), triples, triples, blur_radii),
    st.tuples(st.just(Matte), triples, triples),
)
any_place = st.tuples(anywhere, anywhere, shares, triples, st.booleans())


def prepared(drawn, place, dtype):
    """The drawn material and points, as leaves that take gradients; and those leaves."""
    kind, *parameters = drawn
    normal, view, openness, tint, mapped = place
    leaves = [torch.tensor(value, dtype=dtype).requires_grad_() for value in parameters]
    n, v = (unit(*vector).to(dtype)[None].requires_grad_() for vector in (normal, view))
    maps = [torch.tensor([[openness]], dtype=dtype), torch.tensor([tint], dtype=dtype)] if mapped else []
    return made(kind, leaves), Points(n, v, *maps), [*leaves, n, v]


@pytest.mark.parametrize("dtype", DTYPES)
@given(any_material, any_place, shares)
def test_white_furnace(dtype, drawn, place, depth):
    """Under radiance 1 from everywhere no material, however it is seen, returns more than 1."""
    material, points, _ = prepared(drawn, place, dtype)
    furnace = EnvironmentLight(
        torch.ones_like,
        diffuse.constant_ambient(torch.ones(3, dtype=dtype)),
        lambda directions: torch.full(directions.shape[:-1], depth, dtype=dtype),
    )
    found = shade(material, points, furnace)
    # eleven roundings at most on the way of F and of the body, and 14 weights that sum to 1 within their own
    assert ((found >= 0) & (found <= 1 + 24 * torch.finfo(dtype).eps)).all()


@pytest.mark.parametrize("dtype", DTYPES)
@given(any_material, any_place, shares)
def test_nothing_is_ever_infinite_or_no_number(dtype, drawn, place, depth):
    """Nor its derivatives by the material and the geometry, wherever they exist, mirrors and poles included."""
    material, points, leaves = prepared(drawn, place, dtype)
    light = EnvironmentLight(sky, AMBIENT, lambda directions: depth + 0 * directions[..., 0], (SUN, LAMP))
    found = shade(material, points, light)
    assert found.dtype == dtype
    assert found.isfinite().all()
    for gradient in torch.autograd.grad(found.sum(), leaves, allow_unused=True):
        assert gradient is None or gradient.isfinite().all()


@pytest.mark.parametrize("points", [POINTS, MAPPED], ids=["plain", "mapped"])
@pytest.mark.parametrize("light", LIGHTS.values(), ids=LIGHTS)
@pytest.mark.parametrize("name", ["metal", "glossy", "matte"])
def test_derivatives_meet_finite_differences(name, light, points):
    """By every parameter of the material, and by normal and view."""
    kind = type(materials()[name])
    parameters = [value.clone().requires_grad_() for value in materials()[name].numbers.values()]
    geometry = [points.normal.clone().requires_grad_(), points.view.clone().requires_grad_()]

    def shown(*values):
        normal, view = values[-2:]
        return shade(made(kind, values[:-2]), dataclasses.replace(points, normal=normal, view=view), light)

    assert torch.autograd.gradcheck(shown, (*parameters, *geometry))


@pytest.mark.parametrize("name", ["metal", "glossy"])
def test_derivatives_of_a_mirror_meet_finite_differences(name):
    """At ρ = 0 the blur is even in ρ: its slope is 0 but for rounding."""
    kind, mirror = type(materials()[name]), materials(0.0)[name]
    parameters = [value.clone().requires_grad_() for value in mirror.numbers.values()]
    assert torch.autograd.gradcheck(lambda *values: shade(made(kind, values), POINTS, LIGHTS["sky"]), parameters)
    (slope,) = torch.autograd.grad(shade(made(kind, parameters), POINTS, LIGHTS["neighbours"]).sum(), parameters[-1])
    assert abs(slope) < 1e-12  # and a lamp, which a mirror does not show, adds none
