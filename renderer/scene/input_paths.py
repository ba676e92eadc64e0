"""The files that a scene reads."""

from __future__ import annotations

from pathlib import Path

from fit_material.renderer.camera_files.colmap import model_files
from fit_material.renderer.scene.scene_file import Scene


def input_paths(scene: Scene, scene_file: Path) -> list[Path]:
    """The files that a scene names, itself and its photographs among them."""
    photographs = [path for photograph in scene.photographs for path in photograph.files]
    return [path for path in (*beside_photographs(scene, scene_file), *photographs) if path is not None]


def beside_photographs(scene: Scene, scene_file: Path) -> list[Path | None]:
    """The same without the photographs; None where a scene names no file."""
    light = scene.environment.map
    cameras = model_files(scene.cameras) if scene.cameras is not None and scene.cameras.is_dir() else [scene.cameras]
    maps = [file for each in scene.materials for file in (each.normal_map, each.ambient_occlusion_map)]
    surroundings = sorted(light.iterdir()) if light.is_dir() else [light]
    return [scene_file, *cameras, scene.geometry.mesh, *surroundings, *maps]
