"""GLSL against torch: single functions over their domains, and whole pictures.

Where the error comes from: the shader computes in float32, r to 5e-7 (2e-7 in the median; measured with rays that meet
triangles in double precision), which is 1e-4 of a texel of 0.006; where a texel beside a lamp is 25 times as bright as
its neighbour, that is 2e-3 of the darker one's value. 99.9 % of pixels keep well below; so does a mirror, ρ = 0, in
which nothing is averaged. torch computes in float64 here, but looks cubemaps up in float32, which errs as much again.
With rays interpolated by the rasteriser, as the window has them, a mirror misses the figure twice over.
"""

from __future__ import annotations

import itertools

import moderngl
import numpy as np
import pytest
import torch
from jaxtyping import Float

from fit_material.renderer.environment.cubemap import Cubemap, lookup
from fit_material.renderer.opengl import offscreen
from fit_material.renderer.opengl.programs import programs
from fit_material.renderer.opengl.uploads import cubemap_texture
from fit_material.renderer.synthesis.studio import studio
from fit_material.renderer.viewer_model.shading import render as torch_render
from fit_material.renderer.viewer_model.viewer_light import Surroundings, surroundings
from fit_material.shaders.normal_map import perturbed
from fit_material.shaders.optics import blur, diffuse, fresnel
from tests.support import parity
from tests.support.parity import Case, assert_same_picture

COUNT = 4096
EPS = 2.0**-23
_TYPES = {1: "float", 2: "vec2", 3: "vec3", 4: "vec4"}

QUICK = [
    Case("metal", light=True, normal_map=True, occlusion=True),
    Case("mirror"),
    Case("glossy", light=True, color_map=True),
    Case("matte", light=True, normal_map=True, occlusion=True, neighbours=True, color_map=True),
]
EVERY = [
    Case(material, *effects, color_map=material != "metal" and effects[0])
    for material, *effects in itertools.product(parity.MATERIALS, *[(False, True)] * 4)
]


@pytest.fixture(scope="module")
def far() -> Surroundings:
    return surroundings(studio(256))


def both_pictures(case: Case, far: Surroundings) -> tuple[np.ndarray, np.ndarray]:
    model, light, camera = case.model(), case.surroundings(far), parity.camera()
    return offscreen.render(model, camera, light, sky=False, antialias=1), torch_render(model, camera, light).numpy()


@pytest.mark.parametrize("case", QUICK, ids=str)
def test_pictures_are_the_same(case, far, gl, tmp_path):
    assert_same_picture(*both_pictures(case, far), tmp_path, str(case))


@pytest.mark.slow
@pytest.mark.parametrize("case", EVERY, ids=str)
def test_pictures_are_the_same_under_all_combinations_of_effects(case, far, gl, tmp_path):
    assert_same_picture(*both_pictures(case, far), tmp_path, str(case))


@pytest.mark.parametrize("material", parity.MATERIALS)
@pytest.mark.parametrize("effect", ["light", "normal_map", "occlusion", "neighbours", "color_map"])
def test_every_effect_shows(material, effect, far, gl):
    """Else the pictures could be the same without it. A metal has no colour, matte surfaces mirror nothing."""
    without = {("metal", "color_map"), ("mirror", "color_map"), ("matte", "neighbours"), ("mirror", "light")}
    camera = parity.camera(64)
    plain, changed = (
        offscreen.render(case.model(), camera, case.surroundings(far), sky=False, antialias=1)
        for case in (Case(material), Case(material, **{effect: True}))
    )
    seen = (plain[..., 3] == 1) & (changed[..., 3] == 1)
    if effect == "neighbours":  # where the ball itself is not in front of the torus
        alone = offscreen.render(
            Case(material, neighbours=True).model(), camera, far, sky=False, antialias=1, neighbours=False
        )
        seen &= np.isclose(alone, plain, rtol=1e-3).all(-1)
    difference = parity.relative_error(changed, plain)[seen].max()
    assert difference < 1e-5 if (material, effect) in without else difference > 0.05


def evaluated(context: moderngl.Context, expression: str, cube: Cubemap | None = None, **values: torch.Tensor):
    """A GLSL expression of vec4 at COUNT points; the values [COUNT, 1 to 4] are textures that it names."""
    texture = {
        name: context.texture((COUNT, 1), value.shape[1], value.float().contiguous().numpy().tobytes(), dtype="f4")
        for name, value in values.items()
    }
    fetched = "".join(
        f"{_TYPES[value.shape[1]]} {name} = texelFetch(texels_{name}, ivec2(gl_FragCoord.xy), 0)"
        f".{'rgba'[: value.shape[1]]};\n"
        for name, value in values.items()
    )
    programs(context)  # makes the files known to the compiler
    files = "".join(f'#include "{name}.glsl"\n' for name in ("fresnel", "lobe", "diffuse", "normal_map"))
    samplers = "".join(f"uniform sampler2D texels_{name};\n" for name in values)
    program = context.program(
        vertex_shader="#version 430 core\nvoid main() "
        "{ gl_Position = vec4(4.0 * vec2(gl_VertexID % 2, gl_VertexID / 2) - 1.0, 0.0, 1.0); }",
        fragment_shader=f"#version 430 core\n{files}{samplers}uniform samplerCube cube;\nout vec4 result;\n"
        + f"void main() {{\n{fetched}result = vec4({expression});\n}}",
    )
    for unit, name in enumerate(values):
        texture[name].use(unit)
        program[f"texels_{name}"] = unit
    if cube is not None:
        cubemap_texture(context, cube.faces).use(len(values))
        program["cube"] = len(values)
    target = context.framebuffer([context.texture((COUNT, 1), 4, dtype="f4")])
    target.use()
    context.enable_only(moderngl.NOTHING)
    context.vertex_array(program, []).render(vertices=3)
    return np.frombuffer(target.read(components=4, dtype="f4"), np.float32).reshape(COUNT, 4)


def uniform(channels: int, low: float = 0.0, high: float = 1.0, seed: int = 0) -> Float[torch.Tensor, "n c"]:
    """Numbers in [low, high] that float32 holds, with both ends among them."""
    drawn = torch.rand(COUNT, channels, generator=torch.Generator().manual_seed(seed))
    drawn[:64] = drawn[:64].round()
    return (low + (high - low) * drawn).double()


def unit_vectors(seed: int = 0) -> Float[torch.Tensor, "n 3"]:
    """Directions all round, those along the axes first; float64 values of float32 vectors, of length 1 to rounding."""
    drawn = torch.randn(COUNT, 3, generator=torch.Generator().manual_seed(seed))
    drawn[:6] = torch.cat([torch.eye(3), -torch.eye(3)])
    return torch.nn.functional.normalize(drawn, dim=-1).double()


def test_reflectances(gl):
    """A dozen roundings, each of at most 1 ulp of a value that is at most a few times F's."""
    c, f0 = uniform(1), uniform(3, seed=1)
    n, k = uniform(3, 0.02, 5.0, seed=2), uniform(3, 0.0, 8.0, seed=3)
    dielectric = evaluated(gl, "schlick(c, f0), 1", c=c, f0=f0)[:, :3]
    metal = evaluated(gl, "lazanyi(c, n, k), 1", c=c, n=n, k=k)[:, :3]
    np.testing.assert_allclose(dielectric, fresnel.schlick(c, f0), rtol=12 * EPS, atol=12 * EPS)
    np.testing.assert_allclose(metal, fresnel.lazanyi(c, n, k), rtol=24 * EPS, atol=12 * EPS)


def test_energy_guard_over_its_whole_domain(gl):
    """1 - F loses digits where F is near 1, and the colour with it, by at most 1 ulp of 1."""
    color, f = uniform(3), uniform(3, seed=1)
    guarded = evaluated(gl, "energy_guard(color, f), 1", color=color, f=f)[:, :3]
    np.testing.assert_allclose(guarded, diffuse.energy_guard(color, f), rtol=8 * EPS, atol=2 * EPS)


def test_tap_weights(gl):
    i = torch.arange(COUNT, dtype=torch.float64)[:, None] % 7
    weights = evaluated(gl, "TAP_WEIGHTS[int(i)], 0, 0, 1", i=i)[:7, 0]
    np.testing.assert_allclose(weights, blur.tap_weights(), rtol=EPS)


def test_the_axis_of_the_blur_near_the_poles(gl):
    """Down to 1e-12 from the pole it is a unit vector along (z, 0, -x), beyond it (1, 0, 0)."""
    r = unit_vectors()
    r[:2] = torch.tensor([[1e-13, 1.0, 0.0], [0.0, -1.0, 2e-12]], dtype=torch.float64)
    axis = evaluated(gl, "horizontal_axis(r), 1", r=r)[:, :3]
    np.testing.assert_allclose(axis, blur.tap_axes(r)[0], atol=4 * EPS)


def test_reflections_of_lights(gl):
    """exp(-x²/2σ²) magnifies the roundings of x/σ, which is at most 14 where the exponential is not 0."""
    r, towards, rho = unit_vectors(), unit_vectors(1), uniform(1, 0.02, 2.0)
    drawn = evaluated(gl, "light_reflection(r, l, rho), 0, 0, 1", r=r, l=towards, rho=rho)[:, 0]
    expected = torch.stack(
        [blur.light_reflection(*each)[0] for each in zip(r[:512], towards[:512], rho[:512, 0], strict=True)]
    )
    np.testing.assert_allclose(drawn[:512], expected, rtol=14**2 * 4 * EPS, atol=1e-30)


def test_perturbed_normals(gl):
    """Six roundings, magnified 22 times where the tangent is nearly along the normal, 10 times where m is short."""
    normal, tangent, texel = 3 * uniform(3, -1, 1, seed=1), uniform(3, -1, 1, seed=2), uniform(3, seed=3)
    hand = uniform(1, seed=4).round() * 2 - 1
    tangent[:8] = 0  # which has no direction: the map's x and y drop out
    texel[8:16] = 0.5  # neither has this texel: the normal stays
    n = torch.nn.functional.normalize(normal, dim=-1)
    along = (torch.nn.functional.normalize(tangent, dim=-1) * n).sum(-1).abs()
    told = (normal.norm(dim=-1) > 0.1) & ((along < 0.999) | (tangent == 0).all(-1))
    told &= ((2 * texel - 1).norm(dim=-1) > 0.1) | (texel == 0.5).all(-1)
    expected = perturbed(normal, tangent, hand, texel)
    drawn = evaluated(gl, "perturbed(a, t, h, m), 1", a=normal, t=tangent, h=hand, m=texel)[:, :3]
    assert told.sum() > COUNT // 2
    assert np.isfinite(drawn).all()
    np.testing.assert_allclose(drawn[told], expected[told], atol=6 * 22 * 10 * EPS)


def test_the_blur(gl):
    """Of a cubemap as rough as can be: a texel's position errs by some ulp of its index, its value by as much."""
    size = 32
    cube = Cubemap(torch.rand(6, size, size, 3, generator=torch.Generator().manual_seed(9)))
    r, rho = unit_vectors(), uniform(1, 0.0, 1.5)
    drawn = evaluated(gl, "blur(cube, r, rho), 1", cube, r=r, rho=rho)[:, :3]
    exact = Cubemap(cube.faces.double())
    expected = blur.blur(lambda directions: lookup(exact, directions), r, rho[:, 0])
    np.testing.assert_allclose(drawn, expected, atol=4 * size * EPS)
