"""The scene file: what DESIGN.md shows is read, and every slip is told in one sentence that names the place."""

import difflib
import json
import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fit_material.renderer.cameras.camera import look_at
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.geometry.mesh import Mesh, Sphere
from fit_material.renderer.scene.scene_file import CameraSpec, camera_of, read_scene, read_shape

CAMERA = """
[photographs.camera]
origin = [0, 0, 4]
target = [0, 0, 0]
up = [0, 1, 0]
fov = 35.0
"""
PHOTOGRAPH = """
[[photographs]]
image = "view_0.exr"
mask = "view_0_mask.png"
encoding = "srgb"
exposure = 1.0
"""
HEAD = """
[geometry]
mesh = "ball.obj"
smooth = true
[environment]
map = "studio.hdr"
rotation = 0.0
scale = 1.0
"""
LIGHT = """
[[lights]]
type = "directional"
direction = [0.3, 0.8, 0.5]
irradiance = [3.0, 3.0, 2.8]
"""
MATERIAL = """
[[materials]]
name = "default"
type = "auto"
"""
WHOLE = HEAD + LIGHT + PHOTOGRAPH + CAMERA + MATERIAL
POSE = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]
FRAME = {"file_path": "./view_0", "transform_matrix": POSE}


@pytest.fixture
def write(tmp_path):
    """Writes a scene file beside empty files of the names that it uses."""
    for name in ("ball.obj", "studio.hdr", "view_0.exr", "view_1.png", "view_0_mask.png"):
        (tmp_path / name).touch()

    def scene(text: str, transforms=None):
        (tmp_path / "scene.toml").write_text(text, encoding="utf-8")
        if transforms is not None:
            (tmp_path / "transforms.json").write_text(json.dumps(transforms))
        return tmp_path / "scene.toml"

    return scene


def test_the_example_of_the_design(write, tmp_path):
    scene = read_scene(write(WHOLE))
    assert scene.geometry.mesh == tmp_path / "ball.obj"
    assert scene.environment.map == tmp_path / "studio.hdr"
    assert scene.lights[0].irradiance == (3.0, 3.0, 2.8)
    assert [material.type for material in scene.materials] == ["auto"]
    (photograph,) = scene.photographs
    assert photograph.image == tmp_path / "view_0.exr"
    assert photograph.exposure == 1.0
    camera = camera_of(photograph.camera, 640, 480)
    assert (camera.width, camera.height, camera.projection, camera.fov) == (640, 480, "perspective", 35.0)
    torch.testing.assert_close(camera.camera_to_world, torch.tensor(POSE).double())


def test_what_may_be_left_out(write):
    text = '[geometry]\nshape = "sphere"\n[environment]\nmap = "studio.hdr"\n[[photographs]]\nimage = "view_1.png"\n'
    scene = read_scene(write(text + "camera = {origin = [0, 0, 4], target = [0, 0, 0]}\n"))
    assert isinstance(read_shape(scene.geometry), Sphere)
    assert scene.photographs[0].mask is None
    assert scene.photographs[0].encoding is None
    assert scene.photographs[0].camera.fov == 35
    assert (scene.lights, scene.materials) == ((), ())


def test_shape_from_file(write, tmp_path):
    (tmp_path / "ball.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    shape = read_shape(read_scene(write(WHOLE)).geometry)
    assert isinstance(shape, Mesh)
    assert len(shape.faces) == 1


def test_orthographic_camera_from_a_matrix(write):
    camera = f'[photographs.camera]\nmatrix = {POSE}\nprojection = "orthographic"\nscale = 1.2\n'
    spec = read_scene(write(HEAD + PHOTOGRAPH + camera)).photographs[0].camera
    found = camera_of(spec, 10, 20)
    assert (found.projection, found.scale) == ("orthographic", 1.2)
    torch.testing.assert_close(found.camera_to_world, torch.tensor(POSE).double())


SLIPS = {
    ("mesh =", "mehs ="): r'geometry\.mehs: is "ball\.obj", expected a known key, the nearest is mesh',
    ("fov =", "fow ="): r"photographs\[0\]\.camera\.fow: is 35\.0, expected a known key, the nearest is fov",
    ("[[lights]]", "[[light]]"): r"light: is .*, expected a known key, the nearest is lights",
    (
        "[geometry]",
        "zzz = 1\n[geometry]",
    ): "zzz: is 1, expected one of the keys cameras, exposure, white_balance, geometry",
    ("smooth = true", 'smooth = "yes"'): r'geometry\.smooth: is "yes", expected true or false',
    ("rotation = 0.0", 'rotation = "90"'): r'environment\.rotation: is "90", expected a number',
    ("rotation = 0.0", "rotation = nan"): r"environment\.rotation: is nan, expected a number of degrees",
    ("rotation = 0.0", "rotation = 1e7"): r"environment\.rotation: is 1.*, expected a number of degrees up to 1000000",
    ("rotation = 0.0\nscale = 1.0", "scale = 0"): r"environment\.scale: is 0, expected a number from 1e-12 to 1e.12",
    ("fov = 35.0", "fov = 180"): r"photographs\[0\]\.camera\.fov: is 180, expected less than or equal to 179",
    ("fov = 35.0", "fov = 0"): r"photographs\[0\]\.camera\.fov: is 0, expected greater than or equal to 0.01",
    (
        "exposure = 1.0",
        "exposure = -1",
    ): r'photographs\[0\]\.exposure: is -1, expected a number from 1e-12 to .*, or "fit"',
    ("exposure = 1.0", "exposure = true"): r'photographs\[0\]\.exposure: is True, expected a number from .*, or "fit"',
    ("exposure = 1.0", 'exposure = "auto"'): r'exposure: is "auto", expected a number from .*, or "fit"',
    ('"srgb"', '"gamma:-1"'): r'photographs\[0\]\.encoding: is "gamma:-1", expected "srgb", "linear" or "gamma:"',
    ('"view_0.exr"', '"none.exr"'): r"photographs\[0\]\.image: is .*none\.exr.*, expected a file or folder that exists",
    ('"view_0.exr"', '""'): r"photographs\[0\]\.image: is .*, expected a file, not a folder$",
    ('"view_0_mask.png"', '"../"'): r"photographs\[0\]\.mask: is .*, expected a file, not a folder$",
    ('"view_0.exr"', '"~nosuchuser/x"'): r"image: is \"?~nosuchuser/x\"?, expected a file or folder that exists",
    ('"view_0.exr"', f'"{"x" * 5000}"'): r"image: is \"?x{79}…\"?, expected a file or folder that exists",
    ('"view_0.exr"', r'"a\u0000b"'): r"image: is .*a\\x00b\"?, expected a file or folder that exists",
    ("scale = 1.0", f"scale = {9 * 10**400}"): r"environment\.scale: is 90*…, expected",
    ("exposure = 1.0", f"exposure = {10**400}"): r"photographs\[0\]\.exposure: is 10*…, expected a number from",
    ("[0, 0, 4]", f"[0, 0, {10**400}]"): r"camera\.origin\[2\]: is 10*…, expected a",
    ("fov = 35.0", f"fov = 1{chr(48) * 5000}"): "expected a readable scene file",
    ('"view_0.exr"', "3"): r"photographs\[0\]\.image: is 3, expected a path",
    ('"studio.hdr"', '"none.hdr"'): r"environment\.map: is .*none\.hdr.*, expected a file or folder that exists",
    ('mesh = "ball.obj"', ""): 'geometry: expected either mesh = "FILE" or shape = "sphere"',
    ('mesh = "ball.obj"', 'mesh = "ball.obj"\nshape = "sphere"'): "geometry: expected either mesh",
    ('mesh = "ball.obj"', 'shape = "cube"'): r'geometry\.shape: is "cube", expected \'sphere\'',
    ("origin = [0, 0, 4]", ""): r"camera: is \"target\", expected either origin and target, or matrix",
    ("fov = 35.0", f"matrix = {POSE}"): "camera: is .*, expected either origin and target, or matrix",
    ("fov = 35.0", "scale = 2"): r"camera\.scale: is 2\.0, expected projection = \"orthographic\" beside it",
    ("target = [0, 0, 0]", "target = [0, 0, 4]"): r"camera\.target: is \[0.0, 0.0, 4.0\], expected a point apart from",
    ("up = [0, 1, 0]", "up = [0, 0, 0]"): r"camera\.up: is \[0.0, 0.0, 0.0\], expected a direction, not 0",
    ("up = [0, 1, 0]", "up = [0, 0, 1]"): r"camera\.target: .* not straight along up",
    ("up = [0, 1, 0]", "up = [0, 1]"): r"camera\.up\[2\]: expected a value here, but it is missing",
    ("up = [0, 1, 0]", "up = 1"): r"camera\.up: is 1, expected a list",
    ("[0.3, 0.8, 0.5]", "[0, 0, 0]"): r"lights\[0\]\.direction: is .*, expected a direction that is not zero",
    ("[3.0, 3.0, 2.8]", "[3.0, -3, 2.8]"): r"lights\[0\]\.irradiance\[1\]: is -3, expected greater than or equal to 0",
    ("[3.0, 3.0, 2.8]", "[3.0, 3, 1e39]"): r"irradiance\[2\]: is 1e\+39, expected less than or equal to 1000000000000$",
    ('"directional"', '"point"'): r"lights\[0\]\.type: is \"point\", expected 'directional'",
    ('type = "directional"\n', ""): r"lights\[0\]\.type: expected a value here, but it is missing",
    ("[0.3, 0.8, 0.5]\n", "[0.3, 0.8]\n"): r"lights\[0\]\.direction\[2\]: expected a value here, but it is missing",
    ("irradiance =", "iradiance ="): r"lights\[0\]\.iradiance: is .*, expected a known key, the nearest is irradiance",
    ('"auto"', '"wood"'): r"materials\[0\]\.type: is \"wood\", expected 'auto', 'metal', 'glossy' or 'matte'",
    ('map = "studio.hdr"', ""): r"environment\.map: expected a value here, but it is missing",
    ("[environment]", "[environment]\nrotation = "): r"line 6, column 12: expected TOML \(Invalid value\)",
    ("[photographs.camera]", "[camera]"): "camera: is .*, expected a known key, the nearest is cameras",
    (LIGHT, LIGHT + "[[geometry]]"): "line .*: expected TOML",
    (PHOTOGRAPH + CAMERA, ""): "photographs: expected a value here, but it is missing",
    (HEAD, "photographs = []" + HEAD): "expected TOML",
    ("[geometry]", "geometry = 1\n[other]"): "other: is .*, expected",
}


@pytest.mark.parametrize(("slip", "sentence"), SLIPS.items())
def test_slips(write, slip, sentence):
    before, after = slip
    assert before in WHOLE
    path = write(WHOLE.replace(before, after, 1))
    with pytest.raises(InputError, match=rf"scene\.toml: .*{sentence}"):
        read_scene(path)


def test_the_mark_that_notepad_begins_with(write):
    path = write(WHOLE)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert len(read_scene(path).photographs) == 1


def test_absurdly_nested_files(write, tmp_path):
    with pytest.raises(InputError, match=r"scene\.toml: .*expected TOML without hundreds"):
        read_scene(write(f"a = {'[' * 20000}{']' * 20000}"))
    path = write(WITH_CAMERAS, {})
    (tmp_path / "transforms.json").write_text("[" * 200000)
    with pytest.raises(InputError, match=r"transforms\.json: .*expected JSON without hundreds"):
        read_scene(path)


@pytest.mark.parametrize("name", ["~nosuchuser/x", "x" * 5000, r"a\u0000b"])
def test_camera_files_of_impossible_names(write, name):
    with pytest.raises(InputError, match=r"scene\.toml: cameras: is .*, expected a file"):
        read_scene(write(f'cameras = "{name}"\n' + HEAD))


def test_cameras_in_a_folder_that_is_no_model(write):
    with pytest.raises(InputError, match=r"expected a COLMAP model in this folder, with cameras\.bin or cameras"):
        read_scene(write('cameras = ""\n' + HEAD))


@pytest.mark.parametrize("name", ["~nosuchuser/x", "x" * 5000, "a\0b", ""])
def test_frames_of_impossible_names(write, name):
    with pytest.raises(InputError, match=r"frames\[0\]\.file_path:.* expected an image"):
        read_scene(write(WITH_CAMERAS, {"camera_angle_x": 1.0, "frames": [{**FRAME, "file_path": name}]}))


def test_no_photographs(write):
    with pytest.raises(InputError, match=r"scene\.toml: photographs: is \[\], expected at least one entry"):
        read_scene(write("photographs = []\n" + HEAD))


@pytest.mark.parametrize("place", ["photographs", "geometry"])
def test_tables_of_the_wrong_kind(write, place):
    text = f"{place} = 3\n" + (HEAD if place == "photographs" else "[environment]" + HEAD.partition("[environment]")[2])
    with pytest.raises(InputError, match=rf"{place}: is 3, expected a (list|table)"):
        read_scene(write(text))


@pytest.mark.parametrize("text", ["[" + ".".join(["a"] * 5000) + "]", "a = " + "[" * 5000, "a = " + "{a=" * 5000])
def test_tables_inside_each_other(write, text):
    """A header's dots need no recursion to read, but to tell of."""
    with pytest.raises(InputError, match=r"expected .* inside each other"):
        read_scene(write(text + "\n"))


@pytest.mark.parametrize(
    "matrix",
    [
        np.diag([2.0, 2, 2, 1]),
        np.diag([-1.0, 1, 1, 1]),
        np.diag([1.0, 1, 1, 2]),
        np.array(POSE) + 1e-3 * np.eye(4, k=1),
        np.full((4, 4), 1e300),  # whose squares overflow
    ],
)
def test_matrices_that_are_no_rigid_motion(write, matrix):
    camera = f"[photographs.camera]\nmatrix = {matrix.tolist()}\n"
    with pytest.raises(InputError, match=r"photographs\[0\]\.camera\.matrix: is .*, expected a rigid motion"):
        read_scene(write(HEAD + PHOTOGRAPH + camera))


@given(st.tuples(*[st.floats(-5, 5)] * 3), st.floats(0, 6))
def test_every_pose_may_be_given_as_its_matrix(target, angle):
    origin = (8 * math.cos(angle), 9.0, 8 * math.sin(angle))
    pose = CameraSpec(origin=origin, target=target).pose()
    up = torch.tensor([0.0, 1, 0])
    torch.testing.assert_close(pose, look_at(torch.tensor(origin).double(), torch.tensor(target).double(), up))
    again = CameraSpec(matrix=tuple(map(tuple, pose.tolist())))
    torch.testing.assert_close(again.pose(), pose)


@given(st.sampled_from(sorted(CameraSpec.model_fields)), st.integers(0, 20), st.sampled_from("abcxyz"))
def test_unknown_keys_get_the_nearest_right_one(key, position, letter):
    wrong = key[:position] + letter + key[position:]
    nearest = difflib.get_close_matches(wrong, list(CameraSpec.model_fields), n=1)
    with pytest.raises(ValueError, match=f"the nearest is {nearest[0]}" if nearest else "expected"):
        CameraSpec.model_validate({wrong: 1})


def test_missing_and_unreadable_scene_files(tmp_path):
    with pytest.raises(InputError, match=r"none\.toml: expected a readable scene file here \(there is none\)"):
        read_scene(tmp_path / "none.toml")
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"bytes\.toml: expected a readable scene file"):
        read_scene(tmp_path / "bytes.toml")
    with pytest.raises(InputError, match="expected a readable scene file"):
        read_scene(tmp_path)


WITH_CAMERAS = 'cameras = "transforms.json"\n' + HEAD


def test_blender_cameras_with_their_images(write, tmp_path):
    frames = [FRAME, {**FRAME, "file_path": "view_1.png", "rotation": 0.1}]
    scene = read_scene(write(WITH_CAMERAS, {"camera_angle_x": math.radians(50), "frames": frames}))
    assert [photograph.image for photograph in scene.photographs] == [tmp_path / "view_0.exr", tmp_path / "view_1.png"]
    for photograph in scene.photographs:
        camera = camera_of(photograph.camera, 8, 8)
        assert camera.fov == pytest.approx(50)
        torch.testing.assert_close(camera.camera_to_world, torch.tensor(POSE).double())


@pytest.mark.parametrize("where", ["file", "frame"])
def test_nerfstudio_focal_length(write, where):
    lens = {"fl_x": 100.0, "fl_y": 100.0, "w": 200, "h": 100, "cx": 100, "cy": 50, "camera_model": "OPENCV"}
    frame = {**FRAME, **(lens if where == "frame" else {})}
    scene = read_scene(write(WITH_CAMERAS, {"frames": [frame], **(lens if where == "file" else {})}))
    camera = camera_of(scene.photographs[0].camera, 400, 200)
    assert camera.fov == pytest.approx(90)
    assert camera.lens is None


def test_listed_photographs_take_cameras_from_the_file(write):
    frames = [{**FRAME, "file_path": "nowhere"}]
    scene = read_scene(write(WITH_CAMERAS + PHOTOGRAPH, {"camera_angle_x": 1.0, "frames": frames}))
    assert scene.photographs[0].mask is not None
    assert scene.photographs[0].camera.fov == pytest.approx(math.degrees(1))


CAMERA_SLIPS = [
    (WITH_CAMERAS + PHOTOGRAPH * 2, {}, r"scene\.toml: photographs: is a list of 2, expected as many as .* cameras, 1"),
    (WITH_CAMERAS + PHOTOGRAPH + CAMERA, {}, r"scene\.toml: photographs\[0\]\.camera: expected no camera beside"),
    (WITH_CAMERAS, {"frames": []}, r"transforms\.json: frames: is \[\], expected at least one entry"),
    (WITH_CAMERAS, {"camera_angle_x": 4.0}, r"transforms\.json: camera_angle_x: is 4\.0, expected less than 3\.14"),
    (WITH_CAMERAS, {"camera_angle_x": None}, r"transforms\.json: frames\[0\]: expected camera_angle_x, or fl_x and w"),
    (WITH_CAMERAS, {"k1": 0.1}, r"transforms\.json: frames\[0\]: expected w and h beside fl_y, cx"),
    (WITH_CAMERAS, {"cx": 3, "w": 10}, r"frames\[0\]: expected w and h beside fl_y, cx"),
    (WITH_CAMERAS, {"fl_x": 3, "fl_y": 4}, r"frames\[0\]: expected w and h beside fl_y, cx"),
    (WITH_CAMERAS, {"k4": 0.1}, r"frames\[0\]\.k4: is 0\.1, expected 0: undistort the images first"),
    (WITH_CAMERAS, {"camera_model": "OPENCV_FISHEYE"}, r"camera_model: is OPENCV_FISHEYE, expected one of OPENCV, "),
    (
        WITH_CAMERAS,
        {"w": 100, "h": 100, "k1": -3.0},
        r"photographs\[0\]\.camera\.lens: is .k1 = -3, .*, expected distortion that does not fold the picture over",
    ),
    (WITH_CAMERAS, {"frames": [{**FRAME, "file_path": "no"}]}, r"frames\[0\]\.file_path: is no, expected an image"),
    (WITH_CAMERAS, {"frames": [{"file_path": "view_0"}]}, r"frames\[0\]\.transform_matrix: expected a value here"),
    (WITH_CAMERAS, {"frames": [{**FRAME, "transform_matrix": POSE[:3]}]}, r"transform_matrix\[3\]: expected a value"),
]


@pytest.mark.parametrize(("text", "change", "sentence"), CAMERA_SLIPS)
def test_slips_in_camera_files(write, text, change, sentence):
    path = write(text, {"camera_angle_x": 1.0, "frames": [FRAME], **change})
    with pytest.raises(InputError, match=sentence):
        read_scene(path)


def test_camera_files_that_are_missing_or_no_json(write, tmp_path):
    with pytest.raises(InputError, match=r"scene\.toml: cameras: is .*transforms\.json.*, expected a file"):
        read_scene(write(WITH_CAMERAS))
    (tmp_path / "transforms.json").write_text('{"frames": [}')
    with pytest.raises(InputError, match=r"transforms\.json: line 1, column 13: expected JSON"):
        read_scene(write(WITH_CAMERAS))
    with pytest.raises(InputError, match=r"scene\.toml: cameras: is 3, expected a path"):
        read_scene(write("cameras = 3\n" + HEAD))
