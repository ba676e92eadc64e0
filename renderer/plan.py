"""Which effects the photographs of a scene call for: what its structure decides, what is left to be measured."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace

from renderer.errors import InputError
from shaders.effects import BY_NAME, EFFECTS, NAMES

MIRRORS = frozenset({"metal", "glossy"})
_ROUNDING = 1e-6  # relative, of float32's sums
SCATTERS = frozenset({"glossy", "matte"})


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
        untraced: why no paths can be traced here; None where they can.
        found: whether the materials are known, and not just possible.
    """

    kinds: frozenset[str]
    lights: int
    convex: bool
    blurs: bool
    reflectance: str
    footprint: int
    untraced: str | None = None
    found: bool = False

    @property
    def mirrors(self) -> bool:
        return bool(self.kinds & MIRRORS)

    @property
    def scatters(self) -> bool:
        return bool(self.kinds & SCATTERS)

    @property
    def materials(self) -> str:
        """The types, in words."""
        are = "are" if self.found else "may be"
        return f"the materials {are} {', '.join(sorted(self.kinds))}"


@dataclass(frozen=True)
class Decision:
    """Whether an effect is simulated.

    Attributes:
        name: of the effect.
        on: whether it is.
        why: the reason, with its number where it was measured.
        most: the most by which it moves a pixel, relative; None where structure decided.
        share: of the pixels, that it moves by more than the tolerance; None where structure decided.
        called_for: whether it could be seen, as far as that was measured, though it may not be possible here.
        overruled: whether somebody wanted it otherwise.
    """

    name: str
    on: bool
    why: str
    most: float | None = None
    share: float | None = None
    called_for: bool = False
    overruled: bool = False


@dataclass(frozen=True)
class Plan:
    """The effects, each on or off, in the order of `EFFECTS`.

    Attributes:
        decisions: one for each effect.
        tolerance: by how much an effect may move a pixel, relative, and still be left out.
    """

    decisions: tuple[Decision, ...]
    tolerance: float

    def __getitem__(self, name: str) -> Decision:
        return next(each for each in self.decisions if each.name == name)

    @property
    def on(self) -> frozenset[str]:
        """The names of those that are simulated."""
        return frozenset(each.name for each in self.decisions if each.on)

    def cost(self, name: str) -> float:
        """Share of the time that an effect takes, or would take, beside all others that are on."""
        others = sum(BY_NAME[each].cost for each in self.on - {name})
        own = BY_NAME[name].cost
        return own / (own + others) if own else 0.0

    @property
    def avoids(self) -> bool:
        """Whether pixels that the object sends light to are to be left out, since that light is not simulated."""
        paths = self["interreflection"]
        return paths.called_for and not paths.on and not paths.overruled

    def overruled(self, on: Collection[str], off: Collection[str]) -> Plan:
        """The plan with some effects on or off because somebody wants it so."""

        def decided(each: Decision) -> Decision:
            wanted = (each.name in on and not each.on) or (each.name in off and each.on)
            option = "--with" if each.name in on else "--without"
            why = f"{option} overrules: {each.why}"
            return replace(each, on=not each.on, why=why, overruled=True) if wanted else each

        return replace(self, decisions=tuple(decided(each) for each in self.decisions))

    def changed(self, before: Plan) -> tuple[list[str], list[str]]:
        """The effects that came, and those that went."""
        came, went = self.on - before.on, before.on - self.on
        return [name for name in BY_NAME if name in came], [name for name in BY_NAME if name in went]


@dataclass(frozen=True)
class Change:
    """By how much an effect moves the pixels of a sample, relative to their radiance.

    Attributes:
        most: the largest change of a pixel, over the materials that were tried; of the brighter picture's radiance.
        share: of the pixels, that it moves by more than the tolerance.
        material: with which it moves one most, in words.
        pixels: how many were looked at.
        seen: what else there is to say, a clause; "" for nothing.
    """

    most: float
    share: float
    material: str
    pixels: int
    seen: str = ""

    @property
    def beyond(self) -> float:
        """Share of all pixels that may be moved by more than `most`, in 95 of 100 samples [Wilks 1941, eq. 5]."""
        return 1 - 0.05 ** (1 / max(1, self.pixels))

    def told(self, tolerance: float) -> str:
        """The change as a reason."""
        bound = f"with 95 % confidence fewer than {self.beyond:.1%} of all move further"
        seen = f"{self.seen}; " if self.seen else ""
        if self.most <= _ROUNDING:
            return f"{seen}it moves none of {self.pixels} pixels; {bound}"
        if self.most <= tolerance:
            return f"{seen}it moves none of {self.pixels} pixels by more than {self.most:.2g} of its light; {bound}"
        moved = f"it moves {self.share:.1%} of {self.pixels} pixels by more than {tolerance:g} of their light"
        return f"{seen}{moved}, up to {self.most:.2g} of it ({self.material}); {bound}"


Measure = Callable[[Collection[str]], Mapping[str, Change]]


def planned(facts: Facts, measure: Measure, tolerance: float) -> Plan:
    """Each effect decided: by the scene's structure where that suffices, else by how much it moves pixels.

    Args:
        facts: what is known of the scene.
        measure: by how much each of some effects moves pixels.
        tolerance: relative; what moves a pixel by more is called for.
    """
    off = {name: _why_off(name, facts) for name in BY_NAME}
    on = _on(facts)
    changes = measure([name for name in BY_NAME if off[name] is None and name not in on])

    def decided(name: str) -> Decision:
        why = off[name]
        if why is not None:
            return Decision(name, False, why)
        if name in on:
            return Decision(name, True, on[name])
        change, wanted = changes[name], changes[name].most > tolerance
        told, possible = change.told(tolerance), name != "interreflection" or facts.untraced is None
        if wanted and not possible:
            told = f"{told}; but {facts.untraced}: pixels that mirror the object are left out instead"
        return Decision(name, wanted and possible, told, change.most, change.share, wanted)

    return Plan(tuple(decided(effect.name) for effect in EFFECTS), tolerance)


NOT_WITH = {
    "normal-map": "a map, which a scene file cannot name so far",
    "color-map": "a map, which a scene file cannot name so far",
    "double-bounce": "a map of ambient occlusion, which a scene file cannot name so far",
    "captured-neighbours": "the viewer: fits leave out pixels that mirror other objects, or follow rays to them",
    "depth-scaled-blur": "the viewer: fits leave out pixels that mirror other objects, or follow rays to them",
}
"""What no fit can have, and what it would take."""

NOT_WITHOUT = {
    "reflection": "--type matte",
    "diffuse-irradiance": "--type metal",
    "horizon": "--fidelity viewer",
}
"""What no fit can do without, and what to say instead."""


def require_choosable(on: Collection[str], off: Collection[str]) -> None:
    """Raises InputError for a name that is no effect's, or one that a fit cannot be given or denied."""
    for option, names in (("--with", on), ("--without", off)):
        for name in names:
            if name not in NAMES:
                raise InputError(option, value=name, expected=f"an effect: {', '.join(BY_NAME)}")
    for name in on:
        if name in off:
            raise InputError("--with", value=name, expected="no effect that --without names as well")
        if name in NOT_WITH:
            raise InputError("--with", value=name, expected=f"another effect: this one takes {NOT_WITH[name]}")
    for name in off:
        if name in NOT_WITHOUT:
            raise InputError("--without", value=name, expected=f"another effect: say {NOT_WITHOUT[name]} instead")


Rule = Callable[[Facts], "str | None"]
"""Why an effect is off, whatever its size; None where it may be seen."""


def _why_off(name: str, facts: Facts) -> str | None:
    return next((why for rule in _RULES[name] if (why := rule(facts)) is not None), None)


def _on(facts: Facts) -> dict[str, str]:
    """Effects that structure alone calls for, if it does not rule them out."""
    sought = {} if facts.found and not facts.blurs else {"blur": "the roughness is sought"}
    if "metal" in facts.kinds:
        sought["exact-fresnel"] = "n and k differ in it alone"
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
    return None if "glossy" in facts.kinds else f"{facts.materials}, of which either body or surface sends out light"


def _unlit(facts: Facts) -> str | None:
    """A diffuse body loses surroundings by ambient occlusion; lights by self-visibility."""
    return None if facts.lights else _nothing_mirrors(facts)


def _not_exact(facts: Facts) -> str | None:
    return None if facts.reflectance == "conductor" else f"{facts.reflectance}'s reflectance was asked for"


def _one_ray(facts: Facts) -> str | None:
    return None if facts.footprint > 1 else "one ray per pixel was asked for"


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
    "normal-map": (_never("none is given"),),
    "color-map": (_never("none is given"),),
    "ambient-occlusion": (_no_body, _convex, _in_thesis("the viewer has none where no map of it is given")),
    "double-bounce": (_never("no ambient-occlusion map is given"),),
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
