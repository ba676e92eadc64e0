"""Good files to begin with: small ones of our own, and those of other readers' tests where they are."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

import numpy as np

from fit_material.fitter.result.schema import (
    Determined,
    Effect,
    FittedMaterial,
    InputFile,
    Intervals,
    Maps,
    Model,
    Nearest,
    PhotographQuality,
    PictureQuality,
    Quality,
    Result,
    StandardErrors,
    Time,
    write_result,
)
from fit_material.renderer.images.image_file import write_exr
from tests.support.paths import SHARED

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


SENSORS = b"""<?xml version="1.0" encoding="utf-8"?>
<scene version="3.0.0">
  <default name="size" value="64"/> <default name="wide" value="$size"/>
  <integrator type="path"/>
  <sensor type="perspective" id="first">
    <float name="fov" value="50"/> <string name="fov_axis" value="smaller"/> <float name="near_clip" value="0.1"/>
    <float name="principal_point_offset_x" value="0.1"/>
    <transform name="to_world">
      <scale value="1"/> <rotate y="1" angle="30"/> <translate x="1" z="-3"/>
      <lookat origin="1, 2, 4" target="0.2, -0.3, 0.1" up="0.1, 1, -0.2"/>
      <matrix value="1 0 0 5, 0 1 0 6, 0 0 1 7, 0 0 0 1"/>
    </transform>
    <film type="hdrfilm">
      <integer name="width" value="$wide"/> <integer name="height" value="40"/> <rfilter type="gaussian"/>
    </film>
    <sampler type="independent"><integer name="sample_count" value="16"/></sampler>
  </sensor>
  <!-- another -->
  <sensor type="orthographic">
    <transform name="to_world"><scale x="1.3" y="1.3"/><lookat origin="1 2 4" target="0 0 0"/></transform>
  </sensor>
  <sensor type="thinlens"><string name="focal_length" value="35mm"/></sensor>
  <shape type="sphere"/>
</scene>
"""
LIST = b"""\xef\xbb\xbf# of two folders
a/scene.toml --type metal --seed 3  # with options
deep
'a/scene.toml' "--fidelity" preview
**/scene.toml
[ad]*/*/
"""


def seeds(kind: str) -> list[bytes]:
    """Whole files of a kind: scene, transforms, obj, mtl, sensors, list, result, exr, hdr, npy, png."""
    own = {"scene": [SCENE, PLAIN_SCENE], "transforms": [TRANSFORMS], "obj": [OBJ], "mtl": [MTL]}
    own |= {"sensors": [SENSORS], "list": [LIST]}
    if kind == "result":
        return [_result()]
    if kind in own:
        return [*own[kind], *_corpus(kind)]
    return _images(kind)


def _result() -> bytes:
    """A `result.json` of a metal, a glossy material with maps and a matte one."""
    color, half = (0.5, 0.4, 0.3), (0.04, 0.04, 0.04)
    width = {"alpha": 0.2, "roughness": 0.55}
    wide = ((0.1, 0.2), (0.3, 0.4), None)
    metal = FittedMaterial(
        name="lid",
        type="metal",
        **{"n": color, "k": (3.5, 2.3, 1.9), "f0": color, **width},
        stderr=StandardErrors(n=(0.02, 0.04, None), alpha=0.001),
        interval95=Intervals(n=wide),
        determined=Determined(n=(True, True, False), alpha=True),
        nearest=(Nearest(name="Au", distance=0.8),),
    )
    maps = Maps(color="inside.png", color_seen="inside.png")
    glaze = FittedMaterial(name="glaze", type="glossy", color=color, reflectance=half, f0=half, maps=maps, **width)
    clay = FittedMaterial(name="clay", type="matte", color=color, reflectance=color)
    picture = {"rms_relative": 0.02, "psnr": 41.0, "ssim": None}
    found = Result(
        status="converged",
        message="nine steps",
        materials=(metal, glaze, clay),
        quality=Quality(
            overall=PictureQuality(**picture), photographs=(PhotographQuality(name="view.exr", **picture),)
        ),
        exposure=(1.0,),
        model=Model(
            fidelity="standard", reflectance="conductor", lobe="ggx", samples=512, pixels=4000, dtype="float32"
        ),
        effects=(Effect(name="reflection", on=True, why="a metal"),),
        time=Time(load=1, prepare=7, solve=0.4, report=1, total=10),
        inputs=(InputFile(path="scene.toml", sha256="0" * 64),),
    )
    with tempfile.TemporaryDirectory() as folder:
        write_result(found, Path(folder) / "result.json")
        return (Path(folder) / "result.json").read_bytes()


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
