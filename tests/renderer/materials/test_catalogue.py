"""The catalogue against reflectances that its source computed, and its answers to wrong names."""

import subprocess
import sys

import pytest

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.materials.catalogue import metal, read_catalogue

# Reflectance at normal incidence as tabulated beside n and k in the table that metals.csv was copied from.
F0 = {
    "Au": (0.958517, 0.771609, 0.386668),
    "Ag": (0.988154, 0.983213, 0.979053),
    "Cu": (0.915304, 0.601967, 0.54991),
    "Al": (0.908133, 0.916496, 0.920683),
    "Fe": (0.528694, 0.511078, 0.499843),
    "Ni": (0.690312, 0.633525, 0.583125),
    "Cr": (0.640432, 0.653522, 0.661634),
    "Ti": (0.611683, 0.575012, 0.548521),
    "W": (0.503754, 0.49486, 0.481255),
    "Pt": (0.67283, 0.63398, 0.597561),
    "Zn": (0.874297, 0.867561, 0.859117),
    "Co": (0.679877, 0.651301, 0.626166),
    "Hg": (0.781477, 0.779265, 0.778918),
    "TiN": (0.587277, 0.439192, 0.280206),
    "CuZn30": (0.877178, 0.751796, 0.493394),
    "CuZn15": (0.858958, 0.683117, 0.481567),
    "CuZn10": (0.892505, 0.670147, 0.516378),
}


def test_every_metal_has_a_tabulated_reflectance():
    assert {entry.name for entry in read_catalogue()} == set(F0)
    assert len(F0) >= 12


@pytest.mark.parametrize("name", F0)
def test_closed_form_reproduces_the_tabulated_reflectance(name):
    entry = metal(name)
    computed = [((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2) for n, k in zip(entry.n, entry.k, strict=True)]
    # n and k carry six digits; F0 cannot be off by more than half a unit in its own sixth and a few in theirs
    assert computed == pytest.approx(F0[name], abs=2e-6)


def test_every_row_says_where_it_comes_from():
    for entry in read_catalogue():
        assert entry.wavelengths == (630, 532, 465)
        assert entry.source.endswith("(CC0)")


@pytest.mark.parametrize("name", ["Au", "au", "gold", "Gold", " GOLD "])
def test_a_metal_answers_to_symbol_and_common_name(name):
    assert metal(name).name == "Au"


def test_names_and_titles_are_unambiguous():
    keys = [key.lower() for entry in read_catalogue() for key in {entry.name, entry.title}]
    assert len(keys) == len(set(keys))


def test_a_misspelt_metal_is_told_the_nearest_name():
    with pytest.raises(InputError, match=r"--metal: is 'goldd', expected a known metal, such as Au \(gold\)"):
        metal("goldd")


def test_a_hopeless_name_is_told_all_symbols():
    with pytest.raises(InputError, match=r"expected a known metal, such as Au, Ag, Cu, .*CuZn10"):
        metal("xyzzy")


def test_the_catalogue_needs_no_heavy_import():
    code = (
        "import sys, fit_material.renderer.materials.catalogue; print({'torch', 'jax', 'mitsuba'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
