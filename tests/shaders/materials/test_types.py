"""The materials' words: type codes, and what is derived from n and k."""

import dataclasses

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fit_material.shaders.materials.kinds import type_codes
from fit_material.shaders.materials.types import Glossy, Matte, Metal
from fit_material.shaders.materials.widths import Blur, Microfacet
from fit_material.shaders.optics import fresnel


def float64(value) -> torch.Tensor:
    return torch.as_tensor(value, dtype=torch.float64)


def test_type_codes_are_the_theses():
    assert type_codes() == {"matte": 0, "glossy": 1, "metal": 2}  # [thesis, table 3.1; MODEL.md 5]
    assert {kind.name for kind in (Matte, Glossy, Metal)} == type_codes().keys()


def test_parameters_are_named_as_the_files_name_them():
    named = {kind.name: [field.name for field in dataclasses.fields(kind)] for kind in (Metal, Glossy, Matte)}
    assert named == {
        "metal": ["n", "k", "width"],
        "glossy": ["color", "reflectance", "width"],
        "matte": ["color", "reflectance"],
    }
    assert (Microfacet.quantity.name, Blur.quantity.name) == ("alpha", "roughness")


@given(st.floats(1e-3, 50), st.floats(0, 50))
def test_f0_is_the_reflectance_seen_straight_on(n, k):
    metal = Metal(float64([n] * 3), float64([k] * 3), Microfacet(float64(0.1)))
    assert metal.f0.tolist() == pytest.approx([abs((n + 1j * k - 1) / (n + 1j * k + 1)) ** 2] * 3, rel=1e-9, abs=1e-15)
    for reflectance in (fresnel.lazanyi, fresnel.conductor):
        torch.testing.assert_close(reflectance(float64(1.0), metal.n, metal.k), metal.f0, rtol=1e-9, atol=1e-15)
