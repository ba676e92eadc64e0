"""What accuracy to pay for: one small value, with the presets of the command line, changed choice by choice."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, cast

from fit_material.renderer.errors.input_error import InputError

if TYPE_CHECKING:
    from fit_material.shaders.optics.microfacets import Distribution

Reflectance = Literal["conductor", "lazanyi", "schlick"]
Lobe = Literal["ggx", "beckmann", "gaussian", "taps"]
Dtype = Literal["float32", "float64"]

MICROFACET_RANGE = (0.005, 1.2)  # alpha: from what no pixel of a photograph resolves to beyond any metal's finish
BLUR_RANGE = (1e-3, 2.0)  # ρ: below, the taps lie within a texel; at 2 they already span ± 63°
TAPS = 49
NAMED = {"pixels": (100, 10_000_000), "levels": (3, 32), "environment_size": (16, 32768)}
"""What numbers the command line may name; samples have a rule of their own."""
MOST_SAMPLES = 2**16
GAUSSIAN_PIXELS = 12000  # at most by themselves: no compiled kernel has this lobe


@dataclass(frozen=True)
class Fidelity:
    """One choice for each question that the model answers at several prices [MODEL.md 6].

    Attributes:
        name: of the preset it came from, and what was changed.
        reflectance: of metals: "conductor" (exact), "lazanyi" (the thesis's) or "schlick"; the last two see F0 only.
        lobe: microfacet distribution, "taps" for the thesis's blur, or "gaussian" for what that blur converges to.
        samples: directions per pixel and roughness level in the final table, a multiple of 4; 49 for taps.
        search_samples: the same while the roughness is still unknown.
        pixels: how many are fitted, over all photographs.
        search_pixels: how many of them while the roughness is still unknown.
        footprint: rays along each side of a pixel.
        search_levels, levels: roughness levels over the whole range, and around the roughness found.
        degree: functions in the reflectance basis.
        spans: factors around the roughness found, both ways, that the tables after the search span in turn; all but
            the last are of the search's pixels. The 49 taps step over texels and so depend on ρ without smoothness:
            their last span has to be a narrow one.
        environment_size: columns of the environment map, even; 0 for as many as the file has.
        dtype: of the light tables: of directions, lookups and sums. What is evaluated from them is float64 always:
            it takes no time, and least squares need the digits.
    """

    name: str
    reflectance: Reflectance
    lobe: Lobe
    samples: int
    search_samples: int
    pixels: int
    search_pixels: int
    footprint: int
    search_levels: int
    levels: int
    degree: int
    spans: tuple[float, ...]
    environment_size: int = 0
    dtype: Dtype = "float32"

    @property
    def blurs(self) -> bool:
        """Whether the lobe is a blur by the viewer's ρ, and not one of microfacets."""
        return self.lobe in ("taps", "gaussian")

    @property
    def distribution(self) -> Distribution:
        """Of the microfacets; only of a lobe that has them."""
        assert not self.blurs
        return cast("Distribution", self.lobe)

    def reflectance_of(self, kind: str) -> str:
        """The formula of the reflectance of one type of material."""
        from fit_material.shaders.materials.types import TYPES

        return TYPES[kind].reflectance_formula(self.reflectance, microfacets=not self.blurs)


PRESETS = {
    each.name: each
    for each in (
        Fidelity(
            name="viewer",
            reflectance="lazanyi",
            lobe="taps",
            samples=TAPS,
            search_samples=TAPS,
            pixels=4000,
            search_pixels=4000,
            footprint=1,
            search_levels=24,
            levels=9,
            degree=6,
            spans=(1.25, 1.05, 1.005),
        ),
        Fidelity(
            name="preview",
            reflectance="conductor",
            lobe="ggx",
            samples=256,
            search_samples=64,
            pixels=3000,
            search_pixels=1000,
            footprint=2,
            search_levels=12,
            levels=5,
            degree=12,
            spans=(1.3, 1.1),
        ),
        Fidelity(
            name="standard",
            reflectance="conductor",
            lobe="ggx",
            samples=3072,
            search_samples=64,
            pixels=40_000,
            search_pixels=1500,
            footprint=4,
            search_levels=12,
            levels=3,
            degree=12,
            spans=(1.3, 1.05),
        ),
        Fidelity(
            name="reference",
            reflectance="conductor",
            lobe="ggx",
            samples=8192,
            search_samples=128,
            pixels=100_000,
            search_pixels=4000,
            footprint=7,
            search_levels=14,
            levels=5,
            degree=16,
            spans=(1.3, 1.1),
        ),
    )
}


def preset(name: str, distribution: Distribution = "ggx") -> Fidelity:
    """A preset of `PRESETS`, for surfaces with the given microfacets; the viewer's model has none."""
    found = PRESETS[name]
    return found if found.blurs else replace(found, lobe=distribution)


def fidelity_of(
    name: str,
    *,
    reflectance: Reflectance | None = None,
    lobe: Lobe | None = None,
    samples: int | None = None,
    pixels: int | None = None,
    levels: int | None = None,
    environment_size: int | None = None,
    dtype: Dtype | None = None,
) -> Fidelity:
    """A preset with some of its choices made otherwise, each by the command line's option of that name.

    Raises:
        InputError: a number is out of range, or choices do not go together; names the option.
    """
    numbers = {"pixels": pixels, "levels": levels, "environment_size": environment_size}
    choices = {"reflectance": reflectance, "lobe": lobe, "samples": samples, **numbers, "dtype": dtype}
    for key, value in numbers.items():
        _require_in_range(key, value)
    found = PRESETS[name] if lobe is None else _with_lobe(PRESETS[name], lobe)
    _require_samples(samples, found.lobe)
    of_preset = PRESETS[name]
    changed = {key: value for key, value in choices.items() if value is not None and value != getattr(of_preset, key)}
    if samples is not None:
        found = replace(found, search_samples=min(found.search_samples, samples))
    if not changed:
        return found
    told = ", ".join(f"{key.replace('_', ' ')} {value}" for key, value in changed.items())
    return replace(found, **changed, name=f"{name}, {told}")


def _with_lobe(fidelity: Fidelity, lobe: Lobe) -> Fidelity:
    """The fidelity with a lobe and the tables that this lobe needs; pixels and reflectance stay."""
    like = PRESETS["viewer" if lobe in ("taps", "gaussian") else "standard"]
    if fidelity.blurs != like.blurs:
        keys = ("samples", "search_samples", "footprint", "search_levels", "levels", "degree", "spans")
        fidelity = replace(fidelity, **{key: getattr(like, key) for key in keys})
    if lobe == "gaussian":
        converged = {"samples": 512, "search_samples": 64, "search_levels": 12, "levels": 5, "spans": (1.3, 1.1)}
        fidelity = replace(fidelity, **converged, pixels=min(fidelity.pixels, GAUSSIAN_PIXELS))
    return replace(fidelity, lobe=lobe)


def _require_in_range(key: str, value: int | None) -> None:
    if value is None or (key == "environment_size" and value == 0):
        return
    low, high = NAMED[key]
    even = key != "environment_size" or value % 2 == 0
    if not (low <= value <= high and even):
        kind = "0 for the map as it is, or an even number" if key == "environment_size" else "a whole number"
        raise InputError(f"--{key.replace('_', '-')}", value=value, expected=f"{kind} from {low} to {high}")


def _require_samples(samples: int | None, lobe: Lobe) -> None:
    if samples is None:
        return
    if lobe == "taps":
        expected = f"no --samples: the thesis's blur has {TAPS} directions; --lobe gaussian has any number of them"
        raise InputError("--samples", value=samples, expected=expected)
    if samples % 4 or not 16 <= samples <= MOST_SAMPLES:
        raise InputError("--samples", value=samples, expected=f"a multiple of 4 from 16 to {MOST_SAMPLES}")
