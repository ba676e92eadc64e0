"""What the options of several commands may be, by name."""

from __future__ import annotations

import enum


class FidelityName(enum.StrEnum):
    viewer = "viewer"
    preview = "preview"
    standard = "standard"
    reference = "reference"


class SolverName(enum.StrEnum):
    lm = "lm"
    adam = "adam"
    lbfgs = "lbfgs"


class TypeName(enum.StrEnum):
    auto = "auto"
    metal = "metal"
    glossy = "glossy"
    matte = "matte"


class PriorName(enum.StrEnum):
    none = "none"
    catalogue = "catalogue"


class MapName(enum.StrEnum):
    color = "color"


class ModelName(enum.StrEnum):
    mitsuba = "mitsuba"
    viewer = "viewer"


class LobeName(enum.StrEnum):
    ggx = "ggx"
    beckmann = "beckmann"


class FittedLobeName(enum.StrEnum):
    ggx = "ggx"
    beckmann = "beckmann"
    gaussian = "gaussian"
    taps = "taps"


class ReflectanceName(enum.StrEnum):
    conductor = "conductor"
    lazanyi = "lazanyi"
    schlick = "schlick"


class DtypeName(enum.StrEnum):
    float32 = "float32"
    float64 = "float64"
