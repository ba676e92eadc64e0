"""Photograph a ball of gold by path tracing, fit it, compare with the truth. Usage: fit_a_metal.py [FOLDER]"""

import sys
from pathlib import Path

from fitter.fidelity import PRESETS, Fidelity
from fitter.pipeline import FitOptions, fit_scene
from fitter.result import Result
from renderer.synth import SynthOptions, synthesise
from renderer.truth import TrueMetal

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
