"""MTL files against what MODEL.md, 5, says that they mean, and against the corpus of other readers' tests."""

import itertools
import math
import re
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import example, given
from hypothesis import strategies as st

from fit_material.fitter.export.mtl import ordinary_mtl, thesis_mtl
from fit_material.fitter.result.schema import FittedMaterial
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.materials.mtl_reader import Library, read_mtl
from fit_material.renderer.materials.mtl_syntax import written_names
from fit_material.shaders.materials.types import Glossy, Material, Matte, Metal

METAL = "newmtl a\nNs 2\nKa 3.5 2.3 1.9\nKd 0.15 0.43 1.4\nKs 0.25 0.25 0.25\n"
GLOSSY = "newmtl a\nNs 1\nKa 0.04 0.05 0.06\nKd 0.5 0.25 0.125\nKs 0.25 0.25 0.25\n"
MATTE = "newmtl a\nNs 0\nKa 1 0.5 0.25\nKd 0.5 0.25 0.125\nKs 0 0 0\n"


@pytest.fixture
def only(mtl):
    """The only material of a text."""

    def read(text, **options) -> Material:
        (appearance,) = mtl(text, **options).appearances.values()
        return appearance.material

    return read


def numbers(material: Material) -> dict[str, list[float] | float]:
    return {name: value.tolist() for name, value in material.numbers.items()}


def float32(*values):
    return [float(np.float32(value)) for value in values]


def test_table_of_the_thesis(mtl):
    (metal,) = mtl(METAL).appearances.values()
    assert isinstance(metal.material, Metal)
    assert numbers(metal.material) == {"n": float32(0.15, 0.43, 1.4), "k": float32(3.5, 2.3, 1.9), "roughness": 0.25}
    (glossy,) = mtl(GLOSSY).appearances.values()
    expected = {"color": [0.5, 0.25, 0.125], "reflectance": float32(0.04, 0.05, 0.06), "roughness": 0.25}
    assert isinstance(glossy.material, Glossy)
    assert numbers(glossy.material) == expected
    (matte,) = mtl(MATTE).appearances.values()
    assert isinstance(matte.material, Matte)
    assert numbers(matte.material) == {"color": [0.5, 0.25, 0.125], "reflectance": [1, 0.5, 0.25]}


@pytest.mark.parametrize("code", ["Ns 7\n", "Ns 1.5\n", "Ns -1\n", ""])
def test_unknown_type_is_matte(only, code):
    assert isinstance(only(MATTE.replace("Ns 0\n", code), dialect="thesis"), Matte)


def test_type_codes_can_be_others(only):
    """Assimp 3.2 multiplies Ns by 4; a table for its files has 4 and 8."""
    codes = {"matte": 0, "glossy": 4, "metal": 8}
    assert isinstance(only(METAL.replace("Ns 2", "Ns 8"), codes=codes), Metal)
    assert isinstance(only(GLOSSY.replace("Ns 1", "Ns 4"), codes=codes), Glossy)


def test_matte_materials_may_be_bare(only):
    assert numbers(only("newmtl a\n", dialect="thesis")) == {"color": float32(0.6, 0.6, 0.6), "reflectance": [1, 1, 1]}


@pytest.mark.parametrize("ending", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_layout_does_no_harm(mtl, encoding, ending):
    text = (
        "# für\n\nKd 9 9 9\n\tNEWMTL\t grün  hell \n  ns 2 # metal\nKA\t3.5 2.3  1.9\n kd .15 +43e-02 1.4# n\nks 1. 1 1"
    )
    text = text.replace("1.4# n", "1.4 # n").replace("\n", ending)
    library = mtl(text.encode(encoding))
    assert list(library.appearances) == ["grün hell"]
    material = library.appearances["grün hell"].material
    assert numbers(material) == {"n": float32(0.15, 0.43, 1.4), "k": float32(3.5, 2.3, 1.9), "roughness": 1}


def test_one_number_is_grey_and_the_last_value_counts(only):
    assert numbers(only(MATTE + "Kd 0.1\nKd 0.25\n"))["color"] == [0.25] * 3


def test_names(mtl):
    text = "newmtl\nKd 1\nnewmtl b # comment\nnewmtl #1\nnewmtl c  d\nnewmtl b\nKd 0.5\n"
    library = mtl(text, dialect="ordinary")
    assert list(library.appearances) == ["default", "#1", "c d", "b"]
    assert numbers(library.appearances["b"].material)["color"] == [0.5] * 3


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("Kd 1 2", "Kd: is 1 2, expected one number or three"),
        ("Kd spectral file.rfl 1.0", r"Kd: is spectral file.rfl 1.0, expected one number or three"),
        ("Ks xyz 1 2 3", "Ks: is xyz 1 2 3, expected one number or three"),
        ("Kd nan 0 0", "Kd: is nan, expected a finite number"),
        ("Ks 1 inf 1", "Ks: is inf, expected a finite number"),
        ("Kd 1.#IND 1 1", r"Kd: is 1\.#IND, expected a finite number"),
        ("Kd 1e39 1 1", r"Kd: is 1e39, expected a finite number of float32's range"),
        ("Kd 1_0 1 1", r"Kd: is 1_0, expected a finite number"),
        ("Kd 0,5 1 1", r"Kd: is 0,5, expected a finite number"),
        ("Ns nan", "Ns: is nan, expected a finite number"),
        ("Ns two", "Ns: is two, expected a finite number"),
    ],
)
@pytest.mark.parametrize("dialect", ["thesis", "ordinary", "auto"])
def test_bad_numbers_are_one_sentence_in_any_dialect(mtl, line, sentence, dialect):
    with pytest.raises(InputError, match=rf"a\.mtl: a: {sentence}"):
        mtl(METAL + line, dialect=dialect)


@pytest.mark.parametrize("line", ["Ka spectral file.rfl 1.0", "Ka nan 0 0", "Tf xyz 1 2 3", "aniso", "Ke"])
def test_ordinary_keys_that_do_not_count_do_no_harm(only, line):
    assert isinstance(only(METAL.replace("Ka 3.5 2.3 1.9", line), dialect="ordinary"), Glossy)


@pytest.mark.parametrize(
    ("text", "line", "sentence"),
    [
        (METAL, "Kd 1 0 1", "Kd: is 1 0 1, expected the metal's n, above 0 and at most 1e+06"),
        (METAL, "Kd 1e-60 1 1", "Kd: is 1e-60 1 1, expected the metal's n, above 0"),
        (METAL, "Kd 1e7", "Kd: is 1e+07 1e+07 1e+07, expected the metal's n, above 0"),
        (METAL, "Ka 1 -0.5 1", "Ka: is 1 -0.5 1, expected the metal's k, in [0, 1e+06]"),
        (METAL, "Kd", "Kd: expected the metal's n, three numbers above 0 and at most 1e+06, but there are none"),
        (METAL, "Ks", "Ks: expected the roughness, three numbers in [0, 1e+06], but there are none"),
        (METAL, "Ks 0.1 0.1 0.2", "expected the roughness, one number thrice"),
        (GLOSSY, "Ks -0.1 -0.1 -0.1", "Ks: is -0.1 -0.1 -0.1, expected the roughness, in [0"),
        (GLOSSY, "Kd 0.5 1.5 0.5", "Kd: is 0.5 1.5 0.5, expected the color, in [0, 1]"),
        (GLOSSY, "Ka", "Ka: expected the reflectance, three numbers in [0, 1], but there are none"),
        (MATTE, "Ka 0.5 2 0.5", "Ka: is 0.5 2 0.5, expected the reflectance, in [0, 1]"),
        (MATTE, "Kd -1", "Kd: is -1 -1 -1, expected the color, in [0, 1]"),
    ],
)
def test_numbers_out_of_the_thesis_s_ranges(mtl, text, line, sentence):
    with pytest.raises(InputError, match=re.escape(sentence)):
        mtl(text + line, dialect="thesis")


def test_a_missing_file_is_one_sentence(tmp_path):
    with pytest.raises(InputError, match=r"none\.mtl: expected an MTL file here"):
        read_mtl(tmp_path / "none.mtl")


@pytest.mark.parametrize(
    ("text", "name", "thesis"),
    [
        (METAL, "a.mtl", True),
        (METAL + "illum 2\n", "a.mtl", False),
        (METAL + "illum 2\n", "a.thesis.mtl", True),
        (METAL + "illum 2\n", "a.Thesis.MTL", True),
        (METAL.replace("Ns 2", "Ns 96"), "a.mtl", False),
        (METAL.replace("Ks 0.25 0.25 0.25", "Ks 0.25 0.25 0.5"), "a.mtl", False),
        (METAL.replace("Ks 0.25 0.25 0.25\n", ""), "a.mtl", False),
        (METAL.replace("Ka 3.5 2.3 1.9\n", ""), "a.mtl", False),
        (METAL + "newmtl b\nKd 1 1 1\n", "a.mtl", False),
        (METAL + "map_Ka ao.png\nmap_Kd c.png\nbump n.png\n", "a.mtl", True),
        (METAL + "map_Ks s.png\n", "a.mtl", False),
    ],
)
def test_dialect_is_told_by_name_and_keys(mtl, text, name, thesis):
    first = next(iter(mtl(text, name).appearances.values())).material
    assert (numbers(first).get("n") == float32(0.15, 0.43, 1.4)) == thesis


@pytest.mark.parametrize(
    ("lines", "kind"),
    [
        ("Pm 1", Metal),
        ("Pm 0.5\nillum 2", Metal),
        ("Pm 0.4\nillum 3\nKd 0\nKs 1", Glossy),
        ("Pm 0\nKs 0", Matte),
        ("illum 3\nKd 0.2 0 0\nKs 0.9 0.8 0.1", Metal),
        ("illum 3\nKd 0.3 0 0\nKs 0.9 0.8 0.1", Glossy),
        ("illum 2\nKd 0\nKs 0.9 0.8 0.1", Glossy),
        ("illum 2\nKs 0.1", Glossy),
        ("Ks 0.1", Glossy),
        ("illum 1\nKs 0.1", Matte),
        ("illum 0\nKs 0.1", Matte),
        ("illum 2\nKs 0 0 0", Matte),
        ("illum 2", Matte),
    ],
)
def test_types_of_ordinary_materials(only, lines, kind):
    assert isinstance(only(f"newmtl a\nKd 0.5 0.5 0.5\n{lines}\n", dialect="ordinary"), kind)


@given(f0=st.lists(st.floats(0, 1, width=32), min_size=3, max_size=3))
def test_ordinary_metals_keep_their_f0(f0):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.mtl"
        path.write_text(f"newmtl a\nPm 1\nKd {f0[0]!r} {f0[1]!r} {f0[2]!r}\n")
        material = read_mtl(path).appearances["a"].material
    assert isinstance(material, Metal)
    assert (material.n > 0).all()
    assert (material.k >= 0).all()
    n, k = material.n.double().numpy(), material.k.double().numpy()
    # F0 = (n²-2n+1 + k²)/(n²+2n+1 + k²): with n and k in [0, 1], rounded by 2⁻²⁵, both sums move by at most 6·2⁻²⁵
    # of a denominator that is at least 1, and F0 = 1 is taken for 1 - 2⁻²⁴
    np.testing.assert_allclose(((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2), f0, rtol=0, atol=14 * 2**-25)


@pytest.mark.parametrize(
    ("lines", "alpha"),
    [
        ("Pr 0.5", 0.25),
        ("Pr 0.5\nNs 30", 0.25),
        ("Pr 7", 1.0),
        ("Pr -1", 0.0),
        ("Ns 30", 0.25),  # 2/(30+2) = 1/16
        ("Ns 0", 1.0),
        ("Ns -5", 1.0),
        ("", 1.0),
    ],
)
def test_roughness_of_ordinary_materials(only, lines, alpha):
    found = numbers(only(f"newmtl a\nKd 1 1 1\nKs 1 1 1\n{lines}\n", dialect="ordinary"))["roughness"]
    assert found == pytest.approx(2 * math.sqrt(2) * alpha, rel=2**-24)


def test_ordinary_numbers_are_clamped_and_missing_ones_have_defaults(only):
    assert numbers(only("newmtl a\nKd 1.5 -1 0.5\nillum 1\n"))["color"] == [1, 0, 0.5]
    assert numbers(only("newmtl a\nillum 2\n"))["color"] == float32(0.6, 0.6, 0.6)
    assert numbers(only("newmtl a\nillum 2\nmap_Kd none.png\n"))["color"] == [1, 1, 1]
    assert numbers(only("newmtl a\nKs 3\nillum 2\n"))["reflectance"] == [1, 1, 1]
    assert numbers(only("newmtl a\nKs 0.9\nNi 1.5\n"))["reflectance"] == pytest.approx([0.04] * 3)
    assert numbers(only("newmtl a\nKs 0.9\nNi 1\n"))["reflectance"] == float32(0.9, 0.9, 0.9)


ranges = {
    "n": st.floats(2**-149, 1e6, width=32),
    "k": st.floats(0, 1e6, width=32),
    "roughness": st.floats(0, 1e6, width=32),
    "color": st.floats(0, 1, width=32),
    "reflectance": st.floats(0, 1, width=32),
}
PARAMETERS = {
    "metal": ("n", "k", "roughness"),
    "glossy": ("color", "reflectance", "roughness"),
    "matte": ("color", "reflectance"),
}


@st.composite
def fitted(draw):
    kind = draw(st.sampled_from(sorted(PARAMETERS)))
    values = {
        name: draw(ranges[name] if name == "roughness" else st.tuples(*[ranges[name]] * 3)) for name in PARAMETERS[kind]
    }
    return FittedMaterial(name=draw(st.text(max_size=8)), type=kind, **values)


def as_lists(material: Material) -> dict:
    return {name: tuple(value) if isinstance(value, list) else value for name, value in numbers(material).items()}


@given(materials=st.lists(fitted(), max_size=4))
def test_what_we_write_comes_back_to_the_last_bit(materials):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.thesis.mtl"
        path.write_text(thesis_mtl(materials), encoding="utf-8")
        found = read_mtl(path).appearances
    assert list(found) == written_names(material.name for material in materials)
    for material, appearance in zip(materials, found.values(), strict=True):
        assert appearance.material.type == material.type
        assert as_lists(appearance.material) == {name: getattr(material, name) for name in PARAMETERS[material.type]}


@given(
    f0=st.tuples(*[st.floats(0, 1, width=32)] * 3),
    color=st.tuples(*[st.floats(0, 1, width=32)] * 3),
    alpha=st.floats(0, 1, width=32),
)
def test_the_ordinary_file_comes_back_as_the_same_material(f0, color, alpha):
    metal = FittedMaterial(name="a", type="metal", f0=f0, alpha=alpha)
    glossy = FittedMaterial(name="b", type="glossy", color=color, reflectance=f0, alpha=alpha)
    matte = FittedMaterial(name="c", type="matte", color=color, reflectance=(1.0, 1.0, 1.0))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.mtl"
        path.write_text(ordinary_mtl([metal, glossy, matte]))
        found = {name: appearance.material for name, appearance in read_mtl(path).appearances.items()}
    assert [material.type for material in found.values()] == ["metal", "glossy" if max(f0) > 0 else "matte", "matte"]
    assert as_lists(found["b"])["color"] == as_lists(found["c"])["color"] == color
    np.testing.assert_allclose(found["a"].f0, f0, rtol=0, atol=2**-20)  # in float32, see the test of F0
    if max(f0) > 0:
        assert as_lists(found["b"])["reflectance"] == f0
        # Pr = √alpha is printed to 9 digits, and squared
        assert as_lists(found["b"])["roughness"] == pytest.approx(2 * math.sqrt(2) * alpha, rel=1e-7, abs=1e-44)


KEYS = ["newmtl", "Ns", "Ka", "Kd", "Ks", "Pr", "Pm", "Ni", "d", "Ke", "illum", "map_Kd", "bump", "norm"]
WORDS = ["0", "1", "2", "0.5", "-1", "1e40", "nan", "inf", "-s", "-bm", "-halo", "spectral", "#", "a", "x.png", "a.mtl"]
ODDITIES = ["\\", ".", "..", "/", "~", "\ufeff", "\x00", "é", "\x85"]
tokens = st.sampled_from(KEYS + WORDS + ODDITIES)
lines = st.lists(st.lists(tokens, max_size=5).map(" ".join), max_size=12).map("\n".join)


@given(data=st.one_of(lines.map(str.encode), st.binary()), dialect=st.sampled_from(["auto", "thesis", "ordinary"]))
@example(data=b"Ns \xef\xbb\xbf", dialect="auto")
def test_any_bytes_are_read_or_refused_in_one_sentence(data, dialect):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.mtl"
        path.write_bytes(b"newmtl a\n" + data)
        library = library_or_sentence(path, dialect)
    sentences = [library] if isinstance(library, str) else library.remarks
    assert all(sentence.startswith(folder) and sentence.isprintable() for sentence in sentences)


def library_or_sentence(path, dialect) -> Library | str:
    try:
        return read_mtl(path, dialect=dialect)
    except InputError as error:
        return str(error)


def test_every_material_file_at_hand_is_read_or_refused_in_one_sentence(shared_data, capfd):
    count = Counter()
    paths = sorted(path for path in shared_data.rglob("*.m*t*l") if path.is_file())
    for path, dialect in itertools.product(paths, ("auto", "thesis", "ordinary")):
        library = library_or_sentence(path, dialect)
        if isinstance(library, str):
            assert library.startswith(f"{path}: ")
            assert "\n" not in library
            count[dialect, "refused"] += 1
            continue
        count[dialect, "read"] += 1
        assert all("\n" not in remark for remark in library.remarks)
        for appearance in library.appearances.values():
            assert all(torch.isfinite(value).all() for value in appearance.material.numbers.values())
            count[dialect, appearance.material.type] += 1
    assert capfd.readouterr() == ("", "")
    with capfd.disabled():
        print("".join(f"\n  {dialect:10}{what:10}{n:4}" for (dialect, what), n in sorted(count.items())))
    assert count["ordinary", "read"] == count["auto", "read"] == len(paths)  # none of them is broken, or of our dialect
