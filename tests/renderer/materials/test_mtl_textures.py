"""Textures that MTL files name: which are read, from where, by which options."""

import re
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from fit_material.renderer.materials.mtl_reader import read_mtl
from fit_material.renderer.materials.mtl_syntax import found_file, texture_file, texture_options

METAL = "newmtl a\nNs 2\nKa 3.5 2.3 1.9\nKd 0.15 0.43 1.4\nKs 0.25 0.25 0.25\n"
GLOSSY = "newmtl a\nNs 1\nKa 0.04 0.05 0.06\nKd 0.5 0.25 0.125\nKs 0.25 0.25 0.25\n"


@pytest.fixture
def pictures(tmp_path):
    """Pictures with a colour, of one texel each."""
    for name, code in {"c": (255, 0, 0), "n": (128, 128, 255), "ao": (51, 200, 200), "grey": (9, 9, 9)}.items():
        Image.new("RGB", (1, 1), code).save(tmp_path / f"{name}.png")
    return tmp_path


def test_maps_of_the_thesis(mtl, pictures):
    library = mtl(GLOSSY + "map_Ka ao.png\nmap_Kd c.png\nbump -bm 1.0 n.png\n")
    maps = library.appearances["a"].maps
    assert maps.color.texels.tolist() == [[[1, 0, 0]]]
    torch.testing.assert_close(maps.normal.texels[0, 0], torch.tensor([128, 128, 255]) / 255)
    torch.testing.assert_close(maps.ambient_occlusion.texels, torch.tensor([[[0.2]]]))
    assert library.remarks == ()
    assert [file.name for file in library.files] == ["a.mtl", "ao.png", "c.png", "n.png"]


@pytest.mark.parametrize("key", ["bump", "map_bump", "map_Bump", "norm"])
def test_keys_of_normal_maps_in_both_dialects(mtl, pictures, key):
    for extra in ("", "illum 2\n"):
        assert mtl(GLOSSY + extra + f"{key} n.png\n").appearances["a"].maps.normal is not None


def test_ordinary_ambient_textures_are_not_occlusion(mtl, pictures):
    assert mtl(GLOSSY + "illum 2\nmap_Ka c.png\n").appearances["a"].maps.ambient_occlusion is None


@pytest.mark.parametrize(
    ("text", "remark"),
    [
        (GLOSSY + "map_Kd none.png", r"a\.mtl: a: map_Kd: is none\.png, expected a texture file that exists; drawn w"),
        (GLOSSY + "map_Kd a.mtl", r"a\.mtl: expected a picture .*; drawn without it"),
        (
            GLOSSY + "bump grey.png",
            r"a: bump: is grey\.png, expected a normal map in colours, not a grey height map; d",
        ),
        (METAL + "map_Kd c.png", "a: map_Kd not drawn, for a metal has no colour"),
        (GLOSSY + "map_Kd -s 2 2 2 c.png", "a: map_Kd: -s 2 2 2 not drawn"),
        (GLOSSY + "illum 2\nmap_Ks c.png\ndisp c.png", "a: disp, map_ks not drawn"),
        (GLOSSY + "d 0.5", "a: d not drawn"),
        (GLOSSY + "d -halo 0.5\nKe 0 0 2\n", "a: d, Ke not drawn"),
    ],
)
def test_what_is_not_drawn_is_remarked(mtl, pictures, text, remark):
    library = mtl(text + "\n")
    assert len(library.remarks) == 1
    assert re.search(remark, library.remarks[0])
    maps = library.appearances["a"].maps
    assert maps.normal is None
    assert maps.color is None or "-s" in text


def test_what_changes_nothing_is_not_remarked(mtl, pictures):
    text = "d 1\nTr 0\nKe 0 0 0\nillum 2\nmap_Kd -s 1 1 1 -o 0 0 -clamp off -type sphere c.png\n"
    assert mtl(GLOSSY + text).remarks == ()


def test_a_texture_of_several_materials_is_read_once(mtl, pictures):
    library = mtl(GLOSSY + "map_Kd c.png\n" + GLOSSY.replace("newmtl a", "newmtl b") + "map_Kd c.png\n")
    first, second = (appearance.maps.color for appearance in library.appearances.values())
    assert first is second
    assert len(library.files) == 2


@pytest.mark.parametrize(
    ("value", "file", "options"),
    [
        ("a.png", "a.png", []),
        ("a b.png", "a b.png", []),
        ('"a b.png"', "a b.png", []),
        ("-bm 1.0 a.png", "a.png", []),
        ("-imfchan r a.jpg -bm 1.5", "a.jpg", ["-bm 1.5"]),
        ("-s 2 a.png", "a.png", ["-s 2"]),
        ("-o 0.1 0.2 0.3 -t 0 0 0 1.png", "1.png", ["-o 0.1 0.2 0.3"]),
        ("-texres 512 -mm 0 1 -clamp on a.png", "a.png", ["-clamp on"]),
        ("-blendu off -blendv off -boost 2 -cc on -colorspace sRGB -type cube_top a -s.png", "a -s.png", []),
        ("my-s 1.png", "my-s 1.png", []),
    ],
)
def test_texture_options(value, file, options):
    assert texture_file(value) == file
    assert texture_options(value) == options


@pytest.mark.parametrize(
    "name", ["t/a b.png", "t\\a b.png", "t\\\\a b.png", ".\\t\\a b.png", "C:\\x\\top.png", "/x/top.png", "top.png # c"]
)
def test_files_are_found_under_the_names_that_other_systems_give_them(tmp_path, name):
    (tmp_path / "t").mkdir()
    for file in ("t/a b.png", "top.png"):
        (tmp_path / file).write_bytes(b"")
    assert found_file(name, tmp_path) is not None
    assert found_file("t", tmp_path) is found_file("", tmp_path) is None


def test_a_sign_in_a_file_s_name_is_no_comment(tmp_path):
    for file in ("a #1.png", "a"):
        (tmp_path / file).write_bytes(b"")
    assert found_file("a #1.png", tmp_path) == tmp_path / "a #1.png"


@pytest.fixture
def outsider(tmp_path) -> Path:
    """An MTL file in a folder of its own, and a picture beside that folder."""
    Image.fromarray(np.full((2, 2, 3), 200, np.uint8)).save(tmp_path / "secret.png")
    (tmp_path / "tree").mkdir()
    return tmp_path / "tree" / "a.mtl"


@pytest.mark.parametrize("name", ["../secret.png", "..\\secret.png", "{}/secret.png", "link.png", "../tree/link.png"])
def test_a_texture_outside_of_the_folder_is_read_only_where_that_is_asked_for(outsider, name):
    outsider.write_text(f"newmtl a\nKd 1 1 1\nIllum 1\nmap_Kd {name.format(outsider.parent.parent)}\n")
    (outsider.parent / "link.png").symlink_to(outsider.parent.parent / "secret.png")
    kept, asked = read_mtl(outsider), read_mtl(outsider, outside=True)
    assert kept.appearances["a"].maps.color is None
    assert kept.files == (outsider,)
    (remark,) = kept.remarks
    assert remark.startswith(f"{outsider}: a: map_Kd: is {name.format(outsider.parent.parent)[:20]}")
    assert remark.endswith(
        f", expected a texture in the folder {outsider.parent} or below it, or --outside; drawn without it"
    )
    assert asked.appearances["a"].maps.color is not None
    assert len(asked.files) == 2


def test_a_texture_beside_the_models_folder_is_in_its_tree(outsider):
    outsider.write_text("newmtl a\nKd 1 1 1\nIllum 1\nmap_Kd ../secret.png\n")
    assert read_mtl(outsider, tree=outsider.parent.parent).appearances["a"].maps.color is not None
