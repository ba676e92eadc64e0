"""Camera raw files, developed without any tone curve: what the sensor counted, as linear Rec. 709."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.images.exif import upright
from fit_material.renderer.images.image_header import Size

ENDINGS = (".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".orf", ".rw2", ".pef")

FULL = 0.99  # of the way from black to white level, where sensors may be full

DEVELOPED = 2 + 8 + 6 + 24  # bytes: of a photosite, of LibRaw's four channels and three, and of these as float64

_ORIENTATIONS = {0: 1, 3: 3, 5: 8, 6: 6}  # LibRaw's flips as EXIF's orientations


def raw_size(path: Path) -> Size:
    """LibRaw's, which reads photosites on demand."""
    import rawpy

    with rawpy.imread(str(path)) as raw:
        width, height = raw.sizes.raw_width, raw.sizes.raw_height
        return Size(width, height, DEVELOPED * width * height)


def read_raw(path: Path) -> tuple[Float[np.ndarray, "h w 3"], Bool[np.ndarray, "h w"]]:
    """Develop a raw file by LibRaw: black level, white balance of the camera, demosaicing, the camera's matrix.

    No brightening, no highlight recovery, no curve. The matrix is applied to floats, so that colours beyond Rec. 709
    keep their negative channels.

    Returns:
        radiance: linear Rec. 709, float32; 1 where a channel that white balance leaves alone is full.
        clipped: pixels whose own photosite is full.

    Raises:
        InputError: the sensor's photosites do not lie in rows and columns.
    """
    import rawpy

    with rawpy.imread(str(path)) as raw:
        if raw.raw_type != rawpy.RawType.Flat:
            raise InputError(path, "sensor", "of stacked colours", "one with a colour filter before each photosite")
        matrix = np.array(raw.color_matrix)[:, :3]
        clipped = upright(_full(raw), _ORIENTATIONS.get(raw.sizes.flip, 1))
        camera = raw.postprocess(
            use_camera_wb=True,
            no_auto_bright=True,
            adjust_maximum_thr=0.0,  # else LibRaw takes the brightest pixel for white
            gamma=(1, 1),
            output_bps=16,
            output_color=rawpy.ColorSpace.raw,
        )
    if camera.shape[:2] != clipped.shape:
        raise InputError(path, "sensor", "of turned or oblong photosites", "rows and columns of square ones")
    if not matrix.any():  # LibRaw knows no matrix of this camera, nor does the file
        matrix = np.eye(3)
    return (camera @ (matrix.T / np.iinfo(np.uint16).max)).astype(np.float32), clipped


def _full(raw: Any) -> Bool[np.ndarray, "h w"]:
    """Photosites near the white level."""
    black = np.array(raw.black_level_per_channel)[raw.raw_colors_visible]
    return raw.raw_image_visible >= black + FULL * (raw.white_level - black)
