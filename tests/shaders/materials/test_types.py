"""The materials' words: type codes, and what is derived from n and k."""

import dataclasses

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fit_material.shaders.materials.types import TYPE_CODES, Glossy, Matte, Metal
from fit_material.shaders.optics import fresnel


def float64(value) -> torch.Tensor:
    return torch.as_tensor(value, dtype=torch.float64)


def test_type_codes_are_the_theses_and_cannot_be_changed_by_accident():
    assert dict(TYPE_CODES) == {"matte": 0, "glossy": 1, "metal": 2}  # [thesis, table 3.1; MODEL.md 5]
    assert {kind.type for kind in (Matte, Glossy, Metal)} == TYPE_CODES.keys()
    with pytest.raises(TypeError):
        TYPE_CODES["matte"] = 3  # type: ignore[index]


def test_parameters_are_named_as_the_files_name_them():
    named = {kind.type: [field.name for field in dataclasses.fields(kind)] for kind in (Metal, Glossy, Matte)}
    assert named == {
        "metal": ["n", "k", "roughness"],
        "glossy": ["color", "reflectance", "roughness"],
        "matte": ["color", "reflectance"],
    }


@given(st.floats(1e-3, 50), st.floats(0, 50))
def test_f0_is_the_reflectance_seen_straight_on(n, k):
    metal = Metal(float64([n] * 3), float64([k] * 3), float64(0.1))
    assert metal.f0.tolist() == pytest.approx([abs((n + 1j * k - 1) / (n + 1j * k + 1)) ** 2] * 3, rel=1e-9, abs=1e-15)
    for reflectance in (fresnel.lazanyi, fresnel.conductor):
        torch.testing.assert_close(reflectance(float64(1.0), metal.n, metal.k), metal.f0, rtol=1e-9, atol=1e-15)
