"""Which effects of DESIGN.md's list a fit simulates, and why."""

from __future__ import annotations

from collections.abc import Collection

from fitter.fidelity import Fidelity
from fitter.result import Effect


def effects_of(
    fidelity: Fidelity, types: Collection[str], lights: int, self_seeing: float, polished: bool = False
) -> tuple[Effect, ...]:
    """The effects by name, on or off, each with its reason.

    Args:
        fidelity: what was asked for.
        types: of the materials that were found.
        lights: number of directional lights.
        self_seeing: share of the pixels that mirror the object itself.
        polished: whether Mitsuba's paths had the last word.
    """
    blurs, exact = fidelity.blurs, fidelity.reflectance == "conductor"
    mirrors, scatters = bool({"metal", "glossy"} & {*types}), bool({"glossy", "matte"} & {*types})
    found = f"the materials are {', '.join(sorted({*types}))}"
    nothing = f"{found}, which mirror nothing"
    itself = (
        f"{self_seeing:.1%} of the pixels mirror the object itself; they were left out of the fit"
        if self_seeing > 0
        else "no pixel looked at mirrors the object itself"
    )
    paths = f"{itself}; Mitsuba traced the paths of the polish" if polished else itself
    above = "the viewer's blur has none" if blurs else "light from below the surface is not counted"
    lamps = f"{lights} directional light{'s' * (lights > 1)}" if lights else "the scene has no directional lights"
    guarded = blurs and "glossy" in types
    if not exact:
        fresnel = f"{fidelity.reflectance}'s reflectance was asked for"
    elif "metal" in types:
        fresnel = "n and k differ in it alone"
    else:
        fresnel = "a dielectric's for glossy materials" if mirrors else nothing
    rows = [
        ("reflection", mirrors, found if mirrors else nothing),
        ("blur", mirrors, "the roughness is fitted" if mirrors else nothing),
        ("horizon", mirrors and not blurs, above if mirrors else nothing),
        ("light-reflection", mirrors and lights > 0, lamps if mirrors else nothing),
        ("diffuse-irradiance", scatters, found if scatters else "metals have no diffuse part"),
        ("energy-guard", guarded, "colour and reflection share the light" if guarded else "nothing calls for it"),
        ("normal-map", False, "none is given"),
        ("color-map", False, "none is given"),
        ("ambient-occlusion", False, "none is given"),
        ("double-bounce", False, "no ambient-occlusion map is given"),
        ("captured-neighbours", False, "pixels that mirror other objects are left out of the fit"),
        ("depth-scaled-blur", False, "no neighbours are captured"),
        ("self-visibility", polished, paths),
        ("interreflection", polished, paths),
        ("exact-fresnel", exact and mirrors, fresnel),
        ("pixel-footprint", fidelity.footprint > 1, f"{fidelity.footprint**2} rays per pixel"),
    ]
    return tuple(Effect(name=name, on=on, why=why) for name, on, why in rows)
