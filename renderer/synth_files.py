"""What is written beside synthetic photographs: the scene file for a fit, the truth to compare it with."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch

from renderer.scene import LightSpec
from renderer.truth import TrueMaterial, TrueMatte, TrueMetal
from renderer.views import View
from shaders.fresnel import normal_reflectance


def scene_toml(mesh: Path | None, lights: Sequence[LightSpec], poses: Sequence[View]) -> str:
    """The scene as DESIGN.md's contract has it; a float's repr is exact, and valid TOML."""
    geometry = 'shape = "sphere"' if mesh is None else f"mesh = {_quoted(mesh.name)}\nsmooth = true"
    head = f'[geometry]\n{geometry}\n\n[environment]\nmap = "environment.exr"\nrotation = 0.0\nscale = 1.0\n'
    head += "".join(_light_toml(light) for light in lights)
    return head + "".join(_photograph_toml(index, pose) for index, pose in enumerate(poses))


def _light_toml(light: LightSpec) -> str:
    return f"""
[[lights]]
type = "directional"
direction = {list(light.direction)}
irradiance = {list(light.irradiance)}
"""


def _photograph_toml(index: int, pose: View) -> str:
    return f"""
[[photographs]]
image = "view_{index}.exr"
exposure = 1.0
[photographs.camera]
origin = {list(pose.origin)}
target = {list(pose.target)}
up = {list(pose.up)}
fov = {float(pose.fov)}
"""


def _quoted(text: str) -> str:
    """A TOML basic string, which JSON's strings are, but for DEL, which TOML wants escaped."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def material_entry(name: str, material: TrueMaterial) -> dict[str, Any]:
    """A material by the names of result.json, None where it has none."""
    numbers = ("n", "k", "alpha", "roughness", "color", "reflectance")
    return {
        "name": name,
        "type": material.type,
        **{key: getattr(material, key, None) for key in numbers},
        "f0": _normal_reflectance(material),
        "distribution": material.distribution if not isinstance(material, TrueMatte) and material.alpha else None,
        "metal": getattr(material, "metal", None) or None,
        "source": getattr(material, "source", None) or None,
    }


def _normal_reflectance(material: TrueMaterial) -> Sequence[float] | None:
    """F0 of what the surface mirrors."""
    if isinstance(material, TrueMetal):
        n, k = (torch.tensor(index, dtype=torch.float64) for index in (material.n, material.k))
        return normal_reflectance(n, k).tolist()
    return material.reflectance if material.type == "glossy" else None
