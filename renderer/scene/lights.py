"""`[[lights]]` of the scene file: which types there are, and each as the shading model takes it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import torch
from pydantic import AfterValidator, Field, PlainValidator, SerializeAsAny, Strict, ValidationInfo

from fit_material.renderer.files.validation import (
    MISSING,
    UNSHOWN,
    Checked,
    Vector,
    check,
    check_within,
    one_of,
    unexpected,
)
from fit_material.renderer.scene.fittable_values import LARGEST
from fit_material.shaders.lights import DirectionalLight, Light
from fit_material.shaders.registry.registry import Registry


class LightSpec(Checked):
    """`[[lights]]`, of whichever type; `LIGHTS` has the schema of each."""

    type: str


def _nonzero(direction: tuple[float, float, float]) -> tuple[float, float, float]:
    if not any(direction):
        raise unexpected("a direction that is not zero")
    return direction


Power = Annotated[float, Field(ge=0, le=LARGEST)]
Powers = Annotated[tuple[Power, Power, Power], Strict(False)]
"""Irradiance, radiance or intensity, per channel."""


class DirectionalLightSpec(LightSpec):
    """`type = "directional"`: direction towards the light, and its irradiance on a surface that faces it."""

    direction: Annotated[Vector, AfterValidator(_nonzero)]
    irradiance: Powers


def directional_light(spec: DirectionalLightSpec) -> DirectionalLight:
    """A directional light of the scene file as the shading model takes it.

    The file gives the irradiance on a surface that faces the light; the model's E is that irradiance over π, so that
    a white Lambertian surface sends out E · max(0, n·l), as it physically does.
    """
    towards = torch.tensor(spec.direction, dtype=torch.float64)
    towards = towards / towards.abs().max()  # whose square neither overflows nor vanishes
    return DirectionalLight(
        torch.nn.functional.normalize(towards, dim=0), torch.tensor(spec.irradiance, dtype=torch.float64) / math.pi
    )


@dataclass(frozen=True)
class LightKind:
    """A type of light that scene files may have.

    Attributes:
        name: its `type`, and the `kind` of its `Light`.
        spec: its table in the scene file.
        light: from that table to the light as the shading model takes it.
    """

    name: str
    spec: type[LightSpec]
    light: Callable[[Any], Light]


LIGHTS = Registry(LightKind("directional", DirectionalLightSpec, directional_light))


def light_of(spec: LightSpec) -> Light:
    """A light of the scene file as the shading model takes it."""
    return LIGHTS[spec.type].light(spec)


def _by_type(data: Any, info: ValidationInfo) -> LightSpec:
    """A table by the schema of its type, which the registry has at the time of reading."""
    if isinstance(data, LightSpec):
        return data
    if not isinstance(data, dict):
        return check_within(LightSpec, data, info)  # which reports that it should be a table
    if "type" not in data:
        raise unexpected(MISSING, key="type", value=UNSHOWN)
    kind = data["type"]
    if not isinstance(kind, str) or kind not in LIGHTS:
        raise unexpected(one_of(LIGHTS), key="type", value=kind)
    return check_within(LIGHTS[kind].spec, data, info)


AnyLightSpec = Annotated[SerializeAsAny[LightSpec], PlainValidator(_by_type)]


def light_option(values: Sequence[float]) -> DirectionalLightSpec:
    """The light of a command line's `--light X Y Z R G B`: towards it, and its irradiance.

    Raises:
        InputError: the direction is zero, or a number not finite, negative or above `LARGEST`.
    """
    table = {"type": "directional", "direction": tuple(values[:3]), "irradiance": tuple(values[3:])}
    return check(DirectionalLightSpec, table, Path("--light"))
