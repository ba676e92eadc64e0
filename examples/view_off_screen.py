"""Draw a model without a window: as PNG, and as EXR before tone mapping. Usage: view_off_screen.py [FOLDER]

The same from a shell: fit-material view ring.obj --screenshot ring.png --size 480 360
"""

import sys
from pathlib import Path

import torch
import trimesh

from fit_material.renderer.cameras.camera import Camera, look_at
from fit_material.renderer.files.atomic import write_bytes_atomically, write_text_atomically
from fit_material.renderer.images.image_file import png, write_exr
from fit_material.renderer.opengl.offscreen import render
from fit_material.renderer.synthesis.studio import studio
from fit_material.renderer.viewer_model.model import read_model
from fit_material.renderer.viewer_model.viewer_light import surroundings
from fit_material.shaders.tone_mapping import tone_mapped

COPPER = """\
newmtl copper
Ns 2
Kd 0.275 1.116 1.247
Ka 3.373 2.596 2.456
Ks 0.06 0.06 0.06
"""


def main(folder: Path, size: int = 240) -> None:
    """Ns 2 is a metal, Kd its n, Ka its k, Ks the roughness ρ: what `fit` writes as NAME.thesis.mtl."""
    folder.mkdir(parents=True, exist_ok=True)
    ring = trimesh.creation.torus(major_radius=1.0, minor_radius=0.42, major_sections=160, minor_sections=80)
    write_text_atomically(folder / "ring.obj", str(ring.export(file_type="obj", include_normals=True)))
    write_text_atomically(folder / "ring.thesis.mtl", COPPER)
    origin, target, up = torch.tensor([[1.6, 1.9, 4.4], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]], dtype=torch.float64)
    camera = Camera(look_at(origin, target, up), 4 * size // 3, size, fov=46)
    picture = render(read_model(folder / "ring.obj"), camera, surroundings(studio()))
    write_exr(folder / "ring.exr", picture[..., :3])
    codes = 255 * tone_mapped(torch.from_numpy(picture[..., :3]), exposure=-0.5, curve="aces")
    write_bytes_atomically(folder / "ring.png", png(codes.round().byte().numpy()))
    print(f"{folder / 'ring.png'}: {picture[..., 3].mean():.0%} of it shows the ring")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "ring"))
