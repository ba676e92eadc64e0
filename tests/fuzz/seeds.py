"""Good files to begin with: small ones of our own, and those of other readers' tests where they are."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

import numpy as np

from renderer.images import write_exr
from tests.bench.setting import SHARED

LARGEST = 20_000  # bytes of a seed

SCENE = b"""
cameras = "transforms.json"
[geometry]
mesh = "ball.obj"
smooth = true
[environment]
map = "map.exr"
rotation = 90.0
scale = 1.5
[[lights]]
type = "directional"
direction = [0.3, 0.8, 0.5]
irradiance = [3.0, 3.0, 2.8]
[[photographs]]
image = "view.exr"
mask = "view.exr"
encoding = "gamma:2.2"
exposure = 1.0
[[materials]]
name = "lid"
type = "metal"
"""
PLAIN_SCENE = b"""
[geometry]
shape = "sphere"
[environment]
map = "map.exr"
[[photographs]]
image = "view.exr"
[photographs.camera]
origin = [0, 0, 4]
target = [0, 0, 0]
up = [0, 1, 0]
fov = 35.0
[[photographs]]
image = "view.exr"
exposure = "fit"
[photographs.camera]
matrix = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]
projection = "orthographic"
scale = 1.2
"""
TRANSFORMS = json.dumps(
    {
        "camera_angle_x": 0.6,
        "frames": [
            {"file_path": "view", "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]},
            {
                "file_path": "./view.exr",
                "fl_x": 50.0,
                "w": 4,
                "h": 4,
                "cx": 2.0,
                "transform_matrix": np.eye(4).tolist(),
            },
        ],
    },
    indent=1,
).encode()
OBJ = b"""mtllib ball.mtl
o ball
v 0 0 0
v 1 0 0
v 0 1 0
v 0 0 1
vt 0 0
vt 1 0
vn 0 0 1
usemtl lid
s 1
f 1/1/1 2/2/1 3/1/1
f -4 -3 -2 -1
g foot
f 1//1 2//1 4//1
"""
MTL = b"""newmtl lid
Ns 2
Kd 0.15 0.43 1.4
Ka 3.5 2.3 1.9
Ks 0.25 0.25 0.25
map_Ka -bm 1.0 inside.png
newmtl foot
Ns 96.1
Kd 0.5 0.5 0.5
Ks 0.04
Ni 1.5
illum 2
Pr 0.3
map_Kd ../secret.png
bump -s 1 1 1 ../secret.png
"""


def seeds(kind: str) -> list[bytes]:
    """Whole files of a kind: scene, transforms, obj, mtl, exr, hdr, npy, png."""
    own = {"scene": [SCENE, PLAIN_SCENE], "transforms": [TRANSFORMS], "obj": [OBJ], "mtl": [MTL]}
    if kind in own:
        return [*own[kind], *_corpus(kind)]
    return _images(kind)


def _corpus(kind: str) -> list[bytes]:
    files = sorted((SHARED / "objmtl").rglob(f"*.{kind}")) if SHARED.is_dir() else []
    return [file.read_bytes() for file in files if file.stat().st_size <= LARGEST]


def _images(kind: str) -> list[bytes]:
    """Pictures of 4 × 8 pixels in the ways that a format has."""
    picture = np.random.default_rng(1).random((4, 8, 3), np.float32)
    with tempfile.TemporaryDirectory() as folder:
        return [file.read_bytes() for file in _written(kind, picture, Path(folder))]


def _written(kind: str, picture: np.ndarray, folder: Path) -> list[Path]:
    files = [folder / f"{number}.{kind}" for number in range(3)]
    if kind == "exr":
        import OpenEXR

        write_exr(files[0], picture)
        write_exr(files[1], np.concatenate([picture, picture[..., :1]], -1))
        half = {"compression": OpenEXR.PIZ_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(half, {"RGB": picture.astype(np.float16)}).write(str(files[2]))
        return files
    if kind == "hdr":
        import mitsuba as mi

        mi.set_variant("scalar_rgb")
        mi.Bitmap(picture).write(str(files[0]))
        return files[:1]
    if kind == "npy":
        np.save(files[0], picture)
        return files[:1]
    from imageio.v3 import imwrite

    imwrite(files[0], (255 * picture).astype(np.uint8))
    imwrite(files[1], (65535 * picture[..., 0]).astype(np.uint16))
    return files[:2]
