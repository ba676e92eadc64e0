"""Photographs that never were: path-traced views of a metal, and the scene file that a fit starts from."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np
import torch
from jaxtyping import Float

from renderer.atomic import replaced_together
from renderer.camera import Camera, look_at
from renderer.environment import Environment, read_environment
from renderer.errors import InputError
from renderer.images import write_exr
from renderer.mesh import Shape, Sphere, read_mesh
from renderer.studio import Vector, studio, sun_and_sky
from renderer.to_mitsuba import Distribution, conductor, envmap, mitsuba, mitsuba_shape, sensor
from shaders.fresnel import normal_reflectance

SAMPLES_PER_PASS = 2**20  # bounds memory, and the wait between two reports of progress or for Ctrl-C
MADE_HERE = {"studio": studio, "sunsky": sun_and_sky}


@dataclass(frozen=True)
class SynthOptions:
    """What to photograph, and how.

    Attributes:
        n, k: complex refractive index n + ik of the metal, red, green, blue; n > 0, k >= 0, unitless.
        alpha: microfacet width, isotropic, in [0.001, 1].
        distribution: of the microfacets' normals, "ggx" or "beckmann".
        mesh: a mesh file; None for the unit sphere.
        env: "studio", "sunsky", or the path of a map or of a folder with six faces.
        views: number of photographs, 1 to 1000.
        size: width and height of each in pixels, 8 to 8192.
        spp: samples per pixel, >= 1.
        noise: standard deviation of a factor around 1 that every pixel and channel is multiplied by, >= 0.
        seed: of paths and noise; the same seed writes the same bytes.
        fov: full horizontal angle of view in degrees, 1 to 120.
        max_depth: length of the longest path; 2 is light → object → camera; more: it mirrors itself.
        variant: Mitsuba's.
        metal, source: name of the metal and where n and k come from; empty where they were given as numbers.

    Raises:
        InputError: a value is out of its range; names the command-line option.
    """

    n: Vector
    k: Vector
    alpha: float
    distribution: Distribution = "ggx"
    mesh: Path | None = None
    env: str = "studio"
    views: int = 3
    size: int = 256
    spp: int = 1024
    noise: float = 0.0
    seed: int = 0
    fov: float = 35.0
    max_depth: int = 8
    variant: str = "scalar_rgb"
    metal: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        _require("--n", self.n, all(0 < v < math.inf for v in self.n), "three finite numbers > 0")
        _require("--k", self.k, all(0 <= v < math.inf for v in self.k), "three finite numbers >= 0")
        _require("--alpha", self.alpha, 0.001 <= self.alpha <= 1, "at least 0.001 (all but a mirror), at most 1")
        known = get_args(Distribution)
        _require("--distribution", self.distribution, self.distribution in known, " or ".join(known))
        _require("--views", self.views, 1 <= self.views <= 1000, "1 to 1000 photographs")
        _require("--size", self.size, 8 <= self.size <= 8192, "8 to 8192 pixels")
        _require("--spp", self.spp, self.spp >= 1, "at least 1 sample per pixel")
        _require("--noise", self.noise, 0 <= self.noise < math.inf, "a finite number >= 0")
        _require("--seed", self.seed, self.seed >= 0, "an integer >= 0")
        _require("--fov", self.fov, 1 <= self.fov <= 120, "1 to 120 degrees")
        _require("--max-depth", self.max_depth, self.max_depth >= 2, "at least 2: light, object, camera")


def _require(option: str, value: object, fulfilled: bool, expected: str) -> None:
    if not fulfilled:
        raise InputError(option, value=value, expected=expected)


@dataclass(frozen=True)
class View:
    """A camera as scene.toml tells it: positions in world units, `fov` the horizontal angle in degrees."""

    origin: Vector
    target: Vector
    up: Vector
    fov: float

    def camera(self, size: int) -> Camera:
        """The camera of a square photograph, `size` pixels wide."""
        pose = look_at(*(torch.tensor(v, dtype=torch.float64) for v in (self.origin, self.target, self.up)))
        return Camera(pose, size, size, fov=self.fov)


def views(count: int, shape: Shape, fov: float = 35.0, margin: float = 0.06) -> list[View]:
    """Cameras all round an object, each at a height of its own, that see the whole of it.

    Args:
        count: how many; their azimuths are evenly spaced.
        shape: what to look at; its bounding sphere fills the frame but for the margin.
        fov: full horizontal angle of view, degrees.
        margin: how much farther away than necessary to stand, as a fraction.
    """
    target, radius = _bounding_sphere(shape)
    distance = (1 + margin) * radius / math.sin(math.radians(fov) / 2)
    return [_view(index, count, target, distance, fov) for index in range(count)]


def _bounding_sphere(shape: Shape) -> tuple[Float[np.ndarray, " 3"], float]:
    """A sphere round the middle of the bounding box that contains every corner of every face."""
    if isinstance(shape, Sphere):
        return np.zeros(3), 1.0
    corners = shape.vertices[np.unique(shape.faces)]
    middle = (corners.min(0) + corners.max(0)) / 2
    return middle, float(np.linalg.norm(corners - middle, axis=1).max())


def _view(index: int, count: int, target: Float[np.ndarray, " 3"], distance: float, fov: float) -> View:
    """Even steps round +Y; the golden ratio spreads the elevations evenly over -20° to 50°, for any count."""
    golden = (math.sqrt(5) - 1) / 2
    azimuth = math.radians(25 + 360 * index / count)
    elevation = math.radians(-20 + 70 * ((0.5 + golden * index) % 1))
    level = math.cos(elevation)
    towards = np.array([level * math.sin(azimuth), math.sin(elevation), level * math.cos(azimuth)])
    origin = target + distance * towards
    return View(_vector(origin), _vector(target), (0.0, 1.0, 0.0), fov)


def _vector(array: Float[np.ndarray, " 3"]) -> Vector:
    x, y, z = array.tolist()
    return x, y, z


def render(
    shape: Shape,
    camera: Camera,
    environment: Environment,
    bsdf: dict[str, Any],
    *,
    spp: int,
    seed: int = 0,
    max_depth: int = 8,
    variant: str = "scalar_rgb",
    progress: Callable[[float], None] = lambda share: None,
) -> Float[np.ndarray, "h w 4"]:
    """Path-trace one photograph.

    Args:
        shape, camera, environment: what is seen, from where, in which light.
        bsdf: the material, in Mitsuba's terms; see `renderer.to_mitsuba.conductor`.
        spp: samples per pixel.
        seed: of the paths, >= 0; the same seed gives the same picture.
        max_depth: length of the longest path; 2 is light → object → camera.
        variant: Mitsuba's, "scalar_rgb" or "llvm_ad_rgb".
        progress: called with the share that is done, in (0, 1].

    Returns:
        Linear radiance, premultiplied by the fourth channel, coverage in [0, 1]; float32. The environment
        itself is not in the picture, only what it does to the object.
    """
    mi = mitsuba(variant)
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": max_depth, "hide_emitters": True},
            "sensor": sensor(camera),
            "light": envmap(environment),
            "object": mitsuba_shape(shape, bsdf),
        }
    )
    passes = _passes(spp, camera.width * camera.height)
    seeds = np.random.SeedSequence(seed).generate_state(len(passes))
    total, done = np.zeros((camera.height, camera.width, 4)), 0
    for samples, pass_seed in zip(passes, seeds.tolist(), strict=True):
        total += samples * np.array(mi.render(scene, spp=samples, seed=pass_seed), np.float64)
        done += samples
        progress(done / spp)
    return (total / spp).astype(np.float32)


def _passes(spp: int, pixels: int) -> list[int]:
    """Samples per pixel of each pass: as many as SAMPLES_PER_PASS allows, the rest in the last."""
    most = max(1, SAMPLES_PER_PASS // pixels)
    return [min(most, spp - start) for start in range(0, spp, most)]


def synthesise(
    options: SynthOptions,
    out_dir: str | Path,
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> Path:
    """Photograph a metal object and write everything that a fit needs, and the truth beside it.

    The folder is self-contained: view_0.exr …, environment.exr, the mesh file, scene.toml, truth.json. All
    files appear together at the end; when anything goes wrong before, the folder keeps what it had.

    Args:
        options: what to photograph, and how.
        out_dir: where to; made if need be.
        progress: called with what is being done and the share of all photographs that is done, in [0, 1].

    Returns:
        The path of scene.toml.

    Raises:
        InputError: mesh or map cannot be read, or the folder not written.
    """
    progress("environment", 0.0)
    environment = _environment(options)
    shape = Sphere() if options.mesh is None else read_mesh(options.mesh)
    poses = views(options.views, shape, options.fov)
    with replaced_together(out_dir, last="scene.toml") as folder:
        write_exr(folder / "environment.exr", environment.radiance.numpy())
        if options.mesh is not None:
            (folder / options.mesh.name).write_bytes(options.mesh.read_bytes())
        for index, pose in enumerate(poses):
            report = _share_of_all(progress, index, options.views)
            pixels = _photograph(options, shape, pose, environment, index, report)
            write_exr(folder / f"view_{index}.exr", pixels)
        (folder / "scene.toml").write_text(_scene_toml(options, poses), encoding="utf-8")
        truth = json.dumps(_truth(options), indent=2, allow_nan=False, ensure_ascii=False)
        (folder / "truth.json").write_text(truth + "\n", encoding="utf-8")
    return Path(out_dir) / "scene.toml"


def _share_of_all(progress: Callable[[str, float], None], index: int, count: int) -> Callable[[float], None]:
    """Turns the share of one photograph that is done into the share of all."""
    return lambda share: progress(f"photograph {index + 1} of {count}", (index + share) / count)


def _environment(options: SynthOptions) -> Environment:
    make = MADE_HERE.get(options.env)
    return read_environment(options.env) if make is None else make()


def _photograph(
    options: SynthOptions,
    shape: Shape,
    pose: View,
    environment: Environment,
    index: int,
    progress: Callable[[float], None],
) -> Float[np.ndarray, "h w 4"]:
    """One photograph with its noise; paths and noise of each have seeds of their own."""
    path_seed, noise_seed = np.random.SeedSequence([options.seed, index]).generate_state(2).tolist()
    pixels = render(
        shape,
        pose.camera(options.size),
        environment,
        _bsdf(options),
        spp=options.spp,
        seed=path_seed,
        max_depth=options.max_depth,
        variant=options.variant,
        progress=progress,
    )
    pixels[..., :3] *= 1 + options.noise * np.random.default_rng(noise_seed).normal(size=pixels[..., :3].shape)
    return pixels


def _bsdf(options: SynthOptions) -> dict[str, Any]:
    return conductor(options.n, options.k, options.alpha, options.distribution)


def _scene_toml(options: SynthOptions, poses: list[View]) -> str:
    """The scene as DESIGN.md's contract has it; a float's repr is exact, and valid TOML."""
    geometry = 'shape = "sphere"' if options.mesh is None else f"mesh = {_quoted(options.mesh.name)}\nsmooth = true"
    head = f'[geometry]\n{geometry}\n\n[environment]\nmap = "environment.exr"\nrotation = 0.0\nscale = 1.0\n'
    return head + "".join(_photograph_toml(index, pose) for index, pose in enumerate(poses))


def _photograph_toml(index: int, pose: View) -> str:
    return f"""
[[photographs]]
image = "view_{index}.exr"
exposure = 1.0
[photographs.camera]
origin = {list(pose.origin)}
target = {list(pose.target)}
up = {list(pose.up)}
fov = {float(pose.fov)}
"""


def _quoted(text: str) -> str:
    """A TOML basic string, which JSON's strings are, but for DEL, which TOML wants escaped."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _truth(options: SynthOptions) -> dict[str, Any]:
    """What the photographs show, to compare a fit with; the spectra as Mitsuba holds them, in float32."""
    mi = mitsuba(options.variant)
    held = mi.traverse(mi.load_dict(_bsdf(options)))
    n, k = (torch.tensor(index, dtype=torch.float64) for index in (options.n, options.k))
    material = {
        "name": "default",
        "type": "metal",
        "n": list(options.n),
        "k": list(options.k),
        "f0": normal_reflectance(n, k).tolist(),
        "alpha": options.alpha,
        "distribution": options.distribution,
        "metal": options.metal or None,
        "source": options.source or None,
    }
    return {
        "format": 1,
        "materials": [material],
        "spp": options.spp,
        "noise": options.noise,
        "seed": options.seed,
        "max_depth": options.max_depth,
        "environment": options.env,
        "variant": options.variant,
        "mitsuba": mi.__version__,
        "spectra": {name: np.array(held[f"{name}.value"]).ravel().tolist() for name in ("eta", "k")},
    }
