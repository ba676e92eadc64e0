"""Path tracing by Mitsuba: one photograph of a shape made of known materials, in known surroundings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from jaxtyping import Float

from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.geometry.mesh import Shape
from fit_material.renderer.materials.bsdf import Bsdf
from fit_material.renderer.mitsuba.conversion import emitters, envmap, mitsuba, mitsuba_shapes, sensor
from fit_material.shaders.lights import Light

SAMPLES_PER_PASS = 2**20  # bounds memory, and the wait between two reports of progress or for Ctrl-C


def render(
    shape: Shape,
    camera: Camera,
    environment: Environment,
    bsdf: Bsdf | Sequence[Bsdf],
    *,
    lights: Sequence[Light] = (),
    spp: int,
    seed: int = 0,
    max_depth: int = 8,
    variant: str = "scalar_rgb",
    progress: Callable[[float], None] = lambda share: None,
) -> Float[np.ndarray, "h w 4"]:
    """Path-trace one photograph.

    Args:
        shape, camera, environment: of the picture.
        bsdf: the material, in Mitsuba's terms, see `renderer.mitsuba.conversion.bsdf_of`; or one for each of the
            mesh's `material_names`.
        lights: beside the environment; seen by nothing but what they light.
        spp: samples per pixel.
        seed: of the paths, >= 0; the same seed gives the same picture.
        max_depth: length of the longest path; 2 is light → object → camera.
        variant: Mitsuba's, "scalar_rgb" or "llvm_ad_rgb".
        progress: called with the share that is done, in (0, 1].

    Returns:
        Linear radiance, premultiplied by the fourth channel, coverage in [0, 1]; float32. The environment
        itself is not in the picture, only what it does to the object.
    """
    samples = _passes(spp, camera.width * camera.height)
    pictures = passes(
        shape, camera, environment, bsdf, samples, lights=lights, seed=seed, max_depth=max_depth, variant=variant
    )
    total, done = np.zeros((camera.height, camera.width, 4)), 0
    for count, pixels in zip(samples, pictures, strict=True):
        total += count * pixels.astype(np.float64)
        done += count
        progress(done / spp)
    return (total / spp).astype(np.float32)


def passes(
    shape: Shape,
    camera: Camera,
    environment: Environment,
    bsdf: Bsdf | Sequence[Bsdf],
    samples: Sequence[int],
    *,
    lights: Sequence[Light] = (),
    seed: int = 0,
    max_depth: int = 8,
    variant: str = "scalar_rgb",
) -> Iterator[Float[np.ndarray, "h w 4"]]:
    """Independent estimates of one photograph, whose mean is `render`'s; their scatter is its noise.

    Args:
        samples: per pixel, of each estimate.
        shape, camera, environment, bsdf, lights, seed, max_depth, variant: as `render`'s.
    """
    mi = mitsuba(variant)
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": max_depth, "hide_emitters": True},
            "sensor": sensor(camera),
            "light": envmap(environment),
            **emitters(lights),
            **mitsuba_shapes(shape, [bsdf] if isinstance(bsdf, dict) else bsdf),
        }
    )
    seeds = np.random.SeedSequence(seed).generate_state(len(samples))
    for count, pass_seed in zip(samples, seeds.tolist(), strict=True):
        yield np.array(mi.render(scene, spp=count, seed=pass_seed))


def _passes(spp: int, pixels: int) -> list[int]:
    """Samples per pixel of each pass: as many as SAMPLES_PER_PASS allows, the rest in the last."""
    most = max(1, SAMPLES_PER_PASS // pixels)
    return [min(most, spp - start) for start in range(0, spp, most)]
