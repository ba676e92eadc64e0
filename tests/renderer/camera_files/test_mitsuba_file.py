"""Mitsuba's scene files from strangers: what they may not hold is refused, and nothing that they name is run."""

import pytest

from fit_material.renderer.camera_files.importers import read_cameras
from fit_material.renderer.errors.input_error import InputError
from tests.renderer.camera_files.test_mitsuba_sensors import FOV, film, ours, placed, scene
from tests.support.hostile import MARK, hostile_library, mitsuba_folder

INSIDE = (
    "near_clip, far_clip, focus_distance, shutter_open, shutter_close, to_world, fov, fov_axis, focal_length, "
    "principal_point_offset_x, principal_point_offset_y, film, sampler"
)
BEFORE = '<include filename="a.xml"/><default name="a" value="30"/>'
ONES = f'<matrix value="{"1 " * 16}"/>'
REFUSED = [
    (
        scene('<float name="fow" value="3"/>'),
        f'sensor[0]: is with <float name="fow">, expected no elements but {INSIDE}',
    ),
    (
        scene('<string name="fov" value="3"/>'),
        f'sensor[0]: is with <string name="fov">, expected no elements but {INSIDE}',
    ),
    *(
        (scene(f"<{tag}/>"), f"sensor[0]: is with <{tag}>, expected no elements but {INSIDE}")
        for tag in ("ref", "include", "default", "sensor", "float_")
    ),
    (scene('<float name="fov"/>'), 'sensor[0].fov: expected an attribute "value"'),
    (
        scene('<float name="fov" value="30" a="2"/>'),
        "sensor[0].fov: is with an attribute a, expected no attributes but name, value",
    ),
    (scene(FOV + FOV), "sensor[0]: is with fov twice, expected one fov"),
    (scene(FOV.replace("/>", "><b/></float>")), "sensor[0].fov: is with elements inside, expected a value alone"),
    *(
        (scene(f'<float name="fov" value="{value}"/>'), f"sensor[0].fov: is {value}, expected a finite number")
        for value in ("1_0", "nan", "0x1e", "30,", "1e999", "٣٠")
    ),
    *(
        (
            scene(f'<float name="fov" value="{value}"/>'),
            f"sensor[0].fov: is {value}, expected a field of view above 0 and below 180 degrees",
        )
        for value in ("0", "180", "-30", "400")
    ),
    (
        scene(FOV + '<string name="fov_axis" value="z"/>'),
        "sensor[0].fov_axis: is z, expected one of x, y, diagonal, smaller, larger",
    ),
    (scene('<string name="fov_axis" value="y"/>'), "sensor[0]: is with fov_axis, expected a fov beside it"),
    (
        scene(FOV + '<string name="focal_length" value="50mm"/>'),
        "sensor[0]: is with fov and focal_length, expected one of the two",
    ),
    (scene(film(0, 3)), "sensor[0].film: is empty, expected a film of one pixel at least"),
    (scene(film(-1, 3)), "sensor[0].film.width: is -1, expected a whole number below 2³¹"),
    (scene('<film type="specfilm"/>'), "sensor[0].film: is specfilm, expected one of hdrfilm"),
    (
        scene(placed("<spin/>")),
        "sensor[0].to_world: is with <spin>, expected no elements but translate, scale, rotate, lookat, matrix",
    ),
    (
        scene(placed('<rotate y="2" angle="3"/>')),
        "sensor[0].to_world.rotate: is about [0.0, 2.0, 0.0], expected an axis of length 1",
    ),
    (scene(placed('<rotate y="1"/>')), 'sensor[0].to_world.rotate: expected an attribute "angle"'),
    (
        scene(placed('<lookat origin="1 2 3" target="1 2 3"/>')),
        "sensor[0].to_world.lookat: is without a direction, expected an origin apart from its target, and up not along "
        "the line of sight",
    ),
    (scene(placed('<lookat origin="1 2" target="1 2 3"/>')), "sensor[0].to_world.lookat: is 1 2, expected 3 numbers"),
    (scene(placed('<matrix value="1 2 3"/>')), "sensor[0].to_world.matrix: is 1 2 3, expected 9 or 16 numbers"),
    (
        scene(placed(ONES)),
        "sensor[0].to_world.matrix: is with [1.0, 1.0, 1.0, 1.0] as its last row, expected 0 0 0 1 there",
    ),
    (
        scene(placed('<scale value="1e200"/>' * 2)),
        "sensor[0].to_world.scale: is beyond all numbers, expected a transform that moves points by a finite length",
    ),
    (
        scene(placed('<scale x="1" y="2"/>'), "orthographic"),
        "sensor[0].to_world: is scaled by 1, 2 and 1, expected one scale of x and y, and none of 0",
    ),
    (
        scene(placed('<scale value="0"/>'), "orthographic"),
        "sensor[0].to_world: is scaled by 0, 0 and 0, expected one scale of x and y, and none of 0",
    ),
    (scene(FOV, version="three"), "version: is three, expected three numbers, such as 3.0.0"),
    (FOV, "is of <float>, expected a <scene> of Mitsuba's"),
    (
        scene('<float name="fov" value="$a"/>', before=BEFORE),
        "sensor[0]: is $a, expected no $name, which an <include> could set: it is not read",
    ),
]


@pytest.mark.parametrize(("text", "sentence"), REFUSED)
def test_what_sensors_do_not_have_is_refused(tmp_path, text, sentence):
    with pytest.raises(InputError) as refused:
        ours(tmp_path, text)
    assert str(refused.value).removeprefix(f"{tmp_path / 'scene.xml'}: ") == sentence


def test_defaults_inside_defaults_are_refused(tmp_path):
    """Each would be looked through for every one around it, in quadratic time."""
    with pytest.raises(InputError, match=r"default: is with elements inside, expected a name and a value alone$"):
        ours(tmp_path, scene(FOV, before='<default name="a" value="b">' * 2 + "</default>" * 2))


def test_texts_that_grow_by_powers_are_refused(tmp_path):
    laughs = "".join(f'<!ENTITY l{i + 1} "{f"&l{i};" * 10}">' for i in range(9))
    with pytest.raises(InputError, match=r"scene\.xml: expected a readable XML file \(a document type is declared\)$"):
        ours(tmp_path, f'<!DOCTYPE scene [<!ENTITY l0 "ha">{laughs}]>' + scene(FOV.replace("33.3", "&l9;")))
    defaults = "".join(f'<default name="l{i + 1}" value="{f"$l{i}" * 10}"/>' for i in range(9))
    with pytest.raises(InputError, match=r"default: is 1111.*…, expected at most 1000 characters$"):
        ours(tmp_path, scene(FOV, before=f'<default name="l0" value="1"/>{defaults}'))


def test_other_files_are_not_read_as_entities(tmp_path):
    (tmp_path / "secret").write_text("30")
    with pytest.raises(InputError, match=r"\(a document type is declared\)$"):
        ours(tmp_path, '<!DOCTYPE scene [<!ENTITY fov SYSTEM "secret">]>' + scene(FOV.replace("33.3", "&fov;")))


def test_files_of_more_than_8_mib_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"scene\.xml: expected a readable XML file \(it is larger than 8 MiB\)$"):
        ours(tmp_path, scene(FOV, before=" " * (8 << 20)))


@pytest.fixture
def hostile(tmp_path, monkeypatch):
    """A library in the working folder, and the way there from Mitsuba's own plugins."""
    mark, library = tmp_path / MARK, tmp_path / "plugins" / "evil.so"
    library.parent.mkdir()
    hostile_library(library, mark)
    monkeypatch.chdir(tmp_path)
    upwards = "/".join([".."] * len((mitsuba_folder() / "plugins").parts[1:]))
    return mark, f"{upwards}{library.with_suffix('')}"


@pytest.mark.parametrize("place", ["sampler", "film", "rfilter", "sensor", "medium", "named"])
def test_a_file_names_no_code_to_run(tmp_path, hostile, place):
    mark, name = hostile
    name = "evil" if place == "named" else name
    evil = f'<{"sampler" if place == "named" else place} type="{name}"/>'
    inside = f'<film type="hdrfilm">{evil}</film>' if place == "rfilter" else evil
    text = scene("", name) if place == "sensor" else scene(inside)
    (tmp_path / "scene.xml").write_text(text)
    with pytest.raises(InputError, match=r"scene\.xml: sensor\[0\].*: is .*, expected (one of|no elements but) "):
        read_cameras(tmp_path / "scene.xml", [])
    assert not mark.exists()
