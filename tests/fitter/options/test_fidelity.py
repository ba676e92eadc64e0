"""The ladder's choices: what is named replaces what the preset says, and nothing else."""

from __future__ import annotations

from dataclasses import asdict

import pytest

from fit_material.fitter.options.fidelity import PRESETS, fidelity_of
from fit_material.renderer.errors.input_error import InputError


def changed(name: str, **choices) -> set[str]:
    """Which of a preset's fields the choices change."""
    before, after = asdict(PRESETS[name]), asdict(fidelity_of(name, **choices))
    return {key for key in before if before[key] != after[key]}


@pytest.mark.parametrize("name", PRESETS)
def test_nothing_named_is_the_preset(name):
    assert fidelity_of(name) == PRESETS[name]


@pytest.mark.parametrize(
    "choice",
    [
        {"samples": 1024},
        {"pixels": 777},
        {"levels": 9},
        {"environment_size": 128},
        {"dtype": "float64"},
        {"reflectance": "schlick"},
        {"lobe": "beckmann"},
    ],
)
def test_one_choice_changes_one_field_and_the_name(choice):
    assert changed("standard", **choice) == {*choice, "name"}
    ((key, value),) = choice.items()
    assert getattr(fidelity_of("standard", **choice), key) == value


def test_the_search_never_has_more_samples_than_the_end():
    assert fidelity_of("standard", samples=16).search_samples == 16


def test_a_name_tells_what_was_changed():
    found = fidelity_of("preview", samples=512, environment_size=64)
    assert found.name == "preview, samples 512, environment size 64"


def test_the_taps_come_with_the_tables_they_need():
    found, viewer = fidelity_of("standard", lobe="taps"), PRESETS["viewer"]
    assert (found.samples, found.footprint, found.spans) == (49, 1, viewer.spans)
    assert (found.reflectance, found.pixels) == ("conductor", PRESETS["standard"].pixels)


def test_microfacets_in_the_viewers_place_come_with_theirs():
    found = fidelity_of("viewer", lobe="ggx")
    assert (found.samples, found.footprint) == (PRESETS["standard"].samples, PRESETS["standard"].footprint)
    assert found.reflectance == "lazanyi"


@pytest.mark.parametrize(
    ("choices", "sentence"),
    [
        ({"samples": 50}, "--samples: is 50, expected a multiple of 4 from 16 to 65536"),
        ({"samples": 12}, "--samples: is 12, expected a multiple of 4 from 16 to 65536"),
        ({"pixels": 99}, "--pixels: is 99, expected a whole number from 100 to 10000000"),
        ({"levels": 2}, "--levels: is 2, expected a whole number from 3 to 32"),
        (
            {"environment_size": 33},
            "--environment-size: is 33, expected 0 for the map as it is, or an even number from 16 to 32768",
        ),
        (
            {"lobe": "taps", "samples": 64},
            "--samples: is 64, expected no --samples: the thesis's blur has 49 directions; --lobe gaussian has any"
            " number of them",
        ),
    ],
)
def test_slips_are_told_in_a_sentence(choices, sentence):
    with pytest.raises(InputError) as told:
        fidelity_of("standard", **choices)
    assert str(told.value) == sentence
