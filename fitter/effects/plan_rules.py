"""Each effect's verdict by the structure of a scene, before anything is measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from fit_material.shaders.materials.kinds import KINDS
from fit_material.shaders.materials.types import Material
from fit_material.shaders.registry.registry import Registry


@dataclass(frozen=True)
class Facts:
    """What is known of a scene before anything is measured.

    Attributes:
        kinds: types that its materials may be of.
        lights: number of directional lights.
        convex: whether no point of the object sees another.
        blurs: whether the model is the thesis's, its lobe a blur.
        reflectance: of metals, as fidelities call it; "conductor" is the exact one.
        footprint: rays along each side of a pixel that were requested.
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
"""Why an effect is off, or on, whatever its size; None where the rule does not decide."""


@dataclass(frozen=True)
class EffectRule:
    """What decides over an effect before it is measured, and how it is measured.

    Attributes:
        name: of the effect, as `shaders.effects` has it.
        off: rules by which it is off.
        on: why it is on, whatever its size, if no rule has it off; None where that is to be measured.
        not_with: what it would take; None of an effect that `--with` may bring in.
        not_without: what to choose instead; None of an effect that `--without` may leave out.
        shown_by: determines whether a material can show it.
        between_points: whether it needs points of the object that see each other.
        traced: whether it takes paths, and is measured by one bounce.
        changes_table: whether light tables differ by it.
        always: whether no picture of a fit is without it.
    """

    name: str
    off: tuple[Rule, ...]
    on: Rule = lambda facts: None
    not_with: str | None = None
    not_without: str | None = None
    shown_by: Callable[[Material], bool] = lambda material: True
    between_points: bool = False
    traced: bool = False
    changes_table: bool = False
    always: bool = False

    def why_off(self, facts: Facts) -> str | None:
        """Why it is off, whatever its size; None where it may be seen."""
        return next((why for rule in self.off if (why := rule(facts)) is not None), None)


def _mirrors(material: Material) -> bool:
    return material.mirrors


def _has_body(material: Material) -> bool:
    return material.has_body


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
    return None if facts.reflectance == "conductor" else f"{facts.reflectance}'s reflectance was requested"


def _one_ray(facts: Facts) -> str | None:
    return None if facts.footprint > 1 else "one ray per pixel was requested"


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


def _sought(facts: Facts) -> str | None:
    return None if facts.found and not facts.blurs else "the roughness is sought"


def _index_counts(facts: Facts) -> str | None:
    bodies = all(KINDS[kind].has_body for kind in facts.kinds)
    return None if bodies else "n and k differ in it alone"


def _with_map(name: str, why: str) -> Rule:
    return lambda facts: why if name in facts.maps else None


_NEIGHBOURS = "the viewer: fits leave out pixels that mirror other objects, or follow rays to them"
_MAPPED_OCCLUSION = _with_map("ambient-occlusion", "the scene names a map of it")

RULES = Registry(
    EffectRule("reflection", (_nothing_mirrors,), lambda facts: facts.materials, not_without="--type matte"),
    EffectRule("blur", (_nothing_mirrors,), _sought, shown_by=_mirrors, changes_table=True),
    EffectRule(
        "horizon",
        (_nothing_mirrors, _in_thesis("the viewer's blur has none")),
        lambda facts: "light from below the surface is not counted",
        not_without="--fidelity viewer",
        always=True,
    ),
    EffectRule("light-reflection", (_nothing_mirrors, _no_lights), shown_by=_mirrors),
    EffectRule("diffuse-irradiance", (_no_body,), lambda facts: facts.materials, not_without="--type metal"),
    EffectRule(
        "energy-guard",
        (_one_part, _above_thesis("a rough dielectric's own transmittance keeps the energy")),
        shown_by=lambda material: material.mirrors and material.has_body,
    ),
    EffectRule(
        "normal-map",
        (_without_map("normal"),),
        _with_map("normal", "the scene names one"),
        not_with="a map, which normal_map of a scene's [[materials]] names",
        not_without="a scene without normal_map",
        always=True,
    ),
    EffectRule(
        "color-map",
        (_without_map("color"), _no_body),
        _with_map("color", "--maps color recovers it"),
        not_with="a map, which --maps color recovers",
    ),
    EffectRule(
        "ambient-occlusion",
        (
            _no_body,
            _unmapped(_convex),
            _unmapped(_in_thesis("the viewer has none where no map of it is given")),
        ),
        _MAPPED_OCCLUSION,
        shown_by=_has_body,
    ),
    EffectRule(
        "double-bounce",
        (
            _without_map("ambient-occlusion", "no ambient-occlusion map is given"),
            _nothing_mirrors,
            _above_thesis("rays meet the object itself where it is, see self-visibility"),
        ),
        _MAPPED_OCCLUSION,
        not_with="a map, which ambient_occlusion_map of a scene's [[materials]] names, in the viewer's model",
        not_without="--without ambient-occlusion",
        always=True,
    ),
    EffectRule(
        "captured-neighbours",
        (
            _convex,
            _above_thesis("rays meet neighbours where they are, see self-visibility"),
            _never("pixels that mirror other objects are left out of the fit"),
        ),
        not_with=_NEIGHBOURS,
    ),
    EffectRule("depth-scaled-blur", (_never("no neighbours are captured"),), not_with=_NEIGHBOURS),
    EffectRule(
        "self-visibility",
        (_convex, _unlit, _in_thesis("the viewer sees far surroundings alone")),
        between_points=True,
        changes_table=True,
    ),
    EffectRule(
        "interreflection",
        (_convex, _in_thesis("the viewer follows no paths")),
        between_points=True,
        traced=True,
    ),
    EffectRule("exact-fresnel", (_nothing_mirrors, _not_exact), _index_counts, shown_by=_mirrors),
    EffectRule("pixel-footprint", (_one_ray,), changes_table=True),
)
"""The rules of each effect of `shaders.effects.EFFECTS`."""
