"""What synthetic photographs are truly of: materials as plain numbers, checked. Light to import."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal, Self, get_args

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.materials.bsdf import Bsdf, Channels, Distribution, conductor, diffuse, plastic
from fit_material.renderer.materials.catalogue import metal as known_metal
from fit_material.shaders.materials.kinds import GLOSSY, MATTE, METAL, OfKind
from fit_material.shaders.materials.quantities import ALPHA, INDEX, ROUGHNESS
from fit_material.shaders.registry.registry import Registry

ShadingModel = Literal["mitsuba", "viewer"]

LEAST_ALPHA = 0.001  # Mitsuba's microfacets lose their digits below; 0 is another model, a mirror
LEAST_REFLECTANCE, MOST_REFLECTANCE = 1e-6, 0.99  # an index in float32 that is neither 1 nor beyond all bounds
MOST_SMOOTH_REFLECTANCE = 0.18


class TrueMaterial(OfKind, ABC):
    """A material as plain numbers.

    Attributes:
        alpha: Mitsuba's microfacet width; None where it has none, or where `roughness` is given.
        roughness: the viewer's blur radius ρ; None where it has none, or where `alpha` is given.
        distribution: of the microfacets' normals; None where there are none.
    """

    alpha: float | None
    roughness: float | None
    distribution: Distribution | None

    @classmethod
    def options(cls) -> tuple[str, ...]:
        """Names of command-line options that describe one."""
        widths = (ALPHA, ROUGHNESS) if cls.kind.mirrors else ()
        return tuple(quantity.name for quantity in (*cls.kind.stored, *widths))

    @classmethod
    @abstractmethod
    def of_options(cls, given: Mapping[str, Any], distribution: Distribution) -> Self:
        """The material that options describe.

        Raises:
            InputError: too little is given, or a value is out of its range; names the option.
        """

    @staticmethod
    @abstractmethod
    def bsdf(quantity: Callable[[str], Any], alpha: float, distribution: Distribution) -> Bsdf:
        """Mitsuba's BSDF of it.

        Args:
            quantity: computes one of `kind.stored` by its name: `Channels`, or a number where it has one channel.
            alpha, distribution: of its microfacets, where it has any.
        """

    def with_alpha(self, alpha: float) -> Self:
        """The material with a lobe of microfacets of that width; one that mirrors nothing, unchanged."""
        return replace(self, alpha=alpha) if self.mirrors else self  # type: ignore[type-var] — all are dataclasses

    @abstractmethod
    def require_mitsubas(self) -> None:
        """Raises InputError where Mitsuba has no such material."""


@dataclass(frozen=True)
class TrueMetal(TrueMaterial):
    """A metal.

    Attributes:
        n, k: complex refractive index n + ik; n > 0, k >= 0, unitless.
        alpha: Mitsuba's microfacet width, isotropic, 0 for a mirror, else in [0.001, 1]; None with `roughness`.
        roughness: the viewer's blur radius ρ, in [0, 10]; None with `alpha`.
        distribution: of the microfacets' normals, "ggx" or "beckmann".
        metal, source: its name and where n and k come from; empty where they were given as numbers.

    Raises:
        InputError: a value is out of its range; names the command-line option.
    """

    n: Channels
    k: Channels
    alpha: float | None = None
    roughness: float | None = None
    distribution: Distribution = "ggx"
    metal: str = ""
    source: str = ""

    kind = METAL

    def __post_init__(self) -> None:
        require("--n", self.n, all(0 < v < math.inf for v in self.n), "three finite numbers > 0")
        require("--k", self.k, all(0 <= v < math.inf for v in self.k), "three finite numbers >= 0")
        _require_finish(self)

    @classmethod
    def options(cls) -> tuple[str, ...]:
        """Those of its quantities, and the name of a metal in the place of n and k."""
        return (METAL.name, *super().options())

    @classmethod
    def of_options(cls, given: Mapping[str, Any], distribution: Distribution) -> TrueMetal:
        finish: dict[str, Any] = {quantity.name: given.get(quantity.name) for quantity in (ALPHA, ROUGHNESS)}
        return TrueMetal(**_indices(given), **finish, distribution=distribution)

    @staticmethod
    def bsdf(quantity: Callable[[str], Any], alpha: float, distribution: Distribution) -> Bsdf:
        return conductor(quantity("n"), quantity("k"), alpha, distribution)

    def require_mitsubas(self) -> None:
        """Mitsuba has all metals."""


@dataclass(frozen=True)
class TrueGlossy(TrueMaterial):
    """A dielectric: a diffuse body under a reflecting surface.

    Attributes:
        color: of the body, in [0, 1].
        reflectance: of the surface at normal incidence, in [0, 1]; Mitsuba's are the same in all channels.
        alpha, roughness, distribution: as a `TrueMetal`'s.

    Raises:
        InputError: as a `TrueMetal`.
    """

    color: Channels
    reflectance: Channels
    alpha: float | None = None
    roughness: float | None = None
    distribution: Distribution = "ggx"

    kind = GLOSSY

    def __post_init__(self) -> None:
        _require_shares(self)
        _require_finish(self)

    @classmethod
    def of_options(cls, given: Mapping[str, Any], distribution: Distribution) -> TrueGlossy:
        _require_given(given, cls.name, "color", "reflectance")
        return TrueGlossy(**given, distribution=distribution)

    @staticmethod
    def bsdf(quantity: Callable[[str], Any], alpha: float, distribution: Distribution) -> Bsdf:
        return plastic(quantity("color"), quantity("reflectance")[0], alpha, distribution)

    def require_mitsubas(self) -> None:
        """Raises InputError where Mitsuba has no such surface."""
        found, option = self.reflectance, "--reflectance"
        same = len(set(found)) == 1
        require(option, found, same, "three equal numbers: Mitsuba's plastic has one index; --model viewer has three")
        inside = LEAST_REFLECTANCE <= found[0] <= MOST_REFLECTANCE
        expected = f"{LEAST_REFLECTANCE:g} to {MOST_REFLECTANCE:g}, of which Mitsuba makes an index"
        require(option, found, inside, expected)
        # Mitsuba's `plastic` takes its inner reflectance from a polynomial: by it a white body gives back 1.03 of what
        # it receives at F0 = 0.17 (diamond), 1.04 at 0.18, 1.07 at 0.2, and less than nothing at 0.35
        inside = self.alpha != 0 or found[0] <= MOST_SMOOTH_REFLECTANCE
        expected = f"at most {MOST_SMOOTH_REFLECTANCE} beside --alpha 0: Mitsuba's plastic errs above"
        require(option, found, inside, expected)


@dataclass(frozen=True)
class TrueMatte(TrueMaterial):
    """A surface without reflections.

    Attributes:
        color: in [0, 1].
        reflectance: how much of it is seen from the front, in [0, 1]; Mitsuba's have 1, which is Lambertian.
        alpha, roughness, distribution: none.

    Raises:
        InputError: as a `TrueMetal`.
    """

    color: Channels
    reflectance: Channels = (1.0, 1.0, 1.0)

    kind = MATTE
    alpha: ClassVar[None] = None
    roughness: ClassVar[None] = None
    distribution: ClassVar[None] = None

    def __post_init__(self) -> None:
        _require_shares(self)

    @classmethod
    def of_options(cls, given: Mapping[str, Any], distribution: Distribution) -> TrueMatte:
        _require_given(given, cls.name, "color")
        return TrueMatte(**given)

    @staticmethod
    def bsdf(quantity: Callable[[str], Any], alpha: float, distribution: Distribution) -> Bsdf:
        return diffuse(quantity("color"))

    def require_mitsubas(self) -> None:
        """Raises InputError where Mitsuba has no such body."""
        expected = "none: Mitsuba's matte is Lambertian; --model viewer has others"
        require("--reflectance", self.reflectance, set(self.reflectance) == {1.0}, expected)


TRUE_TYPES: Registry[type[TrueMaterial]] = Registry(TrueMetal, TrueGlossy, TrueMatte)
"""All types of material, as plain numbers."""


def require(option: str, value: object, fulfilled: bool, expected: str) -> None:
    """Raises InputError where a command-line option's value is not as expected."""
    if not fulfilled:
        raise InputError(option, value=value, expected=expected)


def require_shadable(material: TrueMaterial, model: ShadingModel) -> None:
    """Whether the material has the numbers that a model shades with, and none that it cannot show.

    Raises:
        InputError: it has not; names the command-line option.
    """
    if material.mirrors:
        wanted, other = (ALPHA, ROUGHNESS) if model == "mitsuba" else (ROUGHNESS, ALPHA)
        _require_one(material, wanted.name, other.name, model)
    if model == "mitsuba":
        material.require_mitsubas()


def _require_one(material: TrueMaterial, wanted: str, other: str, model: str) -> None:
    surplus = getattr(material, other)
    require(f"--{other}", surplus, surplus is None, f"--{wanted}, which is what --model {model} shades with")
    missing = getattr(material, wanted) is None
    require(f"--{wanted}", "", not missing, f"a number here: a {material.type} surface of --model {model} has one")


def _indices(given: Mapping[str, Any]) -> dict[str, Any]:
    """n, k and where they come from."""
    found = [key for key in (METAL.name, *INDEX) if key in given]
    if "n" not in given and "k" not in given and found:
        known = known_metal(given["metal"])
        return {**{key: getattr(known, key) for key in INDEX}, "metal": known.name, "source": known.source}
    told = " and ".join(found) or "without a metal"
    require("--metal", told, found == [*INDEX], "either a metal's name, or n and k")
    return {key: given[key] for key in INDEX}


def _require_given(given: Mapping[str, Any], kind: str, *keys: str) -> None:
    for key in keys:
        require(f"--{key}", "", key in given, f"three numbers here: a {kind} material has a {key}")


def _require_shares(material: TrueGlossy | TrueMatte) -> None:
    for option, value in (("--color", material.color), ("--reflectance", material.reflectance)):
        require(option, value, all(0 <= v <= 1 for v in value), "three numbers from 0 to 1")


def _require_finish(material: TrueMetal | TrueGlossy) -> None:
    alpha, roughness = material.alpha, material.roughness
    inside = alpha is None or alpha == 0 or LEAST_ALPHA <= alpha <= 1
    require("--alpha", alpha, inside, "at least 0.001 (all but a mirror), at most 1, or 0 for a mirror")
    require("--roughness", roughness, roughness is None or 0 <= roughness <= 10, "0 (a mirror) to 10")
    known = get_args(Distribution)
    require("--distribution", material.distribution, material.distribution in known, " or ".join(known))
