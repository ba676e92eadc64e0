"""Random small scenes from files to files: few here, more in `make stress`."""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from fit_material.fitter.options.fidelity import PRESETS
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.fitter.pipeline.fit_scene import fit_scene
from fit_material.renderer.errors.input_error import InputError
from fit_material.shaders.materials.types import Glossy, Matte, Metal
from fit_material.shaders.materials.widths import Microfacet
from tests.support.modelled import Modelled, written

FEWEST = replace(
    PRESETS["preview"], pixels=100, search_pixels=60, samples=32, search_samples=16, footprint=1, search_levels=6
)
CONVEX = ("self-visibility", "ambient-occlusion", "interreflection")  # what no ball needs, and what takes long to see

shares = st.floats(0, 1) | st.sampled_from((0.0, 1.0))
threes = st.tuples(shares, shares, shares)
widths = st.floats(-2.2, 0).map(lambda power: 10**power)
powers = st.floats(-3, 4).map(lambda power: 10**power)
texels = st.lists(powers | st.sampled_from((0.0, 1e-3, 1e9)), min_size=32, max_size=32).filter(any)


def float64(values: Any) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


metals = st.builds(
    lambda n, k, alpha: Metal(float64(n), float64(k), Microfacet(float64(alpha))),
    st.tuples(*[st.floats(0.05, 5)] * 3),
    st.tuples(*[st.floats(0, 8)] * 3),
    widths,
)
glossies = st.builds(
    lambda color, f, alpha: Glossy(float64(color), float64(f).clamp_max(0.2), Microfacet(float64(alpha))),
    threes,
    threes,
    widths,
)
mattes = st.builds(lambda color: Matte(float64(color), float64((1.0, 1.0, 1.0))), threes)
scenes = st.builds(
    lambda materials, texels, azimuths, size, noise, seed: Modelled(
        {f"m{i}": material for i, material in enumerate(materials)},
        np.tile(np.array(texels, np.float32).reshape(4, 8, 1), 3),
        tuple(azimuths),
        size=size,
        noise=noise,
        seed=seed,
    ),
    st.lists(metals | glossies | mattes, min_size=1, max_size=2),
    texels,
    st.lists(st.integers(0, 359).map(float), min_size=1, max_size=2, unique=True),
    st.integers(1, 12),
    st.sampled_from((0.0, 0.01, 1.0)),
    st.integers(0, 1000),
)


def refused(scene_file: Path, out: Path, options: FitOptions) -> str | None:
    """The sentence by which a scene is not fitted; None of one that is."""
    try:
        fit_scene(scene_file, out, options)
    except InputError as refusal:
        return str(refusal)
    return None


def only_numbers_of_json(word: str) -> float:
    raise AssertionError(f"{word} in result.json")


def numbers_in(nested: Any) -> Iterator[float]:
    if isinstance(nested, dict | list):
        for each in nested.values() if isinstance(nested, dict) else nested:
            yield from numbers_in(each)
    elif isinstance(nested, int | float) and not isinstance(nested, bool):
        yield nested


def per_number(nested: Any) -> list[Any]:
    """A number of each channel, or the one there is."""
    return nested if isinstance(nested, list) else [nested]


def assert_honest(material: dict) -> None:
    """What is called determined has an error and an interval around it, and all stays in its domain."""
    for key, verdicts in material["determined"].items():
        if verdicts is None:
            continue
        intervals = material["interval95"][key]
        intervals = intervals if isinstance(verdicts, list) else [intervals]
        told = zip(*(per_number(each) for each in (material[key], material["stderr"][key], verdicts)), strict=True)
        for (value, error, determined), interval in zip(told, intervals, strict=True):
            assert value >= 0
            if determined:
                assert error is not None
                low, high = interval
                assert low <= value <= high
    for key in ("f0", "color", "reflectance"):
        assert all(0 <= share <= 1 for share in material[key] or ())


@given(scenes, st.sampled_from(("auto", "metal", "glossy", "matte")))
@settings(max_examples=max(4, settings().max_examples // 25))
def test_random_scenes_end_in_a_result_or_a_sentence(scene: Modelled, kind: str):
    """Suns, black texels, one pixel, noise as large as the light, any type asked for of any other."""
    with tempfile.TemporaryDirectory() as folder:
        scene_file, out = written(scene, Path(folder)), Path(folder) / "out"
        refusal = refused(scene_file, out, FitOptions(FEWEST, type=kind, unwanted=CONVEX))
        if refusal is not None:
            assert "\n" not in refusal
            assert not out.exists() or not any(out.iterdir())
            return
        result = json.loads((out / "result.json").read_text("utf-8"), parse_constant=only_numbers_of_json)
    assert all(math.isfinite(number) for number in numbers_in(result))
    assert result["message"]
    for material in result["materials"]:
        assert_honest(material)
    if result["status"] == "converged":
        known = [m["determined"]["color" if m["type"] == "matte" else "f0"] for m in result["materials"]]
        assert all(all(channels) for channels in known)
