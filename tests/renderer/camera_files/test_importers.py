"""Cameras that other programs wrote: COLMAP by pycolmap, nerfstudio by COLMAP's numbers."""

import json

import numpy as np
import pytest
import torch
from PIL import Image

from fit_material.fitter.observations.scene_data import input_files
from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.scene.scene_file import Scene, camera_of, read_scene

pycolmap = pytest.importorskip("pycolmap")

WIDTH, HEIGHT = 640, 480
HEAD = '[geometry]\nshape = "sphere"\n[environment]\nmap = "sky.exr"\n'
MODELS = {
    "SIMPLE_PINHOLE": [500, 320, 240],
    "PINHOLE": [500, 510, 330, 225],
    "SIMPLE_RADIAL": [500, 320, 240, -0.1],
    "RADIAL": [500, 315, 250, -0.1, 0.02],
    "OPENCV": [500, 510, 330, 225, -0.1, 0.02, 0.001, 0.002],
    "FULL_OPENCV": [500, 510, 330, 225, -0.1, 0.02, 0.001, 0.002, 0.003, 0, 0, 0],
}
NAMES = [f"left/view {i}.png" for i in range(len(MODELS))]


def pose(seed: int) -> "pycolmap.Rigid3d":
    rng = np.random.default_rng(seed)
    rotation = rng.normal(size=4)
    return pycolmap.Rigid3d(pycolmap.Rotation3d(rotation / np.linalg.norm(rotation)), rng.normal(size=3))


@pytest.fixture
def model():
    """One image by each camera model, their numbers in an order other than their names'."""
    found = pycolmap.Reconstruction()
    for i, (name, parameters) in reversed(list(enumerate(MODELS.items()))):
        size = {"width": WIDTH, "height": HEIGHT, "camera_id": 10 + i}
        found.add_camera_with_trivial_rig(pycolmap.Camera(model=name, params=parameters, **size))
        image = pycolmap.Image(name=NAMES[i], camera_id=10 + i, image_id=20 - i)
        image.points2D = [pycolmap.Point2D(np.array([1.5, 2.5 + j])) for j in range(i)]
        found.add_image_with_trivial_frame(image, pose(i))
    return found


@pytest.fixture
def project(tmp_path):
    """A COLMAP project with its pictures; returns the folder of the model."""
    for name in NAMES:
        path = tmp_path / "images" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.new("RGB", (4, 3)).save(path)
    (tmp_path / "sky.exr").write_bytes(b"")
    (tmp_path / "sparse" / "0").mkdir(parents=True)
    return tmp_path / "sparse" / "0"


def written(model, folder, form: str) -> None:
    model.write_text(str(folder)) if form == "text" else model.write_binary(str(folder))


def scene(folder, text: str) -> Scene:
    (folder / "scene.toml").write_text(text)
    return read_scene(folder / "scene.toml")


def by_colmap(model, name: str, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Origin and unit directions of the rays through pixels, in the world."""
    image = next(image for image in model.images.values() if image.name == name)
    plane = model.cameras[image.camera_id].cam_from_img(pixels)
    directions = np.column_stack([plane, np.ones(len(plane))])
    directions = directions @ image.cam_from_world().rotation.matrix()  # transposed twice
    return image.projection_center(), directions / np.linalg.norm(directions, axis=1, keepdims=True)


def assert_sees_as_colmap(model, name: str, camera: Camera) -> None:
    pixels = np.random.default_rng(4).random((50, 2)) * [WIDTH, HEIGHT]
    origins, directions = camera.rays(*torch.from_numpy(pixels).T)
    origin, expected = by_colmap(model, name, pixels)
    np.testing.assert_allclose(origins.numpy(), np.broadcast_to(origin, origins.shape), atol=1e-12)
    np.testing.assert_allclose(directions.numpy(), expected, atol=1e-9)  # COLMAP stops undistorting at 10⁻¹⁰


@pytest.mark.parametrize("form", ["text", "binary"])
def test_colmap_models_with_their_images(model, project, form):
    written(model, project, form)
    found = scene(project.parents[1], 'cameras = "sparse/0"\n' + HEAD)
    assert [photograph.image.name for photograph in found.photographs] == [name.split("/")[1] for name in NAMES]
    for name, photograph in zip(NAMES, found.photographs, strict=True):
        assert_sees_as_colmap(model, name, camera_of(photograph.camera, WIDTH, HEIGHT))


def test_a_result_names_the_model_s_files(model, project):
    written(model, project, "binary")
    found = scene(project.parents[1], 'cameras = "sparse/0"\n' + HEAD)
    named = {file.path for file in input_files(found, project.parents[1] / "scene.toml")}
    assert {str(project / "cameras.bin"), str(project / "images.bin")} < named
    assert {str(photograph.image) for photograph in found.photographs} < named


def test_listed_photographs_have_colmap_s_camera_of_their_name(model, project):
    written(model, project, "binary")
    listed = "".join(f'[[photographs]]\nimage = "images/{NAMES[i]}"\n' for i in (4, 1))
    found = scene(project.parents[1], 'cameras = "sparse/0"\n' + HEAD + listed)
    for i, photograph in zip((4, 1), found.photographs, strict=True):
        assert_sees_as_colmap(model, NAMES[i], camera_of(photograph.camera, WIDTH, HEIGHT))


def test_images_that_the_model_does_not_know(model, project):
    written(model, project, "text")
    Image.new("RGB", (4, 3)).save(project.parents[1] / "new.png")
    with pytest.raises(InputError, match=r"images\.txt: expected one image new\.png, but none is called so"):
        scene(project.parents[1], 'cameras = "sparse/0"\n' + HEAD + '[[photographs]]\nimage = "new.png"\n')


@pytest.mark.parametrize("rotation", ["0 0 0 0", "1 nan 0 0"])
def test_rotations_that_are_none(model, project, rotation):
    model.write_text(str(project))
    for file in ("cameras.bin", "images.bin"):
        (project / file).unlink(missing_ok=True)
    lines = (project / "images.txt").read_text().splitlines()
    first = next(i for i, line in enumerate(lines) if line and not line.startswith("#"))
    number, *_, x, y, z, camera, name = lines[first].split(" ", 9)
    lines[first] = " ".join([number, rotation, x, y, z, camera, name])
    (project / "images.txt").write_text("\n".join(lines))
    with pytest.raises(InputError, match=rf"images\.txt: rotation of .*: is {rotation}, expected a quaternion"):
        scene(project.parents[1], 'cameras = "sparse/0"\n' + HEAD)


def test_images_that_are_away(model, project):
    written(model, project, "text")
    (project.parents[1] / "images" / NAMES[2]).unlink()
    with pytest.raises(InputError, match=r"images\.txt: expected an image left/view 2\.png in a folder images"):
        scene(project.parents[1], 'cameras = "sparse/0"\n' + HEAD)


@pytest.mark.parametrize("form", ["text", "binary"])
def test_lenses_beyond_the_five_distortions(project, form):
    model = pycolmap.Reconstruction()
    fisheye = pycolmap.Camera(model="OPENCV_FISHEYE", width=4, height=3, params=[4, 4, 2, 1, 0, 0, 0, 0], camera_id=1)
    model.add_camera_with_trivial_rig(fisheye)
    written(model, project, form)
    with pytest.raises(InputError, match=r"cameras\.\w+: camera model: is .*, expected one of SIMPLE_PINHOLE, "):
        scene(project.parents[1], 'cameras = "sparse/0"\n' + HEAD)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.7, 0.95])
@pytest.mark.parametrize("name", ["cameras.bin", "images.bin"])
def test_models_that_are_cut_off(model, project, name, share):
    written(model, project, "binary")
    data = (project / name).read_bytes()
    (project / name).write_bytes(data[: int(share * len(data))])
    with pytest.raises(InputError, match=rf"{name}: expected a readable file of a COLMAP model \(it is cut off, or no"):
        scene(project.parents[1], 'cameras = "sparse/0"\n' + HEAD)


def test_nerfstudio_s_intrinsics_are_colmap_s(model, project):
    """nerfstudio keeps COLMAP's parameters; its matrices are camera to world in OpenGL's axes, as ours."""
    image = next(image for image in model.images.values() if image.name == NAMES[4])
    matrix = np.eye(4)
    matrix[:3] = image.cam_from_world().inverse().matrix()
    matrix[:3, 1:3] *= -1
    keys = ("fl_x", "fl_y", "cx", "cy", "k1", "k2", "p1", "p2")
    frame = {"file_path": f"images/{NAMES[4]}", "transform_matrix": matrix.tolist()}
    lens = {"camera_model": "OPENCV", "w": WIDTH, "h": HEIGHT, **dict(zip(keys, MODELS["OPENCV"], strict=True))}
    (project.parents[1] / "transforms.json").write_text(json.dumps({**lens, "frames": [frame]}))
    found = scene(project.parents[1], 'cameras = "transforms.json"\n' + HEAD)
    assert_sees_as_colmap(model, NAMES[4], camera_of(found.photographs[0].camera, WIDTH, HEIGHT))
