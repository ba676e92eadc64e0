"""Photographs as a centred pinhole would have taken them, to lay beside what OpenGL draws."""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import grid_sample

from fit_material.renderer.cameras.camera import Camera


def pinhole(camera: Camera) -> Camera:
    """The camera without its lens: of the same focal length, its axis in the middle."""
    return replace(camera, lens=None)


def rectified(picture: Float[Tensor, "h w c"], camera: Camera) -> Float[Tensor, "h w c"]:
    """A picture by `camera` as `pinhole(camera)` would have taken it, bilinear; 0 where the lens saw nothing."""
    if camera.lens is None:
        return picture
    lens, width, height = camera.lens, camera.width, camera.height
    row, column = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    right = (column.double() + 0.5 - width / 2) / lens.fx
    down = (row.double() + 0.5 - height / 2) / lens.fx  # the pinhole's pixels are square
    x_d, y_d = lens.distorted(right, down)
    place = torch.stack([2 * (lens.fx * x_d + lens.cx) / width - 1, 2 * (lens.fy * y_d + lens.cy) / height - 1], -1)
    found = grid_sample(picture.movedim(-1, 0)[None], place[None].to(picture), align_corners=False)
    return found[0].movedim(0, -1)
