"""Photographs that never were: rendered views of known materials, and the scene file that a fit starts from."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
from jaxtyping import Float

from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.environment.environment_file import read_environment
from fit_material.renderer.errors.printable import unicode_text
from fit_material.renderer.files.atomic import replaced_together
from fit_material.renderer.files.regular_files import read_bytes
from fit_material.renderer.geometry.mesh import UNNAMED, Mesh, Shape, Sphere, read_mesh
from fit_material.renderer.images.image_file import write_exr
from fit_material.renderer.materials.bsdf import Bsdf
from fit_material.renderer.materials.ground_truth import ShadingModel, TrueMaterial, require, require_shadable
from fit_material.renderer.mitsuba.conversion import AUTO, bsdf_of, mitsuba, variant_here
from fit_material.renderer.path_tracing.path_tracer import render
from fit_material.renderer.scene.lights import LightSpec, light_of
from fit_material.renderer.synthesis.camera_placement import views
from fit_material.renderer.synthesis.scene_writer import (
    MAP,
    SCENE,
    TRUTH,
    copied_mesh,
    material_entry,
    outputs_of,
    require_room_for_photographs,
    scene_toml,
    view_name,
)
from fit_material.renderer.synthesis.studio import studio, sun_and_sky

MADE_HERE = {"studio": studio, "sunsky": sun_and_sky}

Progress = Callable[[float], None]
Photographer = Callable[[Camera, int, Progress], Float[np.ndarray, "h w 4"]]
"""Takes a photograph: camera, seed, and a function called with the fraction done."""


@dataclass(frozen=True)
class SynthOptions:
    """What to photograph, and how.

    Attributes:
        material: what all of the shape is made of; or the material for each name that the mesh has.
        model: whose materials: "mitsuba" traces paths, "viewer" shades as the thesis does.
        mesh: a mesh file; None for the unit sphere.
        env: "studio", "sunsky", or the path of a map or of a folder with six faces.
        lights: beside it.
        views: number of photographs, 1 to 1000.
        size: width and height of each in pixels, 8 to 8192.
        spp: samples per pixel, >= 1; the viewer takes one.
        noise: standard deviation of a factor around 1 that every pixel and channel is multiplied by, >= 0.
        seed: of paths and noise; the same seed writes the same bytes, by the same variant.
        fov: full horizontal angle of view in degrees, 1 to 120.
        max_depth: length of the longest path; 2 is light → object → camera; more: it mirrors itself.
        variant: Mitsuba's; "auto" is llvm_ad_rgb where LLVM is found, else scalar_rgb, and truth.json records which.

    Raises:
        InputError: a value is out of its range; names the command-line option.
    """

    material: TrueMaterial | Mapping[str, TrueMaterial]
    model: ShadingModel = "mitsuba"
    mesh: Path | None = None
    env: str = "studio"
    lights: tuple[LightSpec, ...] = ()
    views: int = 3
    size: int = 256
    spp: int = 1024
    noise: float = 0.0
    seed: int = 0
    fov: float = 35.0
    max_depth: int = 8
    variant: str = AUTO

    def __post_init__(self) -> None:
        known = get_args(ShadingModel)
        require("--model", self.model, self.model in known, " or ".join(known))
        for material in self.material.values() if isinstance(self.material, Mapping) else [self.material]:
            require_shadable(material, self.model)
        require("--views", self.views, 1 <= self.views <= 1000, "1 to 1000 photographs")
        require("--size", self.size, 8 <= self.size <= 8192, "8 to 8192 pixels")
        require("--spp", self.spp, self.spp >= 1, "at least 1 sample per pixel")
        require("--noise", self.noise, 0 <= self.noise < math.inf, "a finite number >= 0")
        require("--seed", self.seed, self.seed >= 0, "an integer >= 0")
        require("--fov", self.fov, 1 <= self.fov <= 120, "1 to 120 degrees")
        require("--max-depth", self.max_depth, self.max_depth >= 2, "at least 2: light, object, camera")


def synthesise(
    options: SynthOptions,
    out_dir: str | Path,
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> Path:
    """Photograph an object of known materials and write everything that a fit needs, and the truth beside it.

    The folder is self-contained: view_0.exr …, environment.exr, the mesh file, scene.toml, truth.json. All
    files appear together at the end; when anything goes wrong before, the folder keeps what it had.

    Args:
        options: what to photograph, and how.
        out_dir: where to; made if need be.
        progress: called with the current step and the fraction of all photographs done, in [0, 1].

    Returns:
        The path of scene.toml.

    Raises:
        InputError: mesh or map cannot be read, the folder not written, a file in it is not of an earlier call, or the
            materials are not those that the mesh names.
    """
    progress("environment", 0.0)
    if options.model == "mitsuba":
        options = replace(options, variant=variant_here(options.variant))
    environment = named_environment(options.env)
    shape = Sphere() if options.mesh is None else read_mesh(options.mesh)
    materials = _by_name(options, shape)
    photographer = _photographer(options, shape, environment, list(materials.values()))
    poses = views(options.views, shape, options.fov)
    out, mesh = Path(out_dir), copied_mesh(options.mesh, Path(out_dir))
    allowed = require_room_for_photographs(out, options.views, options.mesh, _inputs(options))
    with replaced_together(out, last=SCENE, replaceable=allowed, size=_size(options, environment)) as folder:
        write_exr(folder / MAP, environment.radiance.numpy())
        if mesh is not None:
            (folder / mesh.name).write_bytes(read_bytes(mesh))
        for index, pose in enumerate(poses):
            report = _share_of_all(progress, index, options.views)
            pixels = _photograph(photographer, options, pose.camera(options.size), index, report)
            write_exr(folder / view_name(index), pixels)
        (folder / SCENE).write_text(scene_toml(options.mesh, options.lights, poses), encoding="utf-8")
        truth = {**_truth(options, materials), **outputs_of(folder, out)}
        text = json.dumps(truth, indent=2, allow_nan=False, ensure_ascii=False)
        (folder / TRUTH).write_text(text + "\n", encoding="utf-8")
    return out / SCENE


def _inputs(options: SynthOptions) -> list[Path]:
    """The files that are read."""
    light = [] if options.env in MADE_HERE else [Path(options.env)]
    return [each for path in light for each in ([path, *path.iterdir()] if path.is_dir() else [path])] + (
        [] if options.mesh is None else [options.mesh]
    )


def _size(options: SynthOptions, environment: Environment) -> int:
    """Bytes of all pictures together, whose compression wins little: noise hardly gets smaller."""
    return 4 * (4 * options.views * options.size**2 + environment.radiance.numel())


def _share_of_all(progress: Callable[[str, float], None], index: int, count: int) -> Callable[[float], None]:
    """Turns the share of one photograph that is done into the share of all."""
    return lambda share: progress(f"photograph {index + 1} of {count}", (index + share) / count)


def named_environment(env: str, rotation: float = 0.0) -> Environment:
    """The environment of a command line's `--env`: one that is made here, or a file's.

    Args:
        env: "studio", "sunsky", or the path of a map or of a folder with six faces.
        rotation: degrees about +Y.

    Raises:
        InputError: as `read_environment`.
    """
    make = MADE_HERE.get(env)
    return read_environment(env, rotation) if make is None else replace(make(), rotation=rotation)


def _by_name(options: SynthOptions, shape: Shape) -> dict[str, TrueMaterial]:
    """The material behind each name that the shape has, in the shape's order."""
    names = shape.material_names if isinstance(shape, Mesh) else (UNNAMED,)
    if not isinstance(options.material, Mapping):
        return dict.fromkeys(names, options.material)
    given, listed = options.material, ", ".join(names)
    for name in given:
        require("--materials", name, name in names, f"a material that the mesh has: {listed}")
    for name in names:
        require("--materials", "", name in given, f"an entry for {name}, as for every material of the mesh: {listed}")
    return {name: given[name] for name in names}


def _photographer(
    options: SynthOptions, shape: Shape, environment: Environment, materials: Sequence[TrueMaterial]
) -> Photographer:
    """Who takes the photographs; `materials` are in the order of the shape's names."""
    if options.model == "viewer":
        from fit_material.renderer.synthesis.viewer_photographer import viewer_photographer

        return viewer_photographer(shape, environment, materials, options.lights)
    lights = [light_of(light) for light in options.lights]
    bsdfs = [bsdf_of(material) for material in _different(options, materials)]

    def photograph(camera: Camera, seed: int, progress: Progress) -> Float[np.ndarray, "h w 4"]:
        return render(
            shape,
            camera,
            environment,
            bsdfs,
            lights=lights,
            spp=options.spp,
            seed=seed,
            max_depth=options.max_depth,
            variant=options.variant,
            progress=progress,
        )

    return photograph


def _different(options: SynthOptions, materials: Sequence[TrueMaterial]) -> Sequence[TrueMaterial]:
    """One material where all of the shape is made of it, so that it stays in one piece."""
    return materials if isinstance(options.material, Mapping) else [options.material]


def _photograph(
    photographer: Photographer, options: SynthOptions, camera: Camera, index: int, progress: Progress
) -> Float[np.ndarray, "h w 4"]:
    """One photograph with its noise."""
    return noisy(photographer(camera, _seeds(options.seed, index)[0], progress), options, index)


def noisy(pixels: Float[np.ndarray, "h w 4"], options: SynthOptions, index: int) -> Float[np.ndarray, "h w 4"]:
    """A photograph that has none yet with the noise of the options; `index` is its place among all."""
    random = np.random.default_rng(_seeds(options.seed, index)[1])
    factor = 1 + options.noise * random.normal(size=(*pixels.shape[:2], 3))
    return np.concatenate([pixels[..., :3] * factor, pixels[..., 3:]], -1).astype(np.float32)


def _seeds(seed: int, index: int) -> tuple[int, int]:
    """Of the paths and of the noise of one photograph."""
    paths, noise = np.random.SeedSequence([seed, index]).generate_state(2).tolist()
    return paths, noise


def _truth(options: SynthOptions, materials: Mapping[str, TrueMaterial]) -> dict[str, Any]:
    """What the photographs show, to compare a fit with."""
    by_mitsuba = options.model == "mitsuba"
    mi = mitsuba(options.variant) if by_mitsuba else None
    held = {name: _held(mi, bsdf_of(material)) if by_mitsuba else None for name, material in materials.items()}
    first = next(iter(held.values()))
    return {
        "format": 1,
        "materials": [{**material_entry(name, material), "held": held[name]} for name, material in materials.items()],
        "model": options.model,
        "spp": options.spp if by_mitsuba else None,
        "noise": options.noise,
        "seed": options.seed,
        "max_depth": options.max_depth if by_mitsuba else None,
        "environment": unicode_text(options.env),
        "variant": options.variant if by_mitsuba else None,
        "mitsuba": mi.__version__ if mi else None,
        "spectra": {name: first[name] for name in ("eta", "k")} if first and "k" in first else None,
    }


def _held(mi: Any, bsdf: Bsdf) -> dict[str, list[float]]:
    """A material's numbers as Mitsuba holds them, in float32."""
    held = mi.traverse(mi.load_dict(bsdf))
    return {key.removesuffix(".value"): np.array(held[key]).ravel().tolist() for key in held.keys()}  # noqa: SIM118
