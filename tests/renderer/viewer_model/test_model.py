"""Models: which materials a mesh gets, from which files, and what is said about the rest."""

import re
from collections import Counter

import numpy as np
import pytest
import torch
from PIL import Image

from fit_material.fitter.export.mtl import thesis_mtl
from fit_material.fitter.result.schema import FittedMaterial
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.geometry.tangents import tangents
from fit_material.renderer.viewer_model.model import Model, read_model
from fit_material.shaders.materials.types import Glossy, Matte, Metal

CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
UV = "vt 0 0\nvt 1 0\nvt 0 1\n"
FACE = "f 1/1 2/2 3/3\n"
METAL = "Ns 2\nKa 3.5 2.3 1.9\nKd 0.15 0.43 1.4\nKs 0.25 0.25 0.25\n"
GLOSSY = "Ns 1\nKa 0.04 0.05 0.06\nKd 0.5 0.25 0.125\nKs 0.25 0.25 0.25\n"


@pytest.fixture
def model(tmp_path):
    """The model of these files, of which a.obj is the mesh."""

    def read(files: dict[str, str], **options) -> Model:
        for name, text in files.items():
            (tmp_path / name).write_text(text)
        return read_model(tmp_path / "a.obj", **options)

    return read


def types(model: Model) -> dict[str, str]:
    named = zip(model.mesh.material_names, model.appearances, strict=True)
    return {name: appearance.material.type for name, appearance in named}


def test_files_named_in_the_mesh(model):
    obj = "mtllib one.mtl\nmtllib none.mtl two.mtl\nusemtl b\n" + CORNERS + UV + FACE + "usemtl a\nf 1 3 2\n"
    files = {"a.obj": obj, "one.mtl": "newmtl a\n" + METAL, "two.mtl": "newmtl b\n" + GLOSSY + "newmtl a\n" + GLOSSY}
    found = model(files)
    assert types(found) == {"b": "glossy", "a": "metal"}  # of two with one name the first
    assert [file.name for file in found.files] == ["a.obj", "one.mtl", "two.mtl"]
    assert found.remarks == ()


@pytest.mark.parametrize(
    "line", ["my own.mtl", "x.mtl my own.mtl y.mtl", "my\\ own.mtl", "x\\\\my own.mtl", "my own.mtl # c"]
)
def test_blanks_in_the_files_names(model, line):
    found = model({"a.obj": f"mtllib {line}\nusemtl m\n" + CORNERS + UV + FACE, "my own.mtl": "newmtl m\n" + METAL})
    assert types(found) == {"m": "metal"}


def test_the_thesis_s_file_beside_the_mesh_goes_before_mtllib(model):
    obj = "mtllib a.mtl\nusemtl m\n" + CORNERS + FACE.replace("/1", "").replace("/2", "").replace("/3", "")
    both = {"a.obj": obj, "a.mtl": "newmtl m\nKd 1 0 0\nillum 1\n", "a.thesis.mtl": "newmtl m\n" + METAL}
    assert types(model(both)) == {"m": "metal"}


def test_a_file_that_is_given_goes_before_all(model, tmp_path):
    files = {"a.obj": "usemtl m\n" + CORNERS + UV + FACE, "a.thesis.mtl": "newmtl m\n" + METAL}
    (tmp_path / "other.mtl").write_text("newmtl m\n" + GLOSSY)
    found = model(files, mtl=tmp_path / "other.mtl")
    assert types(found) == {"m": "glossy"}
    codes = {"matte": 1, "glossy": 0, "metal": 2}
    assert types(model(files, mtl=tmp_path / "other.mtl", codes=codes)) == {"m": "matte"}
    ordinary = model(files, mtl=tmp_path / "other.mtl", dialect="ordinary").appearances[0].material
    assert ordinary.reflectance[0] == 0.25  # Ks, not Ka
    with pytest.raises(InputError, match=r"none\.mtl: expected an MTL file here"):
        model(files, mtl=tmp_path / "none.mtl")


def test_without_any_file_everything_is_matte(model):
    found = model({"a.obj": "mtllib none.mtl\nusemtl m\n" + CORNERS + UV + FACE + "usemtl n\nf 1 3 2\n"})
    for appearance in found.appearances:
        assert isinstance(appearance.material, Matte)
        assert torch.equal(appearance.material.color, torch.full((3,), 0.6))
        assert torch.equal(appearance.material.reflectance, torch.ones(3))
    assert (
        sorted(re.sub(r".*/", "", remark) for remark in found.remarks)
        == [
            "a.obj: mtllib: is none.mtl, expected a material file that exists; drawn without it",
            "a.obj: expected an MTL file with its materials; drawn matte",
        ][::-1]
    )


def test_materials_that_the_files_lack_are_matte(model):
    obj = CORNERS + UV + FACE + "usemtl m\nf 1 3 2\nusemtl n\nf 2 1 3\n"
    found = model({"a.obj": obj, "a.thesis.mtl": "newmtl n\n" + METAL})
    assert types(found) == {"default": "matte", "m": "matte", "n": "metal"}
    assert sorted(re.sub(r".*/", "", remark) for remark in found.remarks) == [
        "a.obj: usemtl: expected a material for all faces; those without are drawn matte",
        "a.obj: usemtl: is m, expected a material of that name in an MTL file; drawn matte",
    ]


def test_the_only_material_is_that_of_a_mesh_without_names(model):
    files = {"a.obj": CORNERS + UV + FACE, "a.thesis.mtl": "newmtl gold\n" + METAL}
    assert types(model(files)) == {"default": "metal"}
    assert model(files).remarks == ()
    files["a.thesis.mtl"] += "newmtl paint\n" + GLOSSY
    assert types(model(files)) == {"default": "matte"}


@pytest.mark.parametrize("names", [["red brass", "#1", "é"], ["a b", "a_b"], ["a_b", "a b", "a\\b"], ["x # c", "x"]])
def test_names_that_our_writer_changes_are_found(model, names):
    obj = CORNERS + "".join(f"usemtl {name}\nf 1 2 3\n" for name in names)
    order = model({"a.obj": obj}).mesh.material_names  # in which a fit has them
    metals = [
        FittedMaterial(name=name, type="metal", n=(1.0 + i,) * 3, k=(1.0,) * 3, roughness=0.0)
        for i, name in enumerate(order)
    ]
    found = model({"a.obj": obj, "a.thesis.mtl": thesis_mtl(metals)})
    assert [appearance.material.n[0].item() for appearance in found.appearances] == [1 + i for i in range(len(names))]
    assert sorted(order) == sorted(names)


def test_names_are_found_as_they_are_where_they_are(model):
    faces = "usemtl a_b\nf 1 2 3\nusemtl a b\nf 1 3 2\n"
    found = model({"a.obj": CORNERS + faces, "a.thesis.mtl": f"newmtl a b\n{METAL}newmtl a_b\n{GLOSSY}"})
    assert types(found) == {"a_b": "glossy", "a b": "metal"}


@pytest.fixture
def normal_map(tmp_path):
    Image.new("RGB", (1, 1), (128, 200, 255)).save(tmp_path / "n.png")


@pytest.mark.parametrize("smooth", [True, False])
def test_a_normal_map_finds_normals_and_tangents(model, normal_map, smooth):
    """Two triangles, one with a mirrored texture, meet in an edge; the facets' normals serve where there are none."""
    normals = "vn 0 0 1\n" if smooth else ""
    slots = "/1" if smooth else ""
    face = "".join(f"f {' '.join(f'{v}/{v}{slots}' for v in face)}\n" for face in ((1, 2, 3), (2, 4, 3)))
    obj = "usemtl m\n" + CORNERS + "v 1 1 0\n" + UV + "vt 0 0\n" + normals + face
    found = model({"a.obj": obj, "a.thesis.mtl": "newmtl m\n" + METAL + "bump n.png\n"}, smooth=smooth)
    assert found.appearances[0].maps.normal is not None
    assert found.remarks == ()
    assert len(found.mesh.vertices) == 6
    np.testing.assert_array_equal(found.mesh.normals, np.tile([0, 0, 1], (6, 1)))
    assert sorted(tangents(found.mesh)[found.mesh.faces][:, :, 3].tolist()) == [[-1] * 3, [1] * 3]
    assert [file.name for file in found.files] == ["a.obj", "a.thesis.mtl", "n.png"]


def test_textures_need_coordinates(model, normal_map):
    found = model({"a.obj": "usemtl m\n" + CORNERS + "f 1 2 3\n", "a.thesis.mtl": f"newmtl m\n{METAL}bump n.png\n"})
    assert found.appearances[0].maps.normal is None
    assert [remark.partition(": ")[2] for remark in found.remarks] == [
        "expected texture coordinates for its textures; drawn without them"
    ]
    assert found.mesh.normals is None


def test_broken_materials_are_one_sentence(model):
    with pytest.raises(InputError, match=r"a\.thesis\.mtl: m: Kd: is nan, expected a finite number"):
        model({"a.obj": CORNERS + "f 1 2 3\n", "a.thesis.mtl": "newmtl m\n" + METAL + "Kd nan 1 1\n"})


def model_or_sentence(path) -> Model | str:
    try:
        return read_model(path)
    except InputError as error:
        return str(error)


def test_every_model_at_hand_is_read_or_refused_in_one_sentence(shared_data, capfd):
    paths = sorted(path for path in shared_data.rglob("*.*") if path.suffix.lower() == ".obj")
    count = Counter()
    for path in paths:
        found = model_or_sentence(path)
        count["files"] += 1
        if isinstance(found, str):
            assert found.startswith(f"{path}: ")
            assert "\n" not in found
            count["refused"] += 1
            continue
        count["read"] += 1
        count["remarks"] += len(found.remarks)
        count["objects"] += len(found.mesh.part_names)
        assert all("\n" not in remark for remark in found.remarks)
        assert len(found.appearances) == len(found.mesh.material_names) > found.mesh.material.max()
        assert set(found.files) == {file for file in found.files if file.is_file()}
        for appearance in found.appearances:
            count[appearance.material.type] += 1
            count["maps"] += sum(texture is not None for texture in vars(appearance.maps).values())
            assert all(torch.isfinite(value).all() for value in appearance.material.numbers.values())
        along = tangents(found.mesh)
        assert along is None or np.isfinite(along).all()
    assert capfd.readouterr() == ("", "")
    with capfd.disabled():
        print("".join(f"\n  {what:10}{n:4}" for what, n in sorted(count.items())))
    assert count["read"] > 0.8 * len(paths)  # the rest was made to be broken, or holds no triangles


def test_maps_at_hand_are_found(shared_data):
    data = shared_data / "objmtl" / "obj2gltf" / "specs" / "data"
    for name in ("box-textured", "box-windows-paths", "box-mtllib-spaces"):
        (obj,) = (data / name).glob("*.obj")
        found = read_model(obj)
        assert found.remarks == ()
        if name != "box-mtllib-spaces":
            assert found.appearances[0].maps.color is not None
    assert {type(appearance.material) for appearance in found.appearances} <= {Matte, Glossy, Metal}
    assert len(found.files) == 4
