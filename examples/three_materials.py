"""An egg of three materials: one mesh, three `usemtl` groups, one fit of each. Usage: three_materials.py [FOLDER]"""

import sys
from pathlib import Path

import numpy as np
import trimesh

from fit_material.fitter.options.fidelity import PRESETS, Fidelity
from fit_material.fitter.pipeline.fit_scene import FitOptions, fit_scene
from fit_material.fitter.result.schema import Result
from fit_material.renderer.materials.ground_truth import TrueGlossy, TrueMatte, TrueMetal
from fit_material.renderer.synthesis.synthesise import SynthOptions, synthesise

TRUTH = {
    "gold": TrueMetal(n=(0.146, 0.425, 1.431), k=(3.578, 2.326, 1.850), alpha=0.05),
    "glaze": TrueGlossy(color=(0.02, 0.10, 0.25), reflectance=(0.05, 0.05, 0.05), alpha=0.05),
    "clay": TrueMatte(color=(0.45, 0.22, 0.13)),
}
QUARTER_TURN = trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0])  # a lathe's axis is +Z, ours +Y


def egg(path: Path) -> Path:
    """A lathed egg: a gold cap on a glazed belt on a clay bottom, smooth across their borders."""
    height = -np.cos(np.linspace(0, np.pi, 65))
    radius = np.sqrt(np.clip(1 - height**2, 0, None)) * (1 - 0.18 * height)
    mesh = trimesh.creation.revolve(np.column_stack([radius, 1.25 * height]), sections=96, transform=QUARTER_TURN)
    lines = [f"v {x:.7g} {y:.7g} {z:.7g}" for x, y, z in mesh.vertices]
    lines += [f"vn {x:.7g} {y:.7g} {z:.7g}" for x, y, z in mesh.vertex_normals]
    lowest = mesh.vertices[mesh.faces, 1].min(axis=1)
    for name, belongs in (("gold", lowest > 0.4), ("glaze", np.abs(lowest) <= 0.4), ("clay", lowest < -0.4)):
        lines.append(f"usemtl {name}")
        lines += ["f " + " ".join(f"{corner}//{corner}" for corner in face + 1) for face in mesh.faces[belongs]]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def main(folder: Path, size: int = 64, spp: int = 128, fidelity: Fidelity = PRESETS["preview"]) -> Result:
    """FOLDER/result/egg.thesis.mtl has three materials. Their types are told, which is sooner than finding them."""
    options = SynthOptions(TRUTH, mesh=egg(folder / "egg.obj"), size=size, spp=spp)
    scene = synthesise(options, folder / "photographs")
    with scene.open("a", encoding="utf-8") as file:
        file.writelines(f'\n[[materials]]\nname = "{name}"\ntype = "{truth.type}"\n' for name, truth in TRUTH.items())
    result = fit_scene(scene, folder / "result", FitOptions(fidelity))
    for material in result.materials:
        key = "f0" if material.type == "metal" else "color"
        print(f"{material.name:6} {material.type:7} {key:6}", *(f"{value:.3f}" for value in getattr(material, key)))
    return result


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "egg"))
