"""What is added to a registry, in this file alone, is exported: formats of one and two files, a type of material."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import MaterialX as mx
import mitsuba
import numpy as np
import pygltflib
import pytest
from PIL import Image
from typer.testing import CliRunner

from fit_material.fitter.commands import app
from fit_material.fitter.export.export import export
from fit_material.fitter.export.format import Export, Files, Format, text_file
from fit_material.fitter.export.formats import FORMATS
from fit_material.fitter.export.values import given
from fit_material.fitter.result.schema import FittedMaterial, Maps, write_result
from fit_material.renderer.errors.input_error import InputError
from fit_material.shaders.materials.kinds import GLOSSY, KINDS, Kind
from tests.fitter.export.test_mtl import read
from tests.fitter.export.test_readers_of_other_programs import FLOAT32, by_blender, clay, glaze, near, reflectance_of
from tests.fitter.result.test_schema import gold, result
from tests.support.registries import added


def table_text(materials: Sequence[FittedMaterial]) -> str:
    rows = (f'"{each.name}",{each.type},{given(each, "alpha")!r}' for each in materials)
    return "\n".join(["name,type,alpha", *rows]) + "\n"


def swatch_files(export: Export) -> Files:
    """A JSON that names the colour map, and the map under a name of the format's own."""
    (material,) = export.materials
    assert material.maps is not None
    picture = f"{export.stem}.swatch.png"
    content = {"picture": picture, "reflectance": given(material, "reflectance")}
    return {export.file: json.dumps(content).encode(), picture: export.textures[material.maps.color]}


TABLE = Format("table", ".csv", text_file(table_text))
SWATCH = Format("swatch", ".swatch.json", swatch_files)
TEXELS = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)


@pytest.fixture
def opened() -> Iterator[None]:
    with added(FORMATS, TABLE), added(FORMATS, SWATCH):
        yield


def mapped(folder: Path) -> Path:
    """The result of one glossy material with a colour map, written."""
    folder.mkdir()
    Image.fromarray(TEXELS).save(folder / "its_color.png")
    material = glaze(maps=Maps(color="its_color.png", color_seen="its_seen.png"))
    write_result(result(materials=(material,)), folder / "result.json")
    return folder / "result.json"


def on_the_command_line(*arguments: object) -> str:
    """What a command prints that ends well, in one line."""
    done = CliRunner().invoke(app.app, [str(each) for each in arguments])
    assert done.exit_code == 0, done.output
    return " ".join(done.output.replace("│", " ").split())


@pytest.mark.usefixtures("opened")
def test_a_format_of_one_file_is_written_by_the_command(tmp_path):
    write_result(result(materials=(gold(name="a, b"), glaze())), tmp_path / "result.json")
    printed = on_the_command_line("export", tmp_path / "result.json", "--to", "table,gltf", "-o", tmp_path / "out")
    names = [f"{tmp_path.name}.csv", f"{tmp_path.name}.gltf"]
    assert printed == " ".join(str(tmp_path / "out" / name) for name in names)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == names
    with (tmp_path / "out" / names[0]).open(newline="", encoding="utf-8") as file:
        rows = [(row["name"], row["type"], float(row["alpha"])) for row in csv.DictReader(file)]
    assert rows == [("a, b", "metal", 0.2), ("glaze", "glossy", 0.1)]


@pytest.mark.usefixtures("opened")
def test_a_format_of_two_files_is_written_by_the_command(tmp_path):
    source = mapped(tmp_path / "fit")
    on_the_command_line("export", source, "--to", "swatch", "-o", tmp_path / "out")
    content = json.loads((tmp_path / "out" / "fit.swatch.json").read_text())
    assert content["reflectance"] == [0.04, 0.05, 0.03]
    np.testing.assert_array_equal(np.array(Image.open(tmp_path / "out" / content["picture"])), TEXELS)
    assert len(list((tmp_path / "out").iterdir())) == 2


@pytest.mark.usefixtures("opened")
def test_a_format_is_written_by_the_function(tmp_path):
    assert export(result(), ["table"], tmp_path, "ball") == (tmp_path / "ball.csv",)
    assert (tmp_path / "ball.csv").read_bytes() == b'name,type,alpha\n"ball",metal,0.2\n'


@pytest.mark.usefixtures("opened")
def test_a_format_that_is_added_has_the_checks_of_all_others(tmp_path):
    with pytest.raises(InputError) as refused:
        export(result(materials=(gold(), clay())), ["table"], tmp_path / "out", "ball", "a.json")
    expected = "numbers that the format can hold (matte 'clay' has no alpha, which its file needs)"
    assert str(refused.value) == f"a.json: materials[1]: is matte 'clay', expected {expected}"
    texture = mapped(tmp_path / "fit").with_name("its_color.png")
    texture.write_text("BEGIN KEY")
    material = glaze(maps=Maps(color=texture.name, color_seen="its_seen.png"))
    source = texture.with_name("result.json")
    with pytest.raises(InputError, match=r"materials\[0\]\.maps\.color: is its_color\.png, expected a PNG file beside"):
        export(result(materials=(material,)), ["swatch"], tmp_path / "out", "ball", source)
    assert not (tmp_path / "out").exists()


def test_a_format_that_looks_no_texture_up_reads_none(tmp_path):
    source = mapped(tmp_path / "fit")
    source.with_name("its_color.png").unlink()
    on_the_command_line("export", source, "--to", "gltf,blender", "-o", tmp_path / "out")
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"fit.gltf", "fit.blender.py"}


def test_no_format_overwrites_a_texture_of_the_result(tmp_path):
    source = mapped(tmp_path / "fit")
    before = source.with_name("its_color.png").read_bytes()
    other = Format("other", "_color.png", lambda export: {export.file: before[::-1]})
    material = glaze(maps=Maps(color="its_color.png", color_seen="its_seen.png"))
    with added(FORMATS, other), pytest.raises(InputError, match="an input is never overwritten"):
        export(result(materials=(material,)), ["other"], source.parent, "its", source, replace=True)
    assert source.with_name("its_color.png").read_bytes() == before


def test_two_formats_with_different_contents_for_one_name_are_refused(tmp_path):
    with (
        added(FORMATS, Format("first", ".txt", lambda export: {export.file: b"1"})),
        added(FORMATS, Format("second", ".txt", lambda export: {export.file: b"2"})),
        pytest.raises(InputError) as refused,
    ):
        export(result(), ["first", "second"], tmp_path / "out", "ball")
    assert str(refused.value) == "--to: expected formats of which no two write ball.txt: export them one by one"
    assert not (tmp_path / "out").exists()


def test_sentences_and_help_list_a_format_while_it_is_added(tmp_path):
    usual = ", ".join(FORMATS)
    assert usual.startswith("thesis, mtl, gltf, materialx, mitsuba, blender")

    def listed() -> str:
        with pytest.raises(InputError) as refused:
            export(result(), ["tabel"], tmp_path / "out", "ball")
        return str(refused.value)

    with added(FORMATS, TABLE):
        assert listed() == f"--to: is 'tabel', expected one of {usual}, table; the nearest is table"
        assert f"Formats, separated by commas: {usual}, table." in on_the_command_line("export", "--help")
    assert f"expected one of {usual}; the nearest is " in listed()
    assert f"Formats, separated by commas: {usual}." in on_the_command_line("export", "--help")


# a fourth type of material


LACQUER = Kind("lacquer", 3, "lacquer", GLOSSY.stored, mirrors=True, has_body=True)  # a body under a mirror
UNCODED = replace(LACQUER, name="uncoded", code=None)
VOID = Kind("void", 4, "void", (), mirrors=False, has_body=False)  # scatters nothing

COLOR, REFLECTANCE, ALPHA, RHO = (0.6, 0.1, 0.05), [0.08, 0.05, 0.02], 0.16, 0.3
RED = FittedMaterial(name="red", type="glossy", color=COLOR, reflectance=tuple(REFLECTANCE), alpha=ALPHA, roughness=RHO)


@pytest.fixture
def lacquer() -> Iterator[FittedMaterial]:
    """A material of the fourth type, with a tinted reflectance."""
    with added(KINDS, LACQUER), added(KINDS, UNCODED), added(KINDS, VOID):
        yield RED.model_copy(update={"type": "lacquer"})


@pytest.fixture
def exported(lacquer, tmp_path) -> dict[str, Path]:
    """Its files of all formats, by format."""
    return dict(zip(FORMATS, export(result(materials=(lacquer,)), [*FORMATS], tmp_path, "ball"), strict=True))


def assert_reflects(ior: float, tint: Sequence[float]) -> None:
    # the index may be a float32; F0's slope in it is 4(η-1)/(η+1)³, which multiplies its rounding by less than 20 here
    np.testing.assert_allclose(reflectance_of(ior) * np.array(tint), REFLECTANCE, rtol=20 * FLOAT32)


def test_both_mtl_files_hold_a_new_type(exported):
    color, mirrored, blur = (["0.6", "0.1", "0.05"], ["0.08", "0.05", "0.02"], ["0.3"] * 3)
    assert read(exported["thesis"].read_text())["red"] == {"Ns": ["3"], "Ka": mirrored, "Kd": color, "Ks": blur}
    block = read(exported["mtl"].read_text())["red"]
    assert (block.pop("Kd"), block.pop("Ks")) == (color, mirrored)
    exponent = 2 / ALPHA**2 - 2
    expected = {"Ns": exponent, "Pr": math.sqrt(ALPHA), "Pm": 0, "illum": 2}
    assert {key: float(words[0]) for key, words in block.items()} == pytest.approx(expected, rel=1e-8)


def test_gltf_holds_a_new_type(exported):
    (material,) = pygltflib.GLTF2().load(str(exported["gltf"])).materials
    surface = material.pbrMetallicRoughness
    assert (surface.baseColorFactor, surface.metallicFactor) == ([*COLOR, 1], 0)
    assert surface.roughnessFactor == near(0.4)
    ior = material.extensions["KHR_materials_ior"]["ior"]
    assert_reflects(ior, material.extensions["KHR_materials_specular"]["specularColorFactor"])


def test_materialx_holds_a_new_type(exported):
    document = mx.createDocument()
    mx.readFromXmlFile(document, str(exported["materialx"]))
    layer = document.getNode("red").getConnectedNode("surfaceshader").getConnectedNode("bsdf")
    top, base = layer.getConnectedNode("top"), layer.getConnectedNode("base")
    assert (top.getCategory(), base.getCategory()) == ("dielectric_bsdf", "oren_nayar_diffuse_bsdf")
    assert tuple(base.getInputValue("color")) == near(COLOR)
    assert tuple(top.getInputValue("roughness")) == near((ALPHA, ALPHA))
    assert_reflects(top.getInputValue("ior"), tuple(top.getInputValue("tint")))


def test_mitsuba_holds_a_new_type(exported):
    mitsuba.set_variant("scalar_rgb")
    loaded = mitsuba.traverse(mitsuba.load_file(str(exported["mitsuba"])))
    assert list(loaded["red.diffuse_reflectance.value"]) == near(list(COLOR))
    assert loaded["red.alpha"] == near(ALPHA)
    assert_reflects(loaded["red.eta"], loaded["red.specular_reflectance.value"])


def test_blender_holds_a_new_type(exported, monkeypatch):
    sockets = by_blender(exported["blender"].read_text(), monkeypatch)["red"]
    assert (sockets["Base Color"], sockets["Metallic"]) == ((*COLOR, 1.0), 0)
    assert sockets["Roughness"] == near(0.4)
    assert sockets["Specular IOR Level"] == 0.5
    assert_reflects(sockets["IOR"], sockets["Specular Tint"][:3])


@pytest.mark.parametrize("name", FORMATS)
def test_no_format_takes_a_type_that_scatters_nothing_for_another(lacquer, name, tmp_path):
    void = lacquer.model_copy(update={"type": "void"})
    reason = "void 'red' neither mirrors nor has a body, and no format holds that"
    with pytest.raises(InputError) as refused:
        export(result(materials=(gold(), void)), [name], tmp_path, "ball", "a.json")
    expected = f"expected numbers that the format can hold ({reason})"
    assert str(refused.value) == f"a.json: materials[1]: is void 'red', {expected}"


def test_a_type_without_a_code_in_the_viewers_dialect_is_refused(lacquer, tmp_path):
    uncoded = lacquer.model_copy(update={"type": "uncoded"})
    with pytest.raises(InputError, match="uncoded 'red' has no type code, which its file needs"):
        export(result(materials=(uncoded,)), ["thesis"], tmp_path, "ball")
