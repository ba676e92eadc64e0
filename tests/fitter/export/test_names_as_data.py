"""Names from files of strangers are data: no export runs or obeys them, no result or mesh brings control characters."""

import ast
import json
import os
import re
import sys
from xml.etree import ElementTree

import MaterialX as mx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fit_material.fitter.commands import app
from fit_material.fitter.export.blender import blender
from fit_material.fitter.export.export import export
from fit_material.fitter.export.formats import FORMATS
from fit_material.fitter.export.materialx import materialx
from fit_material.fitter.export.mitsuba_xml import mitsuba_xml
from fit_material.fitter.export.mtl import ordinary_mtl, thesis_mtl
from fit_material.fitter.result.formatting import remarks
from fit_material.fitter.result.schema import FittedMaterial, Maps, read_result, write_result
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.errors.printable import printable
from fit_material.renderer.files.validation import check
from fit_material.renderer.geometry.mesh import read_mesh
from fit_material.renderer.scene.scene_file import MaterialSpec, read_scene
from tests.fitter.export.test_readers_of_other_programs import by_blender, clay, glaze
from tests.fitter.result.test_schema import gold, result

EVIL = "x\nimport os; os.mkdir('made')#"
NASTY = st.one_of(
    st.text(st.characters(codec=None), max_size=30),  # halves of characters, too
    st.text("\n\r\x0b\x0c\x1b\x85\u2028\\\"'#-<>&!]{}():\x00\ufffe", max_size=30),
    st.just(EVIL),
    st.sampled_from(["-->", "--", "-", "]]>", "<!--", '"""', "\\", "\\N{BULLET}", "{name}", "%s", "$width", "\ud800"]),
)


def mapped(name: str, file: str) -> FittedMaterial:
    """A material whose map has any name at all, which no result that was read has."""
    maps = Maps.model_construct(color=file, color_seen=file)
    return glaze().model_copy(update={"name": name, "maps": maps})


@given(NASTY, NASTY)
def test_a_blender_script_has_names_as_data_alone(name, file):
    below = clay(name=f"{name} below")  # a record is in Unicode, which half a character is not
    script = blender([mapped(name, file), below])
    statements = [type(each).__name__ for each in ast.parse(script).body]
    assert statements == ["Expr", "Import", "Assign", "For"]
    with pytest.MonkeyPatch.context() as patch:
        assert list(by_blender(script, patch)) == [name, below.name]


@given(NASTY, NASTY)
def test_xml_has_names_as_data_alone(name, file):
    material = mapped(name, file)
    root = ElementTree.fromstring(mitsuba_xml([material, gold(name=name)]).encode())
    assert [(each.tag, each.get("type")) for each in root] == [("bsdf", "roughplastic"), ("bsdf", "roughconductor")]
    assert {each.tag for each in root.iter()} == {"scene", "bsdf", "rgb", "float", "boolean", "string"}
    document = mx.createDocument()
    mx.readFromXmlString(document, materialx([material]))
    (node,) = document.getMaterialNodes()
    assert node.getAttribute("doc") == printable("; ".join(remarks(material)))


@given(NASTY)
def test_mtl_has_one_line_for_a_name(name):
    for text in (thesis_mtl([gold(name=name)]), ordinary_mtl([gold(name=name)])):
        first, *others = re.split(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]", text.rstrip("\n"))
        assert re.fullmatch(r"newmtl \S+", first)
        assert {line.split()[0] for line in others} <= {"Ka", "Kd", "Ks", "Ns", "Pm", "Pr", "illum"}
        text.encode()


def by_hand(tmp_path, **material) -> str:
    """What is said of a result whose first material was changed by hand."""
    path = tmp_path / "result.json"
    write_result(result(), path)
    data = json.loads(path.read_text())
    data["materials"][0].update(material)
    path.write_text(json.dumps(data))
    with pytest.raises(InputError) as refused:
        export(read_result(path), list(FORMATS), tmp_path / "out", "ball", path)
    return str(refused.value).removeprefix(f"{path}: ")


@pytest.mark.parametrize(
    ("control", "spelled"),
    [
        *(("\n", r"\n"), ("\r", r"\r"), ("\0", r"\x00"), ("\x1b", r"\x1b"), ("\x7f", r"\u007f")),
        *(("\x85", r"\u0085"), ("\u2028", r"\u2028"), ("\u2029", r"\u2029"), ("\ud800", r"\ud800")),
    ],
)
def test_results_with_control_characters_in_names_are_refused(tmp_path, control, spelled):
    sentence = f'materials[0].name: is "a{spelled}b", expected a text without control characters'
    assert by_hand(tmp_path, name=f"a{control}b") == sentence
    nearest = by_hand(tmp_path, nearest=[{"name": f"A{control}", "distance": 1}])
    assert nearest == f'materials[0].nearest[0].name: is "A{spelled}", expected a text without control characters'


def test_results_with_control_characters_in_paths_are_refused(tmp_path):
    path = tmp_path / "result.json"
    write_result(result(), path)
    path.write_text(path.read_text().replace('"scene.toml"', '"scene\\u001b.toml"'))
    with pytest.raises(InputError, match=r'inputs\[0\]\.path: is "scene\\x1b\.toml", expected a text without control'):
        read_result(path)


def test_keys_that_no_file_can_hold_are_refused(tmp_path):
    told = by_hand(tmp_path, **{"nam\ud800e": 1})
    assert told == r"materials[0].nam\ud800e: is 1, expected a known key, the nearest is name"


@pytest.mark.parametrize("name", ["/etc/a.png", "../a.png", "b/a.png", "b\\a.png", ".a.png", ".png", "a.mtl", ""])
def test_maps_are_png_files_beside_the_result(tmp_path, name):
    told = by_hand(tmp_path, maps={"color": name, "color_seen": "b.png"})
    assert told == f'materials[0].maps.color: is "{name}", expected the name of a .png file, without folders in it'


def test_a_script_in_the_name_of_a_map_is_refused(tmp_path):
    told = by_hand(tmp_path, maps={"color": f"{EVIL}.png", "color_seen": "b.png"})
    assert re.fullmatch(
        r'materials\[0\]\.maps\.color: is "x\\nimport os; .*", expected a text without control characters', told
    )


def test_a_map_that_memory_does_not_hold_is_not_exported(tmp_path):
    """A hole of a terabyte takes no room on the disk."""
    folder = tmp_path / "theirs"
    folder.mkdir()
    with (folder / "a.png").open("wb") as file:
        file.truncate(10**12)
    material = gold().model_copy(update={"maps": Maps(color="a.png", color_seen="a.png")})
    with pytest.raises(InputError) as refusal:
        export(result(materials=(material,)), ["mtl"], tmp_path / "out", "ball", folder / "result.json")
    expected = "expected what fits into memory: reading it takes 1e+03 GB, and "
    assert str(refusal.value).startswith(f"{folder / 'a.png'}: {expected}")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("kind", ["away", "fifo", "text", "circle"])
def test_no_other_file_is_exported_as_a_map(tmp_path, kind):
    secret = tmp_path / "secret"
    secret.write_bytes(b"\x89PNG\r\n\x1a\n and more")
    folder = tmp_path / "theirs"
    folder.mkdir()
    texture = folder / "a.png"
    if kind == "fifo":
        os.mkfifo(texture)
    elif kind == "text":
        texture.write_text("BEGIN KEY")
    else:
        texture.symlink_to(secret if kind == "away" else texture)
    material = gold().model_copy(update={"maps": Maps(color="a.png", color_seen="a.png")})
    with pytest.raises(InputError, match=r"maps\.color: is a\.png, expected a (PNG )?file beside it( \(.*\))?$"):
        export(result(materials=(material,)), ["mtl"], tmp_path / "out", "ball", folder / "result.json")
    assert not (tmp_path / "out").exists()


ESCAPE = "\x1b]0;owned\x07\x9b31m"
SPELLED = r"\x1b]0;owned\x07\u009b31m"
CONTROL = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f]")
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


@pytest.mark.parametrize(("key", "what"), [("usemtl", "name of a material"), ("o", "name of an object")])
def test_meshes_with_control_characters_in_names_are_refused(tmp_path, key, what):
    path = tmp_path / "ball.obj"
    path.write_text(f"{key} red\x1b[31m\n{TRIANGLE}")
    with pytest.raises(InputError) as refused:
        read_mesh(path)
    assert str(refused.value) == rf"{path}: {what}: is red\x1b[31m, expected one without control characters"


def test_scenes_with_control_characters_in_names_are_refused(tmp_path):
    with pytest.raises(InputError) as refused:
        check(MaterialSpec, {"name": "a\x1b[2J"}, tmp_path / "scene.toml")
    told = str(refused.value).removeprefix(f"{tmp_path / 'scene.toml'}: ")
    assert told == r'name: is "a\x1b[2J", expected a text without control characters'


def test_paths_with_control_characters_are_refused(gold_scene):
    (gold_scene.parent / "view_0.exr").rename(gold_scene.parent / "view\n0.exr")
    gold_scene.write_text(gold_scene.read_text().replace("view_0.exr", "view\\n0.exr"))
    with pytest.raises(InputError) as refused:
        read_scene(gold_scene)
    told = str(refused.value).removeprefix(f"{gold_scene}: ")
    assert re.fullmatch(r"photographs\[0\]\.image: is .*…?, expected a path without control characters", told)


def said(capfd, monkeypatch, *arguments: object) -> str:
    """All that a command prints, on both streams."""
    monkeypatch.setattr(sys, "argv", ["fit-material", *map(str, arguments)])
    with pytest.raises(SystemExit):
        app.main()
    return "".join(capfd.readouterr())


@pytest.mark.parametrize("command", [["check"], ["plan"], ["fit", "-o", "out"]])
def test_no_control_character_of_a_file_reaches_the_terminal(capfd, monkeypatch, gold_scene, command):
    mesh = gold_scene.parent / "ball.obj"
    mesh.write_text(f"usemtl {ESCAPE}\n{TRIANGLE}")
    gold_scene.write_text(gold_scene.read_text().replace('shape = "sphere"', 'mesh = "ball.obj"'))
    told = said(capfd, monkeypatch, *command, gold_scene)
    assert SPELLED in told
    assert not CONTROL.search(told)


def test_no_control_character_of_an_argument_reaches_the_terminal(capfd, monkeypatch, tmp_path):
    assert f"{SPELLED}.toml: expected a readable scene file here" in said(capfd, monkeypatch, "check", f"{ESCAPE}.toml")
    told = said(capfd, monkeypatch, ESCAPE)
    assert "no such command" in told
    assert not CONTROL.search(told)
    assert r"a\nb" in said(capfd, monkeypatch, "check", "a\nb.toml")


def test_no_control_character_of_a_result_reaches_the_terminal(capfd, monkeypatch, tmp_path):
    folder = tmp_path / ESCAPE
    write_result(result(), tmp_path / "result.json")
    told = said(capfd, monkeypatch, "export", tmp_path / "result.json", "--to", "mtl", "-o", folder)
    assert told == f"{tmp_path}/{SPELLED}/{tmp_path.name}.mtl\n"


def test_the_progress_bar_takes_names_as_they_are(monkeypatch, capsys):
    from fit_material.fitter.command_line.progress_bar import progress_bar

    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "dumb")
    with progress_bar(quiet=False) as progress:
        progress(f"[/red]{ESCAPE}: solving", 0.5)
    told = capsys.readouterr().err
    assert ESCAPE not in told
    assert "\x07" not in told


@pytest.mark.parametrize("hidden", ["\ufeff", "\u202e", "\u200b", "\U000e0041", "\ud800", "\u0085", "\x1b", "\n"])
def test_what_is_no_visible_character_is_spelled_out(hidden):
    """Marks that turn the direction of writing show a name as another; above 0x7F as JSON spells them."""
    shown = printable(f"é{hidden}σ")
    assert shown.isprintable()
    assert (shown[0], shown[-1]) == ("é", "σ")
    assert json.loads(f'"{shown}"' if ord(hidden) > 0x7E else json.dumps(f"é{hidden}σ")) == f"é{hidden}σ"
