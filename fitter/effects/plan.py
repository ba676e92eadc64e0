"""Which effects the photographs of a scene call for: what its structure decides, and what has to be measured."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace

from fit_material.fitter.effects.plan_rules import RULES, Facts
from fit_material.renderer.errors.input_error import InputError
from fit_material.shaders.effects import EFFECTS

_ROUNDING = 1e-6  # relative, of float32's sums


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
        others = sum(EFFECTS[each].cost for each in self.on - {name})
        own = EFFECTS[name].cost
        return own / (own + others) if own else 0.0

    @property
    def avoids(self) -> bool:
        """Whether pixels that the object sends light to are to be left out, since that light is not simulated."""
        paths = (self[rule.name] for rule in RULES.values() if rule.traced)
        return any(each.called_for and not each.on and not each.overruled for each in paths)

    def overruled(self, on: Collection[str], off: Collection[str]) -> Plan:
        """The plan with some effects on or off because somebody wants it so."""

        def decided(each: Decision) -> Decision:
            wanted = (each.name in on and not each.on) or (each.name in off and each.on)
            option = "--with" if each.name in on else "--without"
            why = f"{option} overrules: {each.why}"
            return replace(each, on=not each.on, why=why, overruled=True) if wanted else each

        return replace(self, decisions=tuple(decided(each) for each in self.decisions))

    def with_on(self, name: str, why: str) -> Plan:
        """The plan with an effect on that was simulated after all."""
        decisions = (
            replace(each, on=True, why=f"{why}; {each.why}") if each.name == name else each for each in self.decisions
        )
        return replace(self, decisions=tuple(decisions))

    def changed(self, before: Plan) -> tuple[list[str], list[str]]:
        """The effects that came, and those that went."""
        came, went = self.on - before.on, before.on - self.on
        return [name for name in EFFECTS if name in came], [name for name in EFFECTS if name in went]


@dataclass(frozen=True)
class Change:
    """By how much an effect moves the pixels of a sample, relative to their radiance.

    Attributes:
        most: the largest change of a pixel, over the materials that were tried; of the brighter picture's radiance.
        share: of the pixels, that it moves by more than the tolerance.
        material: with which it moves one most, in words.
        pixels: how many were looked at.
        seen: a further remark, a clause; "" for none.
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
        facts: of the scene's structure.
        measure: by how much each of some effects moves pixels.
        tolerance: relative; what moves a pixel by more is called for.
    """
    off = {name: RULES[name].why_off(facts) for name in EFFECTS}
    on = {name: RULES[name].on(facts) for name in EFFECTS}
    changes = measure([name for name in EFFECTS if off[name] is None and on[name] is None])

    def decided(name: str) -> Decision:
        for decision, why in ((False, off[name]), (True, on[name])):
            if why is not None:
                return Decision(name, decision, why)
        change, wanted = changes[name], changes[name].most > tolerance
        told, possible = change.told(tolerance), not RULES[name].traced or facts.untraced is None
        if wanted and not possible:
            told = f"{told}; but {facts.untraced}: pixels that mirror the object are left out instead"
        return Decision(name, wanted and possible, told, change.most, change.share, wanted)

    return Plan(tuple(map(decided, EFFECTS)), tolerance)


def require_choosable(on: Collection[str], off: Collection[str]) -> None:
    """Raises InputError for a name that is no effect's, or one that a fit cannot be given or denied."""
    for option, names in (("--with", on), ("--without", off)):
        for name in names:
            if name not in EFFECTS:
                raise InputError(option, value=name, expected=f"an effect: {', '.join(EFFECTS)}")
    for name in on:
        if name in off:
            raise InputError("--with", value=name, expected="no effect that --without names as well")
        if (takes := RULES[name].not_with) is not None:
            raise InputError("--with", value=name, expected=f"another effect: this one takes {takes}")
    for name in off:
        if (instead := RULES[name].not_without) is not None:
            raise InputError("--without", value=name, expected=f"another effect: say {instead} instead")
