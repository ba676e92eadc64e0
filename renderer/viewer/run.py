"""What `fit-material view` does: reads, checks, and draws into a window or into files."""

from __future__ import annotations

import dataclasses
import math
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import torch

from fit_material.renderer.cameras.camera import Camera, look_at
from fit_material.renderer.environment.environment_file import read_environment
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.errors.printable import printable
from fit_material.renderer.files.atomic import write_bytes_atomically
from fit_material.renderer.files.replaceable import Replaceable
from fit_material.renderer.images.image_file import png, write_exr
from fit_material.renderer.materials.ground_truth import require
from fit_material.renderer.opengl.drawing import Stage
from fit_material.renderer.opengl.geometry import bounds
from fit_material.renderer.opengl.offscreen import picture
from fit_material.renderer.scene.fittable_values import LARGEST
from fit_material.renderer.scene.input_paths import input_paths
from fit_material.renderer.scene.lights import LightSpec, light_option
from fit_material.renderer.scene.scene_file import read_scene
from fit_material.renderer.synthesis.synthesise import MADE_HERE, named_environment
from fit_material.renderer.viewer.compare import Photographs
from fit_material.renderer.viewer.display import Codes, Display, draw_whole
from fit_material.renderer.viewer.eye import Eye, eye_of, frame
from fit_material.renderer.viewer.look import Look
from fit_material.renderer.viewer_model.model import Model, read_model
from fit_material.renderer.viewer_model.viewer_light import Surroundings, surroundings
from fit_material.shaders.materials.kinds import type_codes

if TYPE_CHECKING:
    import moderngl

Numbers = tuple[float, float, float]

LARGEST_SIDE = 16384
MOST_STOPS = 60.0
_YAW, _PITCH = math.radians(25), math.radians(-15)  # from where a model is seen first: the side, a little above


@dataclass(frozen=True)
class ViewOptions:
    """The arguments of the command, under its names for them.

    Raises:
        InputError: a number is out of its range; names the option.
    """

    model: Path
    env: str | None
    mtl: Path | None
    screenshot: Path | None
    turntable: Path | None
    frames: int
    size: tuple[int, int]
    origin: Numbers | None
    target: Numbers | None
    up: Numbers
    fov: float
    exposure: float
    curve: str
    rotation: float
    sky: bool
    neighbours: bool
    antialias: int
    ambient: Numbers | None
    light: tuple[float, ...] | None
    codes: str
    dialect: Literal["auto", "thesis", "ordinary"]
    photograph: Path | None
    view: int
    compare: Literal["beside", "swipe", "difference"]
    outside: bool = False

    def __post_init__(self) -> None:
        width, height = self.size
        sides = f"1 to {LARGEST_SIDE} pixels along each side"
        require("--size", f"{width} {height}", min(self.size) >= 1 and max(self.size) <= LARGEST_SIDE, sides)
        require("--fov", self.fov, 0.01 <= self.fov <= 179, "0.01 to 179 degrees")
        require("--exposure", self.exposure, abs(self.exposure) <= MOST_STOPS, f"at most {MOST_STOPS:g} stops")
        require("--rotation", self.rotation, abs(self.rotation) <= 1e6, "an angle in degrees")
        require("--antialias", self.antialias, 1 <= self.antialias <= 16, "1 to 16 samples along a pixel's side")
        for option, point in (("--origin", self.origin), ("--target", self.target), ("--up", self.up)):
            finite = point is None or all(map(math.isfinite, point))
            require(option, _spaced(point), finite, "three finite numbers")
        dark = self.ambient is None or all(0 <= value <= LARGEST for value in self.ambient)
        require("--ambient", _spaced(self.ambient), dark, f"three numbers from 0 to {LARGEST:g}")
        require("--target", _spaced(self.target), self.target is None or self.origin is not None, "--origin beside it")
        require(
            "--screenshot", self.screenshot, _ending(self.screenshot) in ("", ".png", ".exr"), "a .png or .exr file"
        )
        linear = self.photograph is not None and _ending(self.screenshot) == ".exr"
        require("--screenshot", self.screenshot, not linear, "a .png beside --photograph: comparisons are tone-mapped")


def show(options: ViewOptions) -> Iterator[Path]:
    """Open the window; or write the files of the options, and print where.

    Raises:
        InputError: a file cannot be read or written, or there is no OpenGL.
    """
    light = _surroundings(options)
    photographs = None if options.photograph is None else Photographs(options.photograph)
    if photographs is not None:
        photographs[options.view - 1]  # a missing one is refused before anything is drawn
    if options.screenshot is None and options.turntable is None:
        _open_window(options, light, photographs)
        return
    model = _read(options)
    if options.screenshot is not None:
        shot = options.screenshot
        _replaceable(options, model).require(shot.parent, [shot.name], "--screenshot")
    for remark in model.remarks:
        print(printable(remark), file=sys.stderr)
    yield from _written(options, model, light, photographs)


def codes_of(text: str) -> Mapping[str, int]:
    """The table in `matte=0,glossy=1,metal=2`; a type that is left out keeps its code.

    Raises:
        InputError: anything else is written there, or two types share a code.
    """
    entries = [re.fullmatch(r"\s*(matte|glossy|metal)\s*=\s*(-?\d{1,9})\s*", entry) for entry in text.split(",")]
    given = {entry[1]: int(entry[2]) for entry in entries if entry}
    table = {**type_codes(), **given}
    fulfilled = all(entries) and len(given) == len(entries) and len({*table.values()}) == len(table)
    require("--codes", text, fulfilled, "one whole number for each type, as in matte=0,glossy=4,metal=8")
    return table


def first_look(options: ViewOptions, model: Model, comparison: bool) -> Look:
    """The look of the options.

    Raises:
        InputError: origin, target and up do not make a camera.
    """
    return Look(
        eye=_eye(options, model),
        exposure=options.exposure,
        curve=options.curve,
        sky=options.sky,
        comparison=options.compare if comparison else "off",
        photograph=options.view - 1,
    )


def _eye(options: ViewOptions, model: Model) -> Eye:
    within = bounds(model.mesh.vertices[np.unique(model.mesh.faces)])
    x, y, z = within.centre.tolist()
    if options.origin is None:
        width, height = options.size
        return frame(Eye((x, y, z), 1.0, _YAW, _PITCH, fov=options.fov), within, width / height)
    target = options.target or (x, y, z)
    origin, towards, up = (torch.tensor(v, dtype=torch.float64) for v in (options.origin, target, options.up))
    try:
        pose = look_at(origin, towards, up)
    except ValueError:
        expected = "a point apart from --target, and not straight along --up from it"
        raise InputError("--origin", value=_spaced(options.origin), expected=expected) from None
    return eye_of(Camera(pose, *options.size, fov=options.fov), target)


def _open_window(options: ViewOptions, light: Surroundings, photographs: Photographs | None) -> None:
    from fit_material.renderer.viewer.session import Subject
    from fit_material.renderer.viewer.window import run

    model = _read(options)
    look, once_read = first_look(options, model, comparison=photographs is not None), [model]
    subject = Subject(
        lambda: once_read.pop() if once_read else _read(options),
        light,
        look,
        photographs=photographs,
        antialias=options.antialias,
        neighbours=options.neighbours,
    )
    run(subject, options.size)


def _written(
    options: ViewOptions, model: Model, light: Surroundings, photographs: Photographs | None
) -> Iterator[Path]:
    """The files of the options, one after another."""
    from fit_material.renderer.opengl.context import offscreen_context

    look = first_look(options, model, comparison=photographs is not None)
    context = offscreen_context()
    stage = Stage(context, model, light, neighbours=options.neighbours, exact=True)
    drawing = _Drawing(options, model, context, stage, Display(context, options.antialias), photographs)
    if options.screenshot is not None:
        drawing.write_screenshot(options.screenshot, look)
        yield options.screenshot
    if options.turntable is not None:
        drawing.write_turntable(options.turntable, look)
        yield options.turntable


@dataclass(frozen=True)
class _Drawing:
    """A stage that is drawn into files."""

    options: ViewOptions
    model: Model
    context: moderngl.Context
    stage: Stage
    display: Display
    photographs: Photographs | None

    def write_screenshot(self, path: Path, look: Look) -> None:
        if _ending(path) == ".png":
            write_bytes_atomically(path, png(self._codes(look)))
            return
        options = self.options
        camera = look.eye.camera(*options.size)
        linear = picture(self.context, self.stage, camera, sky=options.sky, antialias=options.antialias)
        write_exr(path, linear[..., :3] if options.sky else linear)

    def write_turntable(self, folder: Path, look: Look) -> None:
        from fit_material.renderer.viewer.turntable import turntable

        alone = dataclasses.replace(look, comparison="off")
        frames = turntable(
            folder,
            look.eye,
            self.options.frames,
            lambda eye: self._codes(dataclasses.replace(alone, eye=eye)),
            _replaceable(self.options, self.model),
        )
        for _ in frames:
            pass

    def _codes(self, look: Look) -> Codes:
        photograph = None if self.photographs is None else self.photographs[look.photograph]
        return draw_whole(self.context, self.display, self.options.size, self.stage, look, photograph)


def _read(options: ViewOptions) -> Model:
    return read_model(options.model, options.mtl, codes_of(options.codes), options.dialect, outside=options.outside)


def _surroundings(options: ViewOptions) -> Surroundings:
    """The light that the options name; beside photographs that of their scene by default."""
    lights: Sequence[LightSpec] = () if options.light is None else (light_option(options.light),)
    if options.env is not None or options.photograph is None:
        return surroundings(named_environment(options.env or "studio", options.rotation), lights, options.ambient)
    scene = read_scene(options.photograph)
    spec = scene.environment
    rotation, scale = spec.start
    environment = read_environment(spec.map, rotation + options.rotation, scale)
    return surroundings(environment, lights or scene.lights, options.ambient)


def _replaceable(options: ViewOptions, model: Model) -> Replaceable:
    """All but the files that are read."""
    light = [] if options.env is None or options.env in MADE_HERE else [Path(options.env)]
    faces = [face for path in light if path.is_dir() for face in path.iterdir()]
    scene = [] if options.photograph is None else input_paths(read_scene(options.photograph), options.photograph)
    return Replaceable((*model.files, *light, *faces, *scene))


def _ending(path: Path | None) -> str:
    return "" if path is None else path.suffix.lower() or "missing"


def _spaced(point: Numbers | None) -> str:
    return "" if point is None else " ".join(f"{value:g}" for value in point)
