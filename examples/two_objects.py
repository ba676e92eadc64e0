"""Two objects that mirror each other, each from a cubemap of its neighbours. Usage: two_objects.py [FOLDER]"""

import sys
from pathlib import Path

import torch
import trimesh
from trimesh.visual import TextureVisuals
from trimesh.visual.material import SimpleMaterial

from fit_material.renderer.cameras.camera import Camera, look_at
from fit_material.renderer.files.atomic import write_bytes_atomically, write_text_atomically
from fit_material.renderer.images.image_file import png
from fit_material.renderer.opengl.offscreen import render
from fit_material.renderer.synthesis.studio import studio
from fit_material.renderer.viewer_model.model import read_model
from fit_material.renderer.viewer_model.viewer_light import surroundings
from fit_material.shaders.tone_mapping import tone_mapped

WHITE, RED = (255, 255, 255, 255), (255, 0, 0, 255)  # trimesh takes materials of one colour for the same
MTL = """\
# Ns 2: a metal of n, k and roughness; Ns 1: glossy, of color, reflectance and roughness
newmtl silver
Ns 2
Kd 0.16 0.12 0.13
Ka 4.1 3.3 2.5
Ks 0.02 0.02 0.02

newmtl lacquer
Ns 1
Kd 0.7 0.03 0.02
Ka 0.05 0.05 0.05
Ks 0.02 0.02 0.02
"""


def model(folder: Path) -> Path:
    """A silver ball beside a smaller one of red lacquer: an OBJ of two `o` objects, and its MTL."""
    scene = trimesh.Scene()
    for name, color, radius, place in (
        ("silver", WHITE, 1.0, (-0.65, 0.0, 0.0)),
        ("lacquer", RED, 0.7, (1.0, -0.3, 0.45)),
    ):
        ball = trimesh.creation.icosphere(subdivisions=4, radius=radius)
        ball.visual = TextureVisuals(material=SimpleMaterial(name=name, diffuse=color))
        scene.add_geometry(ball.apply_translation(place), geom_name=name)
    write_text_atomically(folder / "balls.thesis.mtl", MTL)
    write_text_atomically(folder / "balls.obj", str(scene.export(file_type="obj", include_normals=True)))
    return folder / "balls.obj"


def main(folder: Path, size: int = 256) -> None:
    """One picture with neighbours, one without, and by how much they differ."""
    folder.mkdir(parents=True, exist_ok=True)
    balls, light = read_model(model(folder)), surroundings(studio())
    origin, target, up = torch.tensor([[1.2, 0.9, 5.6], [0.15, -0.08, 0.0], [0.0, 1.0, 0.0]], dtype=torch.float64)
    camera = Camera(look_at(origin, target, up), 3 * size // 2, size, fov=38)
    pictures = [torch.from_numpy(render(balls, camera, light, neighbours=known)[..., :3]) for known in (True, False)]
    for name, picture in zip(("neighbours.png", "alone.png"), pictures, strict=True):
        codes = (255 * tone_mapped(picture, exposure=-0.5, curve="aces")).round().byte().numpy()
        write_bytes_atomically(folder / name, png(codes))
    changed = ((pictures[0] - pictures[1]).abs().amax(-1) > 0.01).float().mean()
    print(f"each mirrors the other in {changed:.1%} of the picture: {folder / 'neighbours.png'}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "balls"))
