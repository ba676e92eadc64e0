"""Which effects of DESIGN.md's list a fit of metals simulates, and why."""

from __future__ import annotations

from fitter.fidelity import Fidelity
from fitter.result import Effect


def effects_of(fidelity: Fidelity, self_seeing: float) -> tuple[Effect, ...]:
    """The effects by name, on or off, each with its reason.

    Args:
        fidelity: what was asked for.
        self_seeing: share of the pixels that mirror the object itself.
    """
    taps = fidelity.lobe == "taps"
    exact = fidelity.reflectance == "conductor"
    itself = (
        f"{self_seeing:.1%} of the pixels mirror the object itself; they were left out of the fit"
        if self_seeing > 0
        else "no pixel looked at mirrors the object itself"
    )
    rows = [
        ("reflection", True, "a metal shows nothing else"),
        ("blur", True, "the roughness is fitted"),
        ("horizon", not taps, "the 49 taps have none" if taps else "light from below the surface is not counted"),
        ("light-reflection", False, "the scene has no directional lights"),
        ("diffuse-irradiance", False, "metals have no diffuse part"),
        ("energy-guard", False, "metals have no diffuse part"),
        ("normal-map", False, "none is given"),
        ("color-map", False, "none is given"),
        ("ambient-occlusion", False, "none is given"),
        ("double-bounce", False, "no ambient-occlusion map is given"),
        ("captured-neighbours", False, "the scene has one object"),
        ("depth-scaled-blur", False, "the scene has one object"),
        ("self-visibility", False, itself),
        ("interreflection", False, itself),
        ("exact-fresnel", exact, "n and k differ in it alone" if exact else "the viewer's reflectance was asked for"),
        ("pixel-footprint", fidelity.footprint > 1, f"{fidelity.footprint**2} rays per pixel"),
    ]
    return tuple(Effect(name=name, on=on, why=why) for name, on, why in rows)
