import math
import struct

import pytest
import tinyobjloader
import trimesh.exchange.obj
from hypothesis import given, settings
from hypothesis import strategies as st

from fit_material.fitter.export.mtl import Maps, ordinary_mtl, thesis_mtl, type_codes
from fit_material.fitter.result.schema import FittedMaterial

float32 = st.floats(width=32, allow_nan=False, allow_infinity=False)
unit = st.floats(0, 1, width=32)


def triple(values):
    return st.tuples(values, values, values)


def metal(name="ball", n=(0.15, 0.43, 1.4), k=(3.5, 2.3, 1.9), f0=(0.96, 0.77, 0.39), alpha=0.25, rho=0.7):
    return FittedMaterial(name=name, type="metal", n=n, k=k, f0=f0, alpha=alpha, roughness=rho)


def layered(type_, **changes):
    values = {"color": (0.5, 0.25, 0.125), "reflectance": (0.5, 0.5, 0.5), "f0": (0.5, 0.5, 0.5)}
    if type_ == "glossy":
        values |= {"alpha": 0.25, "roughness": 0.7}
    return FittedMaterial(**{"name": type_, "type": type_, **values, **changes})


def read(text: str) -> dict[str, dict[str, list[str]]]:
    """An MTL reader as short as the format allows: blocks of key and words."""
    materials: dict[str, dict[str, list[str]]] = {}
    for line in filter(None, text.split("\n")):
        key, *words = line.split(" ")
        if key == "newmtl":
            block = materials[" ".join(words)] = {}
        else:
            block[key] = words
    return materials


def as_float32(words: list[str]) -> tuple[float, ...]:
    return struct.unpack(f"{len(words)}f", struct.pack(f"{len(words)}f", *map(float, words)))


def tinyobj(text: str, tmp_path) -> dict:
    (tmp_path / "a.mtl").write_text(text, encoding="utf-8")
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    reader = tinyobjloader.ObjReader()
    assert reader.ParseFromFile(str(tmp_path / "a.obj"), tinyobjloader.ObjReaderConfig()), reader.Error()
    return {material.name: material for material in reader.GetMaterials()}


@settings(deadline=None)
@given(n=triple(float32), k=triple(float32), rho=float32)
def test_thesis_dialect_gives_every_float32_back(n, k, rho):
    block = read(thesis_mtl([metal(n=n, k=k, rho=rho)]))["ball"]
    assert list(block) == ["Ns", "Ka", "Kd", "Ks"]
    assert as_float32(block["Kd"]) == n
    assert as_float32(block["Ka"]) == k
    assert as_float32(block["Ks"]) == (rho, rho, rho)
    assert block["Ns"] == ["2"]


@settings(deadline=None)
@given(f0=triple(unit), alpha=unit)
def test_ordinary_file_gives_the_colour_back(f0, alpha):
    block = read(ordinary_mtl([metal(f0=f0, alpha=alpha)]))["ball"]
    assert as_float32(block["Kd"]) == as_float32(block["Ks"]) == f0
    assert float(block["Pr"][0]) == pytest.approx(math.sqrt(alpha), rel=1e-8)
    assert 0 <= float(block["Ns"][0]) <= 1000
    assert block["Pm"] == ["1"]


def test_table_of_the_thesis_for_all_types():
    blocks = read(thesis_mtl([metal(), layered("glossy"), layered("matte")]))
    assert [block["Ns"] for block in blocks.values()] == [["2"], ["1"], ["0"]]
    for name, rho in (("glossy", "0.7"), ("matte", "0")):
        assert blocks[name]["Kd"] == ["0.5", "0.25", "0.125"]
        assert blocks[name]["Ka"] == ["0.5", "0.5", "0.5"]
        assert blocks[name]["Ks"] == [rho] * 3


def test_codes_can_be_other_numbers():
    text = thesis_mtl([metal()], codes={**type_codes(), "metal": 8})
    assert read(text)["ball"]["Ns"] == ["8"]


def test_ordinary_file_for_all_types():
    blocks = read(ordinary_mtl([metal(), layered("glossy"), layered("matte")]))
    assert [block["Pm"] + block["illum"] for block in blocks.values()] == [["1", "3"], ["0", "2"], ["0", "1"]]
    assert [block["Pr"] for block in blocks.values()] == [["0.5"], ["0.5"], ["1"]]
    assert blocks["glossy"]["Kd"] == ["0.5", "0.25", "0.125"]
    assert blocks["matte"]["Kd"] == ["0.25", "0.125", "0.0625"]
    assert blocks["matte"]["Ks"] == ["0", "0", "0"]
    assert blocks["matte"]["Ns"] == ["0"]


@pytest.mark.parametrize(("writer", "key"), [(thesis_mtl, "n"), (ordinary_mtl, "f0")])
def test_other_readers_see_the_same(tmp_path, writer, key):
    material = metal()
    text = writer([material, metal(name="second")])
    loaded = tinyobj(text, tmp_path)
    assert list(loaded) == ["ball", "second"]
    assert tuple(loaded["ball"].diffuse) == pytest.approx(getattr(material, key), rel=1e-7)
    by_trimesh = trimesh.exchange.obj.parse_mtl(text)
    assert by_trimesh["second"]["kd"] == pytest.approx(getattr(material, key))


def test_other_readers_see_metalness_and_roughness(tmp_path):
    loaded = tinyobj(ordinary_mtl([metal()]), tmp_path)["ball"]
    assert (loaded.roughness, loaded.metallic) == (0.5, 1.0)


def test_texture_lines(tmp_path):
    maps = {"ball": Maps(color="c.png", normal="n.png", ambient_occlusion="ao.png")}
    thesis = thesis_mtl([metal()], maps=maps)
    assert thesis.splitlines()[-3:] == ["map_Ka ao.png", "map_Kd c.png", "bump n.png"]
    assert tinyobj(thesis, tmp_path)["ball"].bump_texname == "n.png"
    ordinary = ordinary_mtl([metal()], maps=maps)
    assert ordinary.splitlines()[-2:] == ["map_Kd c.png", "bump -bm 1.0 n.png"]
    assert tinyobj(ordinary, tmp_path)["ball"].bump_texname == "n.png"


@pytest.mark.parametrize("file", ["a.png ", "a.png # gold", "a\n.png", " ", "a\tb.png"])
def test_texture_names_that_would_be_misread(file):
    with pytest.raises(ValueError, match="cannot be a texture's name"):
        thesis_mtl([metal()], maps={"ball": Maps(color=file)})


@pytest.mark.parametrize(
    ("name", "written"),
    [
        ("a b", "a_b"),
        ("a\nKd 1 1 1", "a_Kd_1_1_1"),
        ("\ufeffgold", "gold"),
        ("", "unnamed"),
        (" \t", "unnamed"),
        ("#1", "_1"),
        ("a\\", "a_"),
        ("Messing é", "Messing_é"),
    ],
)
def test_names_are_made_safe(tmp_path, name, written):
    for writer in (thesis_mtl, ordinary_mtl):
        text = writer([metal(name=name)])
        assert list(read(text)) == [written]
        assert list(tinyobj(text, tmp_path)) == [written]


def test_names_stay_distinct():
    names = list(read(thesis_mtl([metal(name=name) for name in ("a b", "a_b", "a\tb", "a_b_2")])))
    assert names == ["a_b", "a_b_2", "a_b_3", "a_b_2_2"]


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e39])
def test_numbers_that_no_reader_takes(bad):
    broken = metal().model_copy(update={"n": (1.0, bad, 1.0), "f0": (bad, 0.5, 0.5)})
    for writer in (thesis_mtl, ordinary_mtl):
        with pytest.raises(ValueError, match="finite number"):
            writer([broken])


@pytest.mark.parametrize("writer", [thesis_mtl, ordinary_mtl])
def test_numbers_that_are_missing(writer):
    with pytest.raises(ValueError, match="metal 'ball' has no"):
        writer([FittedMaterial(name="ball", type="metal")])
