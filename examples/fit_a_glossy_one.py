"""Photograph a ball of red plastic and fit it without telling what it is. Usage: fit_a_glossy_one.py [FOLDER]"""

import sys
from pathlib import Path

from fit_material.fitter.options.fidelity import PRESETS, Fidelity
from fit_material.fitter.pipeline.fit_scene import FitOptions, fit_scene
from fit_material.fitter.result.schema import Result
from fit_material.renderer.materials.ground_truth import TrueGlossy
from fit_material.renderer.synthesis.synthesise import SynthOptions, synthesise

PLASTIC = TrueGlossy(color=(0.60, 0.12, 0.08), reflectance=(0.04, 0.04, 0.04), alpha=0.1)


def main(folder: Path, size: int = 64, spp: int = 128, fidelity: Fidelity = PRESETS["preview"]) -> Result:
    """`auto` fits a metal, a glossy and a matte material, and takes what explains the photographs best."""
    scene = synthesise(SynthOptions(PLASTIC, size=size, spp=spp), folder / "photographs")
    result = fit_scene(scene, folder / "result", FitOptions(fidelity, type="auto"))
    found = result.materials[0]
    print(result.message)
    for key in ("color", "reflectance"):
        for value, error, true in zip(
            getattr(found, key), getattr(found.stderr, key), getattr(PLASTIC, key), strict=True
        ):
            print(f"{key:11}  {value:.4f} ± {error:.4f}, in truth {true}")
    print(f"alpha        {found.alpha:.4f} ± {found.stderr.alpha:.4f}, in truth {PLASTIC.alpha}")
    return result


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "plastic"))
