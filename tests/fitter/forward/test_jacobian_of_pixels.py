"""The solver's Jacobian: against central differences in float64, and against Mitsuba's own forward derivatives."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.forward.pixel_model import PixelModel
from fit_material.fitter.options.fidelity import preset
from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.geometry.mesh import Sphere
from fit_material.renderer.mitsuba.conversion import mitsuba
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.renderer.synthesis.camera_placement import views
from fit_material.renderer.synthesis.studio import studio
from fit_material.shaders.materials.types import Metal
from fit_material.shaders.materials.widths import Microfacet
from tests.bench.mitsuba_inverse import Pictures

N, K, ALPHA = (0.146, 0.425, 1.431), (3.578, 2.326, 1.85), 0.2
NUMBERS = torch.tensor([*N, *K, ALPHA], dtype=torch.float64)
SIZE, SEEDS, SPP = 16, 16, 256


def llvm() -> None:
    try:
        mitsuba("llvm_ad_rgb")
    except InputError as error:
        pytest.skip(str(error))


def camera() -> Camera:
    return views(1, Sphere())[0].camera(SIZE)


@pytest.fixture(scope="module")
def covered() -> tuple[GBuffer, torch.Tensor]:
    """Pixels that the ball covers wholly: their rays, and which they are."""
    row, column = torch.meshgrid(torch.arange(SIZE), torch.arange(SIZE), indexing="ij")
    surface = gbuffer.pixel_footprints(gbuffer.tracer(Sphere()), camera(), column.flatten(), row.flatten(), 6)
    whole = surface.front.all(-1)
    return surface[whole], whole.reshape(SIZE, SIZE)


def model_of(surface: GBuffer, samples: int) -> PixelModel:
    lighting = Lighting(studio(64), (), preset("standard"))
    return lighting.pixels(surface, body=False).under(lighting.table(surface, (0.16, 0.25, 5), samples))


def radiance(model: PixelModel, numbers: torch.Tensor) -> torch.Tensor:
    return model.radiance(Metal(numbers[:3], numbers[3:6], Microfacet(numbers[6])))


def test_it_is_that_of_central_differences(covered):
    """With steps h = 1e-4 x, of a function whose third derivative is of the order f/x³:

    truncation h²/6 f''' is 2e-9 of f/x, rounding ε f/h is 2e-12 of it with ε = 2e-16; F of red, where n = 0.15 is
    small against k = 3.6, bends no more sharply than that. Against the largest slope of the same number, 1e-6 leaves
    room for a third derivative that is hundreds of times as large.
    """
    model = model_of(covered[0], 64)
    jacobian = torch.func.jacfwd(lambda x: radiance(model, x))(NUMBERS)
    for i, x in enumerate(NUMBERS):
        step = torch.zeros(7, dtype=torch.float64)
        step[i] = 1e-4 * x
        difference = (radiance(model, NUMBERS + step) - radiance(model, NUMBERS - step)) / (2e-4 * x)
        largest = float(difference.abs().max())
        assert largest > 0
        torch.testing.assert_close(jacobian[..., i], difference, rtol=0, atol=1e-6 * largest)


@pytest.fixture(scope="module")
def mitsubas() -> np.ndarray:
    """The picture and its derivatives by n, k and alpha, by Mitsuba's automatic differentiation: [seed, 4, s, s, 3]."""
    llvm()
    pictures = Pictures(Sphere(), studio(64), [camera()], "direct")
    return np.stack([pictures.derivatives(N, K, ALPHA, 0, SPP, seed) for seed in range(SEEDS)]).astype(float)


@pytest.mark.parametrize("which", [0, 1, 2, 3], ids=["radiance", "by n", "by k", "by alpha"])
def test_it_is_mitsubas_within_the_noise(covered, mitsubas, which):
    """z² of each value, its noise estimated from 16 seeds, has the mean 15/13 of Student's t² with 15 degrees.

    Over the some 130 pixels, whose channels share their paths, that mean has a standard error of √(3.4/130) = 0.16 for
    normal noise; a path tracer's is skewed, which makes few seeds underestimate it in some pixels: up to 2 is taken.
    The mean over all pixels, whose error is independent of such, holds within four of its standard errors, which are
    below 2 % of it: a derivative that missed a part of that size would be seen.
    """
    surface, whole = covered
    model = model_of(surface, 2048)
    value, jacobian = radiance(model, NUMBERS), torch.func.jacfwd(lambda x: radiance(model, x))(NUMBERS)
    own = (
        torch.stack([jacobian[:, c, c] for c in range(3)], 1),
        torch.stack([jacobian[:, c, 3 + c] for c in range(3)], 1),
    )
    ours = (value, *own, jacobian[..., 6])[which].numpy()
    theirs = mitsubas[:, which, whole.numpy()]
    difference, error = theirs.mean(0) - ours, theirs.std(0, ddof=1) / SEEDS**0.5
    assert 0.6 < np.mean((difference / error) ** 2) < 2.0
    of_all, its_error = difference.mean(0), np.sqrt((error**2).mean(0) / len(error))
    assert (np.abs(of_all) < 4 * its_error).all()
    scale = np.abs(ours).mean(0)
    assert (its_error < 0.02 * scale).all()


def test_no_channel_depends_on_anothers_index(covered):
    """What lets one forward pass serve all three channels."""
    model = model_of(covered[0], 16)
    jacobian = torch.func.jacfwd(lambda x: radiance(model, x))(NUMBERS)
    for channel in range(3):
        others = [i for i in range(6) if i % 3 != channel]
        assert float(jacobian[:, channel, others].abs().max()) == 0
