"""What accuracy to pay for: one small value, with the presets of the command line."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from shaders.lobe import Distribution

MICROFACET_RANGE = (0.005, 1.2)  # alpha: from what no pixel of a photograph resolves to beyond any metal's finish
BLUR_RANGE = (1e-3, 2.0)  # ρ: below, the taps lie within a texel; at 2 they already span ± 63°


@dataclass(frozen=True)
class Fidelity:
    """One choice for each question that the model answers at several prices [MODEL.md 6].

    Attributes:
        name: of the preset it came from.
        reflectance: of metals: "conductor" (exact) or "lazanyi" (the thesis's; sees F0 only).
        lobe: microfacet distribution, or "taps" for the thesis's blur.
        samples: directions per pixel and roughness level in the final table, a multiple of 4; 49 for taps.
        search_samples: the same while the roughness is still unknown.
        pixels: how many are fitted, over all photographs.
        search_pixels: how many of them while the roughness is still unknown.
        footprint: rays along each side of a pixel.
        search_levels, levels: roughness levels over the whole range, and around the roughness found.
        degree: Chebyshev polynomials for the reflectance.
        spans: factors around the roughness found, both ways, that the tables after the search span in turn; all but
            the last are of the search's pixels. The 49 taps step over texels and so depend on ρ without smoothness:
            their last span has to be a narrow one.
    """

    name: str
    reflectance: Literal["conductor", "lazanyi"]
    lobe: Distribution | Literal["taps"]
    samples: int
    search_samples: int
    pixels: int
    search_pixels: int
    footprint: int
    search_levels: int
    levels: int
    degree: int
    spans: tuple[float, ...] = (1.3, 1.1)

    def reflectance_of(self, kind: str) -> str:
        """The formula of the reflectance of one type of material."""
        if kind == "metal":
            return self.reflectance
        return "dielectric" if kind == "glossy" and self.reflectance == "conductor" else "schlick"


PRESETS = {
    "viewer": Fidelity("viewer", "lazanyi", "taps", 49, 49, 4000, 4000, 1, 24, 9, 6, (1.25, 1.05, 1.005)),
    "preview": Fidelity("preview", "conductor", "ggx", 256, 64, 3000, 1000, 2, 12, 5, 12),
    "standard": Fidelity("standard", "conductor", "ggx", 512, 64, 12000, 1500, 4, 12, 5, 12),
    "reference": Fidelity("reference", "conductor", "ggx", 2048, 128, 40000, 4000, 7, 14, 7, 16),
}


def preset(name: str, distribution: Distribution = "ggx") -> Fidelity:
    """A preset of `PRESETS`, for surfaces with the given microfacets; the viewer's model has none."""
    found = PRESETS[name]
    return found if found.lobe == "taps" else replace(found, lobe=distribution)
