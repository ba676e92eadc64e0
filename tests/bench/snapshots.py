"""What a camera makes of a rendered photograph: noise, an end of the range, a curve, eight bits, JPEG."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import torch
from jaxtyping import Float

from fit_material.renderer.environment.environment_file import read_environment
from fit_material.renderer.images.image_file import read_image
from fit_material.renderer.mitsuba.conversion import envmap, mitsuba, sensor
from fit_material.renderer.scene.scene_file import camera_of, read_scene
from fit_material.shaders.tone_mapping import srgb

SHOT = 0.01  # noise over signal where a pixel is full, as of 10⁴ electrons
READ = 0.0005  # of what fills a pixel
CLIPPED = 0.02  # of the object's pixels
JPEG_QUALITY = 85
WRONG = 1.4  # factor of exposures that are all wrong alike
COVERED = 0.999  # alpha from which a pixel shows the object alone


@dataclass(frozen=True)
class Snapshot:
    """How photographs are taken, and what the scene file says of it.

    Attributes:
        title: in a table.
        stops: exposures of one view, as factors on the one that clips `CLIPPED` of the object.
        jpeg: in the place of PNG.
        exposure: as the scene file has it: "known", "fit", or "common" for one that is fitted for all photographs.
        gains: of red, green and blue, by another white than the light's.
        white_balance: as the scene file has it: None, "fit", or "common".
        background: whether the surroundings are seen behind the object; else black.
        uneven: factor from one photograph's exposure to the next one's.
    """

    title: str
    stops: tuple[float, ...] = (1.0,)
    jpeg: bool = False
    exposure: str = "known"
    gains: tuple[float, float, float] = (1.0, 1.0, 1.0)
    white_balance: str | None = None
    background: bool = False
    uneven: float = 1.0


def taken(snapshot: Snapshot, scene: Path, out: Path, seed: int, variant: str) -> Path:
    """The scene file of rendered photographs as a camera takes them; renders are linear and without surroundings.

    Args:
        scene: of `synth`'s photographs.
        out: folder for the files.
        seed: of the noise.
    """
    tables = tomllib.loads(scene.read_text("utf-8"))
    views = [read_image(scene.with_name(each["image"])) for each in tables["photographs"]]
    inside = np.stack([view.alpha >= COVERED for view in views])  # type: ignore[operator] — synth's have it
    seen = np.stack([view.radiance for view in views])
    if snapshot.background:
        behind = surroundings_of(scene, variant)
        seen = seen + (1 - np.stack([view.alpha for view in views]))[..., None] * behind  # type: ignore[operator]
    seen = seen * np.array(snapshot.gains)
    full = float(np.quantile(seen.max(-1)[inside], 1 - CLIPPED))
    random = np.random.default_rng(seed)
    photographs = []
    for index, (view, spec) in enumerate(zip(seen, tables["photographs"], strict=True)):
        exposures = [stop / full * snapshot.uneven**-index for stop in snapshot.stops]
        names = [f"view_{index}_{i}.{'jpg' if snapshot.jpeg else 'png'}" for i in range(len(exposures))]
        for name, exposure in zip(names, exposures, strict=True):
            _write(out / name, developed(view * exposure, random), snapshot.jpeg)
        iio.imwrite(out / f"mask_{index}.png", np.uint8(255) * inside[index])
        photographs.append(_table(snapshot, index, names, exposures, spec["camera"]))
    head = _head(snapshot, scene.with_name(tables["environment"]["map"]))
    (out / "scene.toml").write_text(head + "".join(photographs), encoding="utf-8")
    return out / "scene.toml"


def developed(pixels: Float[np.ndarray, "h w 3"], random: np.random.Generator) -> np.ndarray:
    """8-bit sRGB of a sensor's signal, 1 where it is full: shot and read noise, clipped, rounded."""
    deviation = np.sqrt(SHOT**2 * pixels.clip(0) + READ**2)
    signal = pixels + deviation * random.normal(size=pixels.shape)
    return np.rint(255 * srgb(torch.from_numpy(signal.clip(0, 1))).numpy()).astype(np.uint8)


def surroundings_of(scene: Path, variant: str) -> Float[np.ndarray, "v h w 3"]:
    """What the cameras see of the environment alone, by Mitsuba."""
    mi = mitsuba(variant)
    read = read_scene(scene)
    light = envmap(read_environment(read.environment.map))
    found = []
    for spec in read.photographs:
        height, width = read_image(spec.image).radiance.shape[:2]
        view = {"type": "scene", "integrator": {"type": "path"}, "light": light}
        loaded = mi.load_dict({**view, "sensor": sensor(camera_of(spec.camera, width, height))})
        found.append(np.array(mi.render(loaded, spp=64, seed=0))[..., :3])
    return np.stack(found)


def _write(path: Path, codes: np.ndarray, jpeg: bool) -> None:
    options = {"quality": JPEG_QUALITY, "subsampling": "4:2:0"} if jpeg else {}
    iio.imwrite(path, codes, **options)


def _head(snapshot: Snapshot, environment: Path) -> str:
    common = 'exposure = "fit"\n' if snapshot.exposure == "common" else ""
    common += 'white_balance = "fit"\n' if snapshot.white_balance == "common" else ""
    return f'{common}[geometry]\nshape = "sphere"\n[environment]\nmap = "{environment}"\n'


def _table(
    snapshot: Snapshot, index: int, names: Sequence[str], exposures: Sequence[float], camera: dict[str, object]
) -> str:
    several = len(names) > 1
    image = f"images = {list(names)}" if several else f'image = "{names[0]}"'
    known = list(exposures) if several else exposures[0]
    if snapshot.exposure == "common":
        known = [each * WRONG for each in exposures] if several else exposures[0] * WRONG
    said = '"fit"' if snapshot.exposure == "fit" else known
    balance = 'white_balance = "fit"\n' if snapshot.white_balance == "fit" else ""
    numbers = "\n".join(f"{key} = {value}" for key, value in camera.items())
    return (
        f'[[photographs]]\n{image}\nmask = "mask_{index}.png"\nexposure = {said}\n{balance}'
        f"[photographs.camera]\n{numbers}\n"
    )
