"""What the structure of a scene says of each effect, before anything is measured."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from fit_material.shaders.materials.kinds import KINDS

NOT_WITH = {
    "normal-map": "a map, which normal_map of a scene's [[materials]] names",
    "color-map": "a map, which --maps color recovers",
    "double-bounce": "a map, which ambient_occlusion_map of a scene's [[materials]] names, in the viewer's model",
    "captured-neighbours": "the viewer: fits leave out pixels that mirror other objects, or follow rays to them",
    "depth-scaled-blur": "the viewer: fits leave out pixels that mirror other objects, or follow rays to them",
}
"""What no fit can have, and what it would take."""

NOT_WITHOUT = {
    "reflection": "--type matte",
    "diffuse-irradiance": "--type metal",
    "horizon": "--fidelity viewer",
    "normal-map": "a scene without normal_map",
    "double-bounce": "--without ambient-occlusion",
}
"""What no fit can do without, and what to say instead."""


@dataclass(frozen=True)
class Facts:
    """What is known of a scene before anything is measured.

    Attributes:
        kinds: types that its materials may be of.
        lights: number of directional lights.
        convex: whether no point of the object sees another.
        blurs: whether the model is the thesis's, its lobe a blur.
        reflectance: of metals, as fidelities call it; "conductor" is the exact one.
        footprint: rays along each side of a pixel that were asked for.
        untraced: why no paths are traced here, because they cannot be or need not; None where they may.
        found: whether the materials are known, and not just possible.
        maps: textures that there are: "color", "normal", "ambient-occlusion".
    """

    kinds: frozenset[str]
    lights: int
    convex: bool
    blurs: bool
    reflectance: str
    footprint: int
    untraced: str | None = None
    found: bool = False
    maps: frozenset[str] = frozenset()

    @property
    def mirrors(self) -> bool:
        return any(KINDS[kind].mirrors for kind in self.kinds)

    @property
    def scatters(self) -> bool:
        return any(KINDS[kind].has_body for kind in self.kinds)

    @property
    def materials(self) -> str:
        """The types, in words."""
        are = "are" if self.found else "may be"
        return f"the materials {are} {', '.join(sorted(self.kinds))}"


Rule = Callable[[Facts], "str | None"]
"""Why an effect is off, whatever its size; None where it may be seen."""


def why_off(name: str, facts: Facts) -> str | None:
    return next((why for rule in _RULES[name] if (why := rule(facts)) is not None), None)


def why_on(facts: Facts) -> dict[str, str]:
    """Effects that structure alone calls for, if it does not rule them out."""
    sought = {} if facts.found and not facts.blurs else {"blur": "the roughness is sought"}
    if not all(KINDS[kind].has_body for kind in facts.kinds):
        sought["exact-fresnel"] = "n and k differ in it alone"
    if "color" in facts.maps:
        sought["color-map"] = "--maps color recovers it"
    if "normal" in facts.maps:
        sought["normal-map"] = "the scene names one"
    if "ambient-occlusion" in facts.maps:
        sought |= dict.fromkeys(("ambient-occlusion", "double-bounce"), "the scene names a map of it")
    horizon = "light from below the surface is not counted"
    return {"reflection": facts.materials, "diffuse-irradiance": facts.materials, "horizon": horizon, **sought}


def _nothing_mirrors(facts: Facts) -> str | None:
    return None if facts.mirrors else f"{facts.materials}, which mirrors nothing"


def _no_body(facts: Facts) -> str | None:
    return None if facts.scatters else f"{facts.materials}, which has no diffuse body"


def _convex(facts: Facts) -> str | None:
    return "the object is convex, no point of it sees another" if facts.convex else None


def _no_lights(facts: Facts) -> str | None:
    return None if facts.lights else "the scene has no directional lights"


def _one_part(facts: Facts) -> str | None:
    layered = any(KINDS[kind].mirrors and KINDS[kind].has_body for kind in facts.kinds)
    return None if layered else f"{facts.materials}, of which either body or surface sends out light"


def _unlit(facts: Facts) -> str | None:
    """A diffuse body loses surroundings by ambient occlusion; lights by self-visibility."""
    return None if facts.lights else _nothing_mirrors(facts)


def _not_exact(facts: Facts) -> str | None:
    return None if facts.reflectance == "conductor" else f"{facts.reflectance}'s reflectance was asked for"


def _one_ray(facts: Facts) -> str | None:
    return None if facts.footprint > 1 else "one ray per pixel was asked for"


def _without_map(name: str, why: str = "none is given") -> Rule:
    return lambda facts: None if name in facts.maps else why


def _unmapped(rule: Rule) -> Rule:
    """A rule for objects without a map of ambient occlusion."""
    return lambda facts: None if "ambient-occlusion" in facts.maps else rule(facts)


def _never(why: str) -> Rule:
    return lambda facts: why


def _in_thesis(why: str) -> Rule:
    """Off in the thesis's model."""
    return lambda facts: why if facts.blurs else None


def _above_thesis(why: str) -> Rule:
    """Off above the thesis's model."""
    return lambda facts: None if facts.blurs else why


_RULES: Mapping[str, tuple[Rule, ...]] = {
    "reflection": (_nothing_mirrors,),
    "blur": (_nothing_mirrors,),
    "horizon": (_nothing_mirrors, _in_thesis("the viewer's blur has none")),
    "light-reflection": (_nothing_mirrors, _no_lights),
    "diffuse-irradiance": (_no_body,),
    "energy-guard": (_one_part, _above_thesis("a rough dielectric's own transmittance keeps the energy")),
    "normal-map": (_without_map("normal"),),
    "color-map": (_without_map("color"), _no_body),
    "ambient-occlusion": (
        _no_body,
        _unmapped(_convex),
        _unmapped(_in_thesis("the viewer has none where no map of it is given")),
    ),
    "double-bounce": (
        _without_map("ambient-occlusion", "no ambient-occlusion map is given"),
        _nothing_mirrors,
        _above_thesis("rays meet the object itself where it is, see self-visibility"),
    ),
    "captured-neighbours": (
        _convex,
        _above_thesis("rays meet neighbours where they are, see self-visibility"),
        _never("pixels that mirror other objects are left out of the fit"),
    ),
    "depth-scaled-blur": (_never("no neighbours are captured"),),
    "self-visibility": (_convex, _unlit, _in_thesis("the viewer sees far surroundings alone")),
    "interreflection": (_convex, _in_thesis("the viewer follows no paths")),
    "exact-fresnel": (_nothing_mirrors, _not_exact),
    "pixel-footprint": (_one_ray,),
}
