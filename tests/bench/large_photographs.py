"""Photographs of any size for measuring time and memory: a small picture by our own model, enlarged; kept outside."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float
from PIL import Image as PillowImage

from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.options.fidelity import preset
from fit_material.renderer.files.atomic import replaced_together, write_text_atomically
from fit_material.renderer.geometry.mesh import Sphere
from fit_material.renderer.images.image_file import write_exr
from fit_material.renderer.materials.catalogue import metal
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.renderer.rays.picture import draw
from fit_material.renderer.scene.scene_file import CameraSpec, camera_of
from fit_material.renderer.synthesis.camera_placement import View, views
from fit_material.renderer.synthesis.studio import studio
from fit_material.shaders.materials.types import Metal
from fit_material.shaders.materials.widths import Microfacet
from tests.bench.setting import CACHE
from tests.support.srgb_curve import encoded

DIFFERENT = 5  # photographs that are made; scenes of more take these again
APART = 1e-6  # relative difference of one's exposure to the next one's
TRACED_WIDTH = 400
MADE_UNDER = 256  # width of the studio's map
ALPHA, NOISE, SAMPLES = 0.2, 0.01, 256
CLIPPED = 99.5  # percentile that becomes white


@dataclass(frozen=True)
class Series:
    """Photographs of a gold ball, 8-bit JPEG with a mask each, and their scene.

    Attributes:
        count: how many.
        width: of each; the height is three quarters of it.
        environment: width of the map that the scene names.
    """

    count: int
    width: int
    environment: int = 1024

    def scene(self) -> Path:
        """The scene file; what it names is made where it is not kept from an earlier run."""
        folder = CACHE / f"scaling-{self.width}"
        path = folder / f"scene-{self.count}-{self.environment}.toml"
        poses = views(DIFFERENT, Sphere())
        if not (folder / f"view_{DIFFERENT - 1}.jpg").exists():
            _photographs(folder, self.width, poses)
        light = folder / f"studio-{self.environment}.exr"
        if not light.exists():
            write_exr(light, studio(self.environment).radiance.numpy())
        exposure, tables = _exposure(folder), []
        for index in range(self.count):  # of one exposure they would be the same photograph once more, and left out
            which = index % DIFFERENT
            tables.append(_table(which, poses[which], exposure * (1 + APART * index)))
        head = f'[geometry]\nshape = "sphere"\n[environment]\nmap = "{light.name}"\n'
        write_text_atomically(path, "\n".join([head, *tables]))
        return path


def _table(index: int, pose: View, exposure: float) -> str:
    files = f'image = "view_{index}.jpg"\nmask = "mask_{index}.png"\nexposure = {exposure}'
    places = "\n".join(f"{key} = {list(getattr(pose, key))}" for key in ("origin", "target", "up"))
    return f"[[photographs]]\n{files}\n[photographs.camera]\n{places}\nfov = {_spec(pose).fov}\n"


def _spec(pose: View) -> CameraSpec:
    """The camera of a picture of 4 : 3 that is as high as the view's square one."""
    fov = 2 * math.degrees(math.atan(4 / 3 * math.tan(math.radians(pose.fov) / 2)))
    return CameraSpec(origin=pose.origin, target=pose.target, up=pose.up, fov=fov)


def _photographs(folder: Path, width: int, poses: list[View]) -> None:
    """All files, whole or not at all."""
    drawn = [_traced(pose) for pose in poses]
    white = float(np.percentile(np.concatenate([radiance[mask] for radiance, mask in drawn]), CLIPPED))
    random = np.random.default_rng(0)
    with replaced_together(folder, last="exposure.txt") as made:
        for index, (radiance, mask) in enumerate(drawn):
            shown = _enlarged(radiance / white, width) * (
                1 + NOISE * random.standard_normal((width * 3 // 4, width, 1))
            )
            PillowImage.fromarray(_codes(shown)).save(made / f"view_{index}.jpg", quality=95)
            whole = _enlarged(mask[..., None].repeat(3, 2).astype(np.float32), width)[..., 0] > 1 - 1e-6
            PillowImage.fromarray(np.where(whole, 255, 0).astype(np.uint8)).save(made / f"mask_{index}.png")
        (made / "exposure.txt").write_text(f"{1 / white}")


def _exposure(folder: Path) -> float:
    return float((folder / "exposure.txt").read_text())


def _traced(pose: View) -> tuple[Float[np.ndarray, "h w 3"], Bool[np.ndarray, "h w"]]:
    camera = camera_of(_spec(pose), TRACED_WIDTH, TRACED_WIDTH * 3 // 4)
    known, lighting = metal("Au"), Lighting(studio(MADE_UNDER), (), preset("standard"))
    n, k = (torch.tensor(each, dtype=torch.float64) for each in (known.n, known.k))
    gold = Metal(n, k, Microfacet(torch.tensor(ALPHA, dtype=torch.float64)))

    def shade(surface: GBuffer) -> torch.Tensor:
        return lighting.radiance(gold, surface, SAMPLES)

    everything = torch.ones(camera.height, camera.width, dtype=torch.bool)
    picture = draw(gbuffer.tracer(Sphere()), camera, everything, 1, 1, shade)
    return picture.radiance.numpy(), picture.mask.numpy()


def _enlarged(picture: Float[np.ndarray, "h w 3"], width: int) -> Float[np.ndarray, "H W 3"]:
    planes = torch.from_numpy(np.ascontiguousarray(picture)).permute(2, 0, 1)[None].float()
    size = (width * 3 // 4, width)
    return torch.nn.functional.interpolate(planes, size, mode="bilinear")[0].permute(1, 2, 0).numpy()


def _codes(linear: Float[np.ndarray, "h w 3"]) -> np.ndarray:
    """IEC 61966-2-1 in 8 bits."""
    return np.round(255 * encoded(np.clip(linear, 0, 1))).astype(np.uint8)
