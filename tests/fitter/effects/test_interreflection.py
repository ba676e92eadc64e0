"""Mitsuba as the forward model of a fit: in a bowl, which mirrors itself, and where there is nothing to mirror."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch

from fit_material.fitter.effects.interreflection import PolishedPixels, Tangent
from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.forward.pixel_model import PixelModel
from fit_material.fitter.options.fidelity import PRESETS, preset
from fit_material.fitter.pipeline import describe_fit
from fit_material.fitter.pipeline.fit_scene import FitOptions, fit_scene
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.geometry.mesh import Sphere
from fit_material.renderer.materials.bsdf import conductor
from fit_material.renderer.mitsuba.conversion import mitsuba
from fit_material.renderer.path_tracing.differentiable_scene import DifferentiableScene, Radiance
from fit_material.renderer.path_tracing.path_tracer import render
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.renderer.synthesis.camera_placement import views
from fit_material.shaders.materials.types import Material, Metal
from fit_material.shaders.materials.widths import Microfacet
from fit_material.shaders.optics import fresnel
from tests.support.bowl import ALPHA, K, N, bowl, light, looks, photographs

SIZE, SEEDS, SPP = 12, 12, 192
CAMERA = looks()[0].camera(SIZE)


@pytest.fixture(autouse=True)
def _llvm():
    try:
        mitsuba("llvm_ad_rgb")
    except InputError as error:
        pytest.skip(str(error))


def gold(n=0.0, k=0.0, alpha=0.0) -> Metal:
    """With these changes of its numbers."""
    made = (torch.tensor(each, dtype=torch.float64) for each in (N, K, ALPHA))
    return metal_of(*(number + change for number, change in zip(made, (n, k, alpha), strict=True)))


def metal_of(n, k, alpha) -> Metal:
    return Metal(n, k, Microfacet(alpha))


def inside() -> tuple[GBuffer, np.ndarray]:
    """Pixels that the bowl's inner side covers wholly, 6 × 6 rays in each: their rays, and which they are."""
    row, column = (torch.as_tensor(grid.ravel()) for grid in np.mgrid[:SIZE, :SIZE])
    surface = gbuffer.pixel_footprints(gbuffer.tracer(bowl()), CAMERA, column, row, 6)
    whole = surface.front.all(-1)
    return surface[whole], whole.reshape(SIZE, SIZE).numpy()


@pytest.fixture(scope="module")
def scene() -> DifferentiableScene:
    return DifferentiableScene(bowl(), light(), (), [conductor(N, K, ALPHA)])


@pytest.fixture(scope="module")
def traced(scene) -> list[Radiance]:
    surface, _ = inside()
    return [scene.radiance(surface, gold(), samples=SPP, seed=seed) for seed in range(SEEDS)]


def assert_alike(first: np.ndarray, second: np.ndarray) -> None:
    """Two sets of estimates [seed, p, 3] of the same mean: by z² of each value, and by the mean over pixels.

    z² has the mean 22/20 of Student's t² with 22 degrees; noise that is skewed, and shared by the channels of some
    80 pixels, leaves it within 0.6 … 2.
    """
    difference = first.mean(0) - second.mean(0)
    variance = (first.var(0, ddof=1) + second.var(0, ddof=1)) / SEEDS
    assert 0.6 < (difference**2 / variance).mean() < 2.0
    of_all, error = difference.mean(0), np.sqrt(variance.mean(0) / len(difference))
    assert (np.abs(of_all) < 4 * error).all()
    assert (error < 0.02 * np.abs(first.mean(0)).mean(0)).all()  # it would see a part of that size


def stacked(found: list[Radiance], name: str) -> np.ndarray:
    return np.stack([getattr(each, name).numpy() for each in found])


def test_paths_bring_what_mitsubas_own_integrator_brings(traced):
    _, whole = inside()
    metal = conductor(N, K, ALPHA)
    pictures = [
        render(bowl(), CAMERA, light(), metal, spp=SPP, seed=100 + seed, variant="llvm_ad_rgb") for seed in range(SEEDS)
    ]
    assert_alike(stacked(traced, "value"), np.stack(pictures)[:, whole, :3].astype(float))


@pytest.mark.parametrize("name", ["n", "k", "alpha"])
def test_derivatives_are_differences_along_the_same_paths(scene, name):
    """Paths of one seed, drawn for one metal, stay the same when it changes, so that nothing is left to chance.

    Steps of 1 % of the value leave h²/6 f''' = 2e-5 of f/x, of a function that bends on the scale of its argument, and
    of float32's rounding 1e-7/0.01 of each value; against the largest slope 1e-3 is ten times that.
    """
    surface, _ = inside()
    step = 0.01 * torch.tensor({"n": N, "k": K, "alpha": ALPHA}[name], dtype=torch.float64)
    metals = (gold(**{name: sign * step}) for sign in (1, -1))
    up, down = (scene.radiance(surface, metal, samples=72, seed=5, drawn=gold()).value for metal in metals)
    slope = getattr(scene.radiance(surface, gold(), samples=72, seed=5), f"by_{name}")
    difference = (up - down) / (2 * step)
    assert ((slope - difference).abs().amax(0) < 1e-3 * difference.abs().amax(0)).all()


def test_derivative_by_alpha_is_that_of_other_paths(scene, traced):
    """Central differences over ± 0.03: their truncation, h²/6 f''' = 0.2 % of f/alpha, is below the noise."""
    surface, _ = inside()

    def at(change: float, seed: int) -> np.ndarray:
        return scene.radiance(surface, gold(alpha=change), samples=SPP, seed=seed).value.numpy()

    differences = np.stack([(at(0.03, 200 + seed) - at(-0.03, 300 + seed)) / 0.06 for seed in range(SEEDS)])
    slopes = stacked(traced, "by_alpha")
    difference = slopes.mean(0) - differences.mean(0)
    variance = (slopes.var(0, ddof=1) + differences.var(0, ddof=1)) / SEEDS
    assert 0.6 < (difference**2 / variance).mean() < 2.0
    assert (np.abs(difference.mean(0)) < 4 * np.sqrt(variance.mean(0) / len(difference))).all()


def test_direct_light_and_what_is_beyond_it_are_all_light(scene, traced):
    """Beyond the light that nothing hides, by our table, lies what the bowl hides and mirrors of its own."""
    surface, _ = inside()
    settings = [Lighting(light(), (), preset("standard"), seed) for seed in range(SEEDS)]
    direct = np.stack([lighting.radiance(gold(), surface, 1024).numpy() for lighting in settings])
    beyond = [scene.radiance(surface, gold(), samples=SPP, seed=400 + s, beyond_direct=True) for s in range(SEEDS)]
    assert_alike(stacked(traced, "value"), direct + stacked(beyond, "value"))
    assert np.abs(stacked(beyond, "value").mean(0)).max() > 0.1 * direct.mean()


def test_a_ball_hides_nothing_from_itself():
    """Every path that leaves it is gone, so that not even noise is left."""
    ball = DifferentiableScene(Sphere(), light(), (), [conductor(N, K, ALPHA)])
    camera = views(1, Sphere())[0].camera(8)
    surface = gbuffer.pixel_centres(gbuffer.tracer(Sphere()), camera)
    surface = surface[surface.front][:, None]
    found = ball.radiance(surface, gold(), samples=64, seed=1, beyond_direct=True)
    assert all(float(each.abs().max()) == 0 for each in (found.value, found.by_n, found.by_k, found.by_alpha))
    whole = ball.radiance(surface, gold(), samples=64, seed=1).value
    assert float(whole.min()) > 0


class Nothing(PixelModel):
    """No light at all."""

    table = None

    def radiance(self, material: Material) -> torch.Tensor:
        return torch.zeros(1, 3, dtype=torch.float64)

    def under(self, table) -> PixelModel:
        return self


def test_what_is_added_is_tangent_to_what_was_computed():
    """For light whose dependence is known, 2 F0 + 3 n + alpha k: the model has its value and slopes at the metal."""

    def known(metal: Metal) -> torch.Tensor:
        return (2 * metal.f0 + 3 * metal.n + metal.width.value * metal.k)[None]

    def of(n: torch.Tensor, k: torch.Tensor, alpha: torch.Tensor) -> torch.Tensor:
        return known(metal_of(n, k, alpha))

    at = gold()
    slopes = torch.func.jacfwd(of, argnums=(0, 1, 2))(at.n, at.k, at.width.value)
    by_n, by_k = (each.diagonal(dim1=1, dim2=2) for each in slopes[:2])
    model = PolishedPixels(Nothing(), (Tangent.of(Radiance(known(at), by_n, by_k, slopes[2]), at),))
    torch.testing.assert_close(model.radiance(at), known(at))
    polished = torch.func.jacfwd(lambda *numbers: model.radiance(metal_of(*numbers)), argnums=(0, 1, 2))
    for mine, theirs in zip(polished(at.n, at.k, at.width.value), slopes, strict=True):
        torch.testing.assert_close(mine, theirs)


@pytest.mark.slow
def test_paths_that_the_plan_calls_for_remove_what_interreflection_does_to_a_fit(tmp_path, monkeypatch):
    """A gold bowl of alpha 0.3, all of which sees itself. A fit without what that does takes the light that the walls
    hide for a darker metal, by many standard errors; by the plan every number holds the truth within four.
    """
    scene = photographs(tmp_path, 40, 512)
    fidelity = replace(PRESETS["standard"], pixels=1500)
    true_f0 = fresnel.normal_reflectance(gold().n, gold().k).numpy()
    found, results = {}, {}
    drawn, strips = [], describe_fit.strips
    monkeypatch.setattr(describe_fit, "strips", lambda *arguments: drawn.extend(strips(*arguments)) or drawn)
    for planned in (False, True):
        drawn.clear()
        unwanted = () if planned else ("self-visibility", "interreflection")
        options = FitOptions(fidelity, type="metal", unwanted=unwanted)
        results[planned] = fit_scene(scene, tmp_path / str(planned), options)
        material = results[planned].materials[0]
        errors = np.array([*material.f0, material.alpha]) - [*true_f0, ALPHA]
        found[planned] = np.abs(errors) / np.array([*material.stderr.f0, material.stderr.alpha])
        print(planned, material.f0, material.stderr.f0, material.alpha, material.stderr.alpha, found[planned])
    light = {strip.name: strip.fit[strip.mask].mean() / strip.photograph[strip.mask].mean() for strip in drawn}
    assert light["self-visibility"] > 1.1  # the walls hide some of the sky,
    assert light["interreflection"] < 0.9  # and send some light themselves
    assert found[False].max() > 6
    assert (found[True] < 4).all()
    effects = {effect.name: effect.on for effect in results[True].effects}
    assert effects["interreflection"]
    assert effects["self-visibility"]
    assert results[True].model.fidelity == "standard, polished by Mitsuba's path tracer"
    assert results[True].quality.overall.rms_relative < 0.7 * results[False].quality.overall.rms_relative


def test_the_viewers_model_is_not_polished(tmp_path):
    with pytest.raises(InputError, match=r"--polish: expected preview, standard or reference for --fidelity"):
        fit_scene(tmp_path / "none.toml", tmp_path, FitOptions(PRESETS["viewer"], polish=True))


def test_without_llvm_the_user_learns_which_package_to_install(tmp_path):
    command = [sys.executable, "-m", "fit_material", "fit", "scene.toml", "-o", str(tmp_path), "--polish", "--quiet"]
    environment = {**os.environ, "FIT_MATERIAL_LLVM": "none"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.returncode == 2
    assert "--polish: expected LLVM's shared library (Debian: apt install libllvm19)" in done.stderr
    assert "Traceback" not in done.stderr
