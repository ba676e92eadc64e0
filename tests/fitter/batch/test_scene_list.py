"""Which scenes a list names, and what their results are called."""

from __future__ import annotations

import glob
import io
import os
import sys
import time
from pathlib import Path

import pytest

from fit_material.fitter.batch.pattern import matching
from fit_material.fitter.batch.scene_list import read_lists
from fit_material.fitter.commands import app
from fit_material.renderer.errors.input_error import InputError


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """Scene files, empty, below the folder that is worked in."""
    for name in ("a/scene.toml", "b/scene.toml", "b/polished.toml", "deep/er/scene.toml", "with space/scene.toml"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def listed(text: str | bytes, where: str = "list.txt") -> dict[str, tuple[str, tuple[str, ...]]]:
    """From a list to scene files and options, by names."""
    Path(where).write_bytes(text if isinstance(text, bytes) else text.encode())
    return told(where)


def told(*sources: str) -> dict[str, tuple[str, tuple[str, ...]]]:
    return {name: (os.path.relpath(each.scene), each.words) for name, each in read_lists(sources).items()}


def test_a_path_to_a_line_with_comments_and_options(folder):
    text = "\ufeff# all of it\n\na/scene.toml   --type metal --seed 3  # a metal\n  b # a folder\r\n"
    assert listed(text + "with space/scene.toml\n") == {
        "a": ("a/scene.toml", ("--type", "metal", "--seed", "3")),
        "b": ("b/scene.toml", ()),
        "with-space": ("with space/scene.toml", ()),
    }


def test_quotes_and_backslashes_as_in_a_shell(folder):
    Path("#1").mkdir()
    Path("#1/scene.toml").touch()
    assert listed("'with space' --type metal") == {"with-space": ("with space/scene.toml", ("--type", "metal"))}
    assert listed("\\#1/scene.toml -q  # of that name") == listed("'#1' -q") == {"1": ("#1/scene.toml", ("-q",))}
    assert listed("with\\ space/scene.toml -q") == {"with-space": ("with space/scene.toml", ("-q",))}


def test_patterns_match_files_and_folders(folder):
    assert list(listed("[ab] --type matte\nb/*.toml --type matte")) == ["a", "b", "b-polished"]
    assert list(listed("**/scene.toml")) == ["a", "b", "deep-er", "with-space"]


def test_folders_and_scene_files_in_the_place_of_a_list(folder):
    assert list(told("deep", "a/scene.toml", "b/polished.toml")) == ["er", "a", "b-polished"]
    assert list(told(".")) == ["a", "b", "deep-er", "with-space"]


def test_a_list_is_relative_to_itself(folder):
    names = listed("../a/scene.toml\nscene.toml", "b/list.txt")
    assert names == {"a": ("a/scene.toml", ()), "b": ("b/scene.toml", ())}


def test_standard_input(folder, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"a/scene.toml\nb\n")))
    assert list(told("-")) == ["a", "b"]


def test_a_scene_listed_twice_counts_once(folder):
    os.symlink(folder / "a", folder / "link")
    assert list(listed("a\na/scene.toml\n./a\nlink")) == ["a"]


def test_names_are_all_different_and_do_not_depend_on_the_order(folder):
    """Of a-b/scene.toml and a/b/scene.toml, and of A and a, which some disks take for one."""
    for name in ("a-b", "a/b", "A"):
        Path(name).mkdir(exist_ok=True)
        (Path(name) / "scene.toml").touch()
    names = listed("a-b\na/b/scene.toml\nA\na/scene.toml")
    assert len({name.casefold() for name in names}) == 4
    assert {name.casefold()[:-7] for name in names} == {"a-b", "a"}
    assert listed("a/scene.toml\nA\na/b/scene.toml\na-b") == names


@pytest.mark.parametrize(
    "name", ["../" * 40 + "x/scene.toml", ".hidden/scene.toml", "ü" * 90 + "/scene.toml", "summary.html.toml", "?.toml"]
)
def test_a_name_is_a_plain_one(name, folder):
    """Whether the scene is there, its fit will tell."""
    (found,) = listed(f"'{name}'") if "?" not in name else listed("\\?.toml") if Path("?.toml").touch() else ["x"]
    assert found not in ("", ".", "..", "summary.html")
    assert "/" not in found
    assert not found.startswith((".", "-"))
    assert len(found.encode()) < 240


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "list.txt: expected at least one scene"),
        ("# nothing\n", "list.txt: expected at least one scene"),
        ("a\nx/*/scene.toml", "list.txt: line 2: is x/*/scene.toml, expected a pattern that some scene file matches"),
        ("--type metal", "list.txt: line 1: is --type metal, expected a scene file, and options behind it"),
        ("a 'b", "list.txt: line 1: is a 'b, expected quotes in pairs"),
        ("a\0b", r"list.txt: line 1: is a\x00b, expected the path of a file (embedded null byte)"),
        ("b" * 300, f"list.txt: line 1: is {'b' * 79}…, expected the path of a file (File name too long)"),
        (f"{'b' * 300}/*", f"list.txt: line 1: is {'b' * 79}…, expected the path of a file (File name too long)"),
        ("~no-such-user/a", "list.txt: line 1: is ~no-such-user/a, expected the path of a file (Could not determine"),
        ("~no-such-user/*", "list.txt: line 1: is ~no-such-user/*, expected the path of a file (Could not determine"),
        (b"\xff\xfe", "list.txt: expected a list of scenes in UTF-8, one to a line"),
        ("deep/er\nempty", "list.txt: line 2: is empty, expected a folder with a scene.toml, or with folders"),
        (
            "a --seed 1\nb\na --seed 2",
            "list.txt: line 3: is {folder}/a/scene.toml, expected each scene once; list.txt: line 1 lists it with",
        ),
    ],
)
def test_slips_in_a_list(text, sentence, folder):
    (folder / "empty").mkdir()
    with pytest.raises(InputError) as error:
        listed(text)
    assert str(error.value).startswith(sentence.format(folder=folder))


def test_no_list(folder):
    with pytest.raises(InputError, match=r"^gone.txt: expected a list of scenes that can be read \(No such file"):
        told("gone.txt")


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ("~no-such-user/*", "~no-such-user/*: expected a list of scenes that can be read (No such file or directory)"),
        (
            "~no-such-user/*.toml",
            "LIST: is ~no-such-user/*.toml, expected the path of a file (Could not determine home directory.)",
        ),
    ],
)
def test_nobody_s_home_in_the_place_of_a_list_is_one_sentence(given, sentence, folder, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["fit-material", "batch", given, "-o", str(folder / "out")])
    with pytest.raises(SystemExit) as ended:
        app.main()
    assert (ended.value.code, capsys.readouterr().err) == (2, f"fit-material: {sentence}\n")


def test_links_to_the_folder_itself_are_no_ways_through_it(folder):
    """Two of them make 2^40 paths of forty names."""
    for name in ("again", "once-more"):
        os.symlink(folder, folder / name)
        os.symlink(folder / "a", folder / "a" / name)
    begun = time.monotonic()
    for pattern in ("*/" * 40 + "scene.toml", "**/" * 20 + "scene.toml"):
        assert (folder / "a/scene.toml").resolve() in {Path(path).resolve() for path, _ in listed(pattern).values()}
    assert list(listed("**/scene.toml")) == ["a", "b", "deep-er", "with-space"]
    assert time.monotonic() - begun < 2


def test_a_pattern_finds_what_is_in_a_linked_folder_but_nothing_below(folder, tmp_path_factory):
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    for name in ("scene.toml", "below/scene.toml"):
        (elsewhere / name).parent.mkdir(exist_ok=True)
        (elsewhere / name).touch()
    os.symlink(elsewhere, folder / "deep" / "link")
    assert list(listed("deep/**/scene.toml")) == ["deep-er", "deep-link"]
    assert list(listed("deep/*/*/scene.toml")) == ["deep-link-below"]


@pytest.mark.parametrize(
    "pattern",
    ["**", "**/*.toml", "*/scene.toml", "[ab]/**", "d*/**/scene.*", ".h*/*", "b/../*/*.toml", "**/**/*", "?", "a/*/x"],
)
def test_without_links_a_pattern_matches_what_pythons_own_does(pattern, folder):
    for name in (".hidden/scene.toml", "a/.hidden", "deep/er/still/deep.er"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()
    for root, text in ((Path(), pattern), (folder, pattern), (Path(), f"{folder}/{pattern}")):
        expected = {Path(os.path.abspath(each)) for each in glob.glob(str(root / text), recursive=True)}
        found = {Path(os.path.abspath(each)) for each in matching(text, root)}
        assert found - {folder} == expected - {folder}  # to which `**` of no folders leads, and Python's only sometimes


def test_brackets_in_the_name_of_a_lists_own_folder_are_no_pattern(folder):
    (folder / "b[1]" / "x").mkdir(parents=True)
    (folder / "b[1]" / "x" / "scene.toml").touch()
    assert list(listed("*/scene.toml", "b[1]/list.txt")) == ["x"]


def test_a_list_that_is_a_pipe_is_refused(folder):
    os.mkfifo("pipe.txt")
    with pytest.raises(InputError, match=r"^pipe.txt: is a named pipe, expected a regular file$"):
        told("pipe.txt")
