import os
from pathlib import Path

import pytest

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.atomic import replaced_together, write_bytes_atomically, write_text_atomically


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_text_is_utf8_without_mark_and_replaces_the_old(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    write_text_atomically(path, "ρ = 1\n")
    assert path.read_bytes() == b"\xcf\x81 = 1\n"
    assert names(tmp_path) == ["a.txt"]


def test_files_are_as_readable_as_any_other(tmp_path):
    write_bytes_atomically(tmp_path / "a", b"1")
    (tmp_path / "plain").write_bytes(b"1")
    assert (tmp_path / "a").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_interrupted_write_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "a.txt"
    path.write_text("old")

    def interrupted(source, target):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_text_atomically(path, "new")
    assert path.read_text() == "old"
    assert names(tmp_path) == ["a.txt"]


def test_a_folder_that_is_a_file_is_an_input_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file that can be written"):
        write_text_atomically(tmp_path / "file" / "a.txt", "")


def test_files_arrive_together_the_result_last(tmp_path, monkeypatch):
    moved = []
    replace = os.replace
    monkeypatch.setattr(os, "replace", lambda a, b: (moved.append(Path(b).name), replace(a, b)))
    (tmp_path / "kept.txt").write_text("kept")
    with replaced_together(tmp_path) as folder:
        for name in ("result.json", "z.mtl", "report.html"):
            (folder / name).write_text(name)
        (folder / "sub").mkdir()
        (folder / "sub" / "map.png").write_text("png")
        assert names(tmp_path) == [folder.name, "kept.txt"]
    assert moved == [".moves", "report.html", "map.png", "z.mtl", "result.json"]
    assert names(tmp_path) == ["kept.txt", "report.html", "result.json", "sub", "z.mtl"]


@pytest.mark.parametrize("exception", [KeyboardInterrupt, SystemExit, ValueError])
def test_what_breaks_off_the_block_leaves_the_old_files(tmp_path, exception):
    (tmp_path / "result.json").write_text("old")

    def half_a_run():
        with replaced_together(tmp_path) as folder:
            (folder / "result.json").write_text("half")
            raise exception

    with pytest.raises(exception):
        half_a_run()
    assert (tmp_path / "result.json").read_text() == "old"
    assert names(tmp_path) == ["result.json"]


def test_a_folder_made_for_a_block_that_breaks_off_goes_again(tmp_path):
    with pytest.raises(ValueError), replaced_together(tmp_path / "a"):  # noqa: PT011 — the block's own
        raise ValueError
    assert names(tmp_path) == []


def test_a_missing_folder_is_made(tmp_path):
    with replaced_together(tmp_path / "a" / "b") as folder:
        (folder / "x").write_text("x")
    assert names(tmp_path / "a" / "b") == ["x"]


@pytest.mark.parametrize("below", ["", "below"])
def test_a_file_in_the_folders_place_is_an_input_error(tmp_path, below):
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(InputError, match=r"^-o: is .*file.*, expected a folder that can be written"),
        replaced_together(tmp_path / "file" / below),
    ):
        pytest.fail("the block must not run")


def test_a_folder_without_permission_is_an_input_error(tmp_path, monkeypatch):
    def refuse(*args, **kwargs):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("tempfile.mkdtemp", refuse)
    with pytest.raises(InputError, match="Permission denied"), replaced_together(tmp_path):
        pytest.fail("the block must not run")


def test_a_folder_in_a_files_place_moves_nothing(tmp_path):
    (tmp_path / "z.mtl").mkdir()

    def run():
        with replaced_together(tmp_path, option="--out") as folder:
            (folder / "a.mtl").write_text("new")
            (folder / "z.mtl").write_text("new")

    with pytest.raises(InputError, match=r"^--out: is .*z.mtl, expected a place for a file"):
        run()
    assert names(tmp_path) == ["z.mtl"]


def test_errors_inside_the_block_are_not_renamed(tmp_path):
    with pytest.raises(FileNotFoundError), replaced_together(tmp_path) as folder:
        (folder / "missing").read_text()
