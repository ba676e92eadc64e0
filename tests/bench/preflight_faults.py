"""Faults put into scenes one at a time: what people get wrong about light, cameras, meshes and files."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
import torch
from jaxtyping import Float
from scipy import ndimage

from fit_material.renderer.cameras.camera import look_at
from fit_material.renderer.environment.environment_file import read_environment
from fit_material.renderer.environment.latlong import lookup, of
from fit_material.renderer.images.image_file import read_image, write_exr
from fit_material.renderer.scene.scene_file import camera_of, read_scene
from tests.support.srgb_curve import encoded

FILES = ("exr", "png", "background")
"""Clean photographs: linear floats with alpha; 8-bit sRGB with alpha; floats with their background and no mask."""


@dataclass
class Scene:
    """A scene in memory, to be changed and written.

    Attributes:
        table: of `scene.toml`.
        pixels: of each photograph, linear, premultiplied by alpha.
        light: the map.
        mesh: the lines of the OBJ file; none for the sphere.
        files: one of `FILES`.
        codes: of each photograph that is written as another function of its pixels, by its index.
    """

    table: dict[str, Any]
    pixels: list[Float[np.ndarray, "h w 4"]]
    light: Float[np.ndarray, "m n 3"]
    mesh: list[str]
    files: str
    written: dict[int, Callable[[Float[np.ndarray, "h w 4"], Path], Path]] = field(default_factory=dict)

    @staticmethod
    def read(folder: Path, files: str) -> Scene:
        table = tomllib.loads((folder / "scene.toml").read_text(encoding="utf-8"))
        images = [read_image(folder / each["image"]) for each in table["photographs"]]
        pixels = [np.concatenate([image.radiance, image.alpha[..., None]], -1) for image in images]  # type: ignore[index]
        light = read_image(folder / "environment.exr").radiance
        mesh = table["geometry"].get("mesh")
        lines = (folder / mesh).read_text(encoding="utf-8").splitlines() if mesh else []
        scene = Scene(table, pixels, light, lines, files)
        if files == "background":
            scene._add_background(folder)
        return scene

    def _add_background(self, folder: Path) -> None:
        environment = of(read_environment(folder / "environment.exr"))
        for photograph, pixels in zip(read_scene(folder / "scene.toml").photographs, self.pixels, strict=True):
            height, width = pixels.shape[:2]
            row, column = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
            _, towards = camera_of(photograph.camera, width, height).rays(column, row)
            behind = lookup(environment, *towards.unbind(-1)).numpy()
            pixels[..., :3] += (1 - pixels[..., 3:]) * behind

    def write(self, folder: Path) -> Path:
        """All files; the path of `scene.toml`."""
        folder.mkdir(parents=True)
        write_exr(folder / "environment.exr", self.light)
        if self.mesh:
            (folder / self.table["geometry"]["mesh"]).write_text("\n".join(self.mesh) + "\n", encoding="utf-8")
        for index, (photograph, pixels) in enumerate(zip(self.table["photographs"], self.pixels, strict=True)):
            path = folder / f"view_{index}"
            writer = self.written.get(index)
            if writer is not None:
                photograph["image"] = writer(pixels, path).name
            elif self.files == "png":
                photograph["image"] = write_png(pixels, path, _exposed(photograph, pixels, 0.01)).name
            else:
                photograph["image"] = _write_exr(pixels if self.files == "exr" else pixels[..., :3], path).name
        (folder / "scene.toml").write_text(_toml(self.table), encoding="utf-8")
        return folder / "scene.toml"


def _exposed(photograph: dict[str, Any], pixels: Float[np.ndarray, "h w 4"], clipped: float) -> float:
    """The factor by which such a share of the object is clipped, written down as the photograph's exposure."""
    inside = pixels[..., 3] > 0.999
    factor = float(1 / np.quantile(pixels[inside][:, :3].max(-1), 1 - clipped))
    photograph["exposure"] = photograph["exposure"] * factor
    return factor


def write_png(pixels: Float[np.ndarray, "h w 4"], path: Path, factor: float, bits: int = 8, coded: bool = True) -> Path:
    """Integers, by sRGB or linear; alpha is no curve's."""
    color = np.clip(factor * pixels[..., :3], 0, 1)
    color = encoded(color) if coded else color
    samples = np.concatenate([color, np.clip(pixels[..., 3:], 0, 1)], -1)
    path = path.with_suffix(".png")
    if bits == 8:
        iio.imwrite(path, np.rint(samples * 255).astype(np.uint8))
        return path
    import mitsuba as mi

    if mi.variant() is None:
        mi.set_variant("scalar_rgb")
    mi.Bitmap(np.rint(samples * 65535).astype(np.uint16)).write(str(path))
    return path


def _write_exr(pixels: Float[np.ndarray, "h w c"], path: Path) -> Path:
    path = path.with_suffix(".exr")
    write_exr(path, pixels.astype(np.float32))
    return path


def _toml(table: dict[str, Any]) -> str:
    """The few kinds of values that these scenes have; JSON's are TOML's."""
    lines = []
    for key in ("geometry", "environment"):
        lines += [f"[{key}]", *(f"{name} = {json.dumps(value)}" for name, value in table[key].items())]
    for photograph in table["photographs"]:
        lines += ["[[photographs]]", *(f"{k} = {json.dumps(v)}" for k, v in photograph.items() if k != "camera")]
        lines += ["[photographs.camera]", *(f"{k} = {json.dumps(v)}" for k, v in photograph["camera"].items())]
    return "\n".join(lines) + "\n"


Fault = Callable[[Scene, np.random.Generator], None]


def turn_environment(scene: Scene, random: np.random.Generator) -> None:
    scene.table["environment"]["rotation"] = float(random.choice((90, 180, 270)))


def mirror_environment(scene: Scene, random: np.random.Generator) -> None:
    scene.light = np.ascontiguousarray(scene.light[:, ::-1])
    scene.table["environment"]["rotation"] = float(random.choice((0, 90, 180, 270)))


def turn_world(scene: Scene, random: np.random.Generator) -> None:
    """Mesh and cameras z-up, as another program has them, and the map left y-up."""
    turn = _about_x(random.choice((90, -90)))
    _turn_mesh(scene, turn)
    _turn_cameras(scene, turn)


def turn_mesh(scene: Scene, random: np.random.Generator) -> None:
    """A mesh exported z-up; where it is a sphere, cameras exported so."""
    turn = _about_x(random.choice((90, -90)))
    _turn_mesh(scene, turn) if scene.mesh else _turn_cameras(scene, turn)


def _about_x(degrees: float) -> Float[np.ndarray, "3 3"]:
    sin, cos = np.sin(np.deg2rad(degrees)), np.cos(np.deg2rad(degrees))
    return np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]])


def _turn_mesh(scene: Scene, turn: Float[np.ndarray, "3 3"]) -> None:
    for index, line in enumerate(scene.mesh):
        key, *values = line.split()
        if key in ("v", "vn"):
            scene.mesh[index] = " ".join([key, *(f"{value:.7g}" for value in turn @ np.array(values, float))])


def _turn_cameras(scene: Scene, turn: Float[np.ndarray, "3 3"]) -> None:
    for photograph in scene.table["photographs"]:
        camera = photograph["camera"]
        camera.update({key: (turn @ np.array(camera[key])).tolist() for key in ("origin", "target", "up")})


def displace(scene: Scene, random: np.random.Generator) -> None:
    """One camera looks beside, or all lenses are said to be wider or longer than they are."""
    cameras = [photograph["camera"] for photograph in scene.table["photographs"]]
    if random.random() < 0.5:
        factor = random.uniform(1.1, 1.2) ** random.choice((-1, 1))
        for camera in cameras:
            camera["fov"] *= factor
        return
    camera = cameras[random.integers(len(cameras))]
    pose = look_at(*(torch.tensor(camera[key]) for key in ("origin", "target", "up"))).numpy()
    distance = np.linalg.norm(np.array(camera["origin"]) - camera["target"])
    aside = random.uniform(0.06, 0.1) * distance * np.tan(np.deg2rad(camera["fov"] / 2)) * 2
    angle = random.uniform(0, 2 * np.pi)
    camera["target"] = (camera["target"] + aside * (pose[:3, :2] @ (np.cos(angle), np.sin(angle)))).tolist()


def misdeclare(scene: Scene, random: np.random.Generator) -> None:
    """Pictures for the screen declared linear, or linear ones taken for such."""
    shown = random.random() < 0.5
    for index, (photograph, pixels) in enumerate(zip(scene.table["photographs"], scene.pixels, strict=True)):
        factor = _exposed(photograph, pixels, 0.01)
        if scene.files == "background":
            pixels[..., 3] = 1
        bits, coded = (8, True) if shown else (16, False)
        photograph["encoding"] = "linear" if shown else "srgb"
        scene.written[index] = lambda p, path, f=factor, b=bits, c=coded: write_png(p, path, f, b, c)


def misexpose(scene: Scene, random: np.random.Generator) -> None:
    """One photograph's exposure is wrong by half a stop to two."""
    photographs = scene.table["photographs"]
    photographs[random.integers(len(photographs))]["exposure"] *= 2 ** (random.uniform(0.5, 2) * random.choice((-1, 1)))


def clip(scene: Scene, random: np.random.Generator) -> None:
    """An eighth to a third of the object is clipped, in 8 bits or in floats that do not say so."""
    share = random.uniform(0.12, 0.35)
    for index, (photograph, pixels) in enumerate(zip(scene.table["photographs"], scene.pixels, strict=True)):
        if scene.files == "png":
            factor = _exposed(photograph, pixels, share)
            scene.written[index] = lambda p, path, f=factor: write_png(p, path, f)
        else:
            top = np.quantile(pixels[pixels[..., 3] > 0.999][:, :3].max(-1), 1 - share)
            pixels[..., :3] = np.minimum(pixels[..., :3], top)


def blur(scene: Scene, random: np.random.Generator) -> None:
    """One photograph out of focus, by 2 to 4 % of its width."""
    pixels = scene.pixels[random.integers(len(scene.pixels))]
    sigma = random.uniform(0.02, 0.04) * pixels.shape[1]
    grain = pixels[..., :3] - ndimage.gaussian_filter(pixels[..., :3], (0.7, 0.7, 0))
    blurred = ndimage.gaussian_filter(pixels[..., :3], (sigma, sigma, 0))
    noise = np.median(np.abs(grain)) / max(float(np.median(pixels[..., :3])), 1e-9)
    pixels[..., :3] = blurred * (1 + min(noise, 0.01) * random.normal(size=blurred.shape))


def duplicate(scene: Scene, random: np.random.Generator) -> None:
    """The same file under two cameras, or saved once more."""
    scene.pixels[1] = scene.pixels[0].copy()
    scene.table["photographs"][1]["exposure"] = scene.table["photographs"][0]["exposure"]
    if scene.files == "exr" and random.random() < 0.5:
        factor = _exposed(scene.table["photographs"][1], scene.pixels[1], 0.001)
        scene.written[1] = lambda p, path: write_png(p, path, factor)


FAULTS: dict[str, tuple[Fault, str]] = {
    "mesh or cameras z-up": (turn_mesh, "up-axis"),
    "environment against all else z-up": (turn_world, "up-axis"),
    "environment turned": (turn_environment, "environment-rotation"),
    "environment mirrored": (mirror_environment, "environment-mirrored"),
    "silhouette displaced": (displace, "silhouette"),
    "encoding misdeclared": (misdeclare, "encoding"),
    "exposure wrong": (misexpose, "exposure"),
    "clipped": (clip, "clipping"),
    "blurred": (blur, "sharpness"),
    "duplicate": (duplicate, "duplicate"),
}
"""What does it, and the kind of finding that has to be among those that are told."""
