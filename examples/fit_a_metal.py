"""Photograph a ball of gold by path tracing, fit it, compare with the truth. Usage: fit_a_metal.py [FOLDER]"""

import sys
from pathlib import Path

from fit_material.fitter.options.fidelity import PRESETS, Fidelity
from fit_material.fitter.pipeline.fit_scene import FitOptions, fit_scene
from fit_material.fitter.result.schema import Result
from fit_material.renderer.materials.ground_truth import TrueMetal
from fit_material.renderer.synthesis.synthesise import SynthOptions, synthesise

GOLD = TrueMetal(n=(0.146, 0.425, 1.431), k=(3.578, 2.326, 1.850), alpha=0.15)


def main(folder: Path, size: int = 64, spp: int = 128, fidelity: Fidelity = PRESETS["preview"]) -> Result:
    """Small photographs and the quickest fit; `fit-material demo` has larger ones."""
    scene = synthesise(SynthOptions(GOLD, size=size, spp=spp), folder / "photographs")
    result = fit_scene(scene, folder / "result", FitOptions(fidelity, type="metal"))
    found = result.materials[0]
    print(result.message)
    print(f"most like {found.nearest[0].name}; alpha {found.alpha:.3f}, in truth {GOLD.alpha}")
    for channel, name in enumerate(("red", "green", "blue")):
        for key in ("n", "k"):
            value, interval, true = (of[channel] for of in (getattr(x, key) for x in (found, found.interval95, GOLD)))
            low, high = interval or (0, float("inf"))
            print(f"{name:5}  {key} {value:.2f}, 95 %: {low:.2f} to {high:.2f}, in truth {true:.2f}")
    return result


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "gold"))
