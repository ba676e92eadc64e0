"""Lights of the scene file as the shading model takes them."""

from __future__ import annotations

import math

import torch

from fit_material.renderer.scene.scene_file import LightSpec
from fit_material.shaders.lights import DirectionalLight


def directional_light(spec: LightSpec) -> DirectionalLight:
    """A light of the scene file as the shading model takes it.

    The file gives the irradiance on a surface that faces the light; the model's E is that irradiance over π, so that
    a white Lambertian surface sends out E · max(0, n·l), as it physically does.
    """
    towards = torch.tensor(spec.direction, dtype=torch.float64)
    towards = towards / towards.abs().max()  # whose square neither overflows nor vanishes
    return DirectionalLight(
        torch.nn.functional.normalize(towards, dim=0), torch.tensor(spec.irradiance, dtype=torch.float64) / math.pi
    )
