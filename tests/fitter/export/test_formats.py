import pytest

from fit_material.fitter.export.export import export
from fit_material.fitter.export.mtl import ordinary_mtl, thesis_mtl
from fit_material.renderer.errors.input_error import InputError
from tests.fitter.result.test_schema import gold, result


def test_each_format_is_its_own_file(tmp_path):
    files = export(result(), ["thesis", "mtl"], tmp_path / "out", "scene")
    assert files == (tmp_path / "out" / "scene.thesis.mtl", tmp_path / "out" / "scene.mtl")
    assert [file.read_text() for file in files] == [thesis_mtl([gold()]), ordinary_mtl([gold()])]
    assert sorted(tmp_path.rglob("*.*")) == sorted(files)


def test_unknown_format_names_the_nearest(tmp_path):
    with pytest.raises(InputError, match=r"^--to: is 'tesis', expected one of thesis, mtl, .*; the nearest is thesis"):
        export(result(), ["mtl", "tesis"], tmp_path / "out", "scene")
    assert not (tmp_path / "out").exists()


def test_stem_is_one_name(tmp_path):
    with pytest.raises(InputError, match="without folders"):
        export(result(), ["mtl"], tmp_path, "../scene")


def test_all_files_or_none(tmp_path):
    no_roughness = result(materials=(gold(roughness=None),))
    with pytest.raises(InputError, match=r"^result\.json: materials\[0\]: is metal 'ball', .*no roughness"):
        export(no_roughness, ["mtl", "thesis"], tmp_path, "scene")
    assert list(tmp_path.iterdir()) == []


def test_numbers_beyond_float32_are_named(tmp_path):
    huge = result(materials=(gold(), gold(n=(1e300, 1.0, 1.0))))
    with pytest.raises(InputError, match=r"^a\.json: materials\[1\]\.n: is metal .*1e\+300 cannot be exported"):
        export(huge, ["mtl", "thesis"], tmp_path, "scene", "a.json")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("materials", "told"),
    [
        ((), r"^a\.json: materials: is \[\], expected at least one material"),
        ((gold(color=(0.5, 2.0, 0.5)),), r"^a\.json: materials\[0\]\.color: is 2\.0, expected numbers in \[0, 1\]"),
    ],
)
def test_what_no_format_holds_is_refused(tmp_path, materials, told):
    with pytest.raises(InputError, match=told):
        export(result(materials=materials), ["gltf"], tmp_path, "scene", "a.json")
    assert list(tmp_path.iterdir()) == []


def test_output_that_is_a_file(tmp_path):
    (tmp_path / "out").write_text("")
    with pytest.raises(InputError, match=r"^-o: is .*out, expected a folder"):
        export(result(), ["mtl"], tmp_path / "out", "scene")
