"""Cameras of Mitsuba's scene files: as Mitsuba itself reads them, and without running what the files name."""

import mitsuba as mi
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from fit_material.renderer.camera_files.mitsuba_sensors import read_sensors
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.scene.scene_file import Scene, camera_of, read_scene

HEAD = '[geometry]\nshape = "sphere"\n[environment]\nmap = "sky.exr"\n'
SENSORS = """<scene version="3.0.0">
  <default name="width" value="60"/>
  <integrator type="path"/>
  <sensor type="perspective">
    <float name="fov" value="50"/>
    <string name="fov_axis" value="smaller"/>
    <transform name="to_world"><lookat origin="1, 2, 4" target="0.2, -0.3, 0.1" up="0.1, 1, -0.2"/></transform>
    <film type="hdrfilm"><integer name="width" value="$width"/><integer name="height" value="40"/></film>
  </sensor>
  <sensor type="perspective">
    <float name="fov" value="50"/>
    <float name="principal_point_offset_x" value="0.1"/>
    <float name="principal_point_offset_y" value="-0.2"/>
    <transform name="to_world">
      <rotate y="1" angle="30"/><translate x="1" y="0.5" z="-3"/>
    </transform>
    <film type="hdrfilm"><integer name="width" value="40"/><integer name="height" value="60"/></film>
  </sensor>
  <sensor type="orthographic">
    <transform name="to_world">
      <scale x="1.3" y="1.3"/><lookat origin="1, 2, 4" target="0.2, -0.3, 0.1" up="0.1, 1, -0.2"/>
    </transform>
    <film type="hdrfilm"><integer name="width" value="50"/><integer name="height" value="30"/></film>
  </sensor>
  AWAY
</scene>"""
AWAY = '<shape type="obj"><string name="filename" value="nowhere.obj"/></shape>'
SENSORS = SENSORS.replace("AWAY", AWAY)
FILMS = [(60, 40), (40, 60), (50, 30)]
OFFSETS = ("principal_point_offset_x", "principal_point_offset_y")


@pytest.fixture
def xml(tmp_path):
    """A scene of three photographs by the sensors of an XML file, which may be changed."""
    for i, size in enumerate(FILMS):
        Image.new("RGB", size).save(tmp_path / f"{i}.png")
    (tmp_path / "sky.exr").write_bytes(b"")
    listed = "".join(f'[[photographs]]\nimage = "{i}.png"\n' for i in range(len(FILMS)))

    def write(text: str, photographs: str = listed) -> Scene:
        (tmp_path / "scene.xml").write_text(text)
        (tmp_path / "scene.toml").write_text('cameras = "scene.xml"\n' + HEAD + photographs)
        return read_scene(tmp_path / "scene.toml")

    return write


def by_mitsuba(text: str) -> list:
    """The sensors as Mitsuba makes them, of a file of ours, which names its own plugins alone."""
    mi.set_variant("scalar_rgb")
    return mi.load_string(text).sensors()


def test_mitsuba_sensors_see_along_mitsuba_s_rays(xml):
    found = xml(SENSORS)
    whole = by_mitsuba(SENSORS.replace(AWAY, ""))
    for sensor, size, photograph in zip(whole, FILMS, found.photographs, strict=True):
        camera = camera_of(photograph.camera, *size)
        positions = np.random.default_rng(5).random((30, 2))
        start, direction = camera.rays(*torch.from_numpy(positions * size).T)
        for index, position in enumerate(positions):
            ray, _ = sensor.sample_ray(0.0, 0.5, mi.Point2f(*position.tolist()), mi.Point2f(0.5))
            along = np.array(ray.d)
            # Mitsuba works in float32, and its projection matrix divides by near and far plane: 1e-5 is left
            np.testing.assert_allclose(direction[index], along, atol=1e-5)
            offset = start[index].numpy() - np.array(ray.o)
            np.testing.assert_allclose(np.cross(offset, along), 0, atol=1e-4)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('type="orthographic"', 'type="radiancemeter"', r"sensor\[2\]: is radiancemeter, expected one of ortho"),
        ("<sensor", "<!--", r"scene\.xml: expected a readable XML file \("),
        (
            'value="$width"',
            'value="$size"',
            r"sensor\[0\]: is \$size, expected a \$name that a <default> before it gives a value$",
        ),
        (
            'value="40"/></film>',
            'value="40"/><integer name="crop_width" value="9"/></film>',
            "film: is cropped, expected a film that is seen as a whole$",
        ),
        ("sensor", "shape", r"scene\.xml: expected at least one sensor, not in an include"),
    ],
)
def test_slips_in_mitsuba_s_files(xml, old, new, sentence):
    with pytest.raises(InputError, match=sentence):
        xml(SENSORS.replace(old, new))


def test_mitsuba_s_files_name_no_images(xml):
    with pytest.raises(InputError, match=r"scene\.xml: expected \[\[photographs\]\] in the scene, one for each sensor"):
        xml(SENSORS, "")
    with pytest.raises(InputError, match=r"photographs: is a list of 1, expected as many as scene\.xml has cameras, 3"):
        xml(SENSORS, '[[photographs]]\nimage = "0.png"\n')


def scene(inside: str, kind: str = "perspective", version: str = "3.0.0", before: str = "") -> str:
    return f'<scene version="{version}">{before}<sensor type="{kind}">{inside}</sensor></scene>'


def film(width: int, height: int) -> str:
    sides = f'<integer name="width" value="{width}"/><integer name="height" value="{height}"/>'
    return f'<film type="hdrfilm">{sides}<rfilter type="box"/></film><sampler type="independent"/>'


def placed(*parts: str) -> str:
    return f'<transform name="to_world">{"".join(parts)}</transform>'


def ours(tmp_path, text: str) -> dict:
    path = tmp_path / "scene.xml"
    path.write_text(text)
    return read_sensors(path)[0]["camera"]


def assert_as_mitsuba(camera: dict, text: str) -> None:
    """The same matrix, field of view and middle of the film, to the float32 that Mitsuba keeps them in."""
    sensor = by_mitsuba(text)[0]
    expected = np.array(sensor.world_transform().matrix, float) @ np.diag([-1, 1, -1, 1])
    scale = camera.get("scale", 1.0)
    matrix = np.array(camera["matrix"])
    size = np.abs(expected).max()
    np.testing.assert_allclose(matrix[:3, :2] * scale, expected[:3, :2], atol=1e-6 * size)
    np.testing.assert_allclose(matrix[:, 3], expected[:, 3], atol=1e-6 * size)
    np.testing.assert_allclose(matrix[:3, 2], expected[:3, 2] / np.linalg.norm(expected[:3, 2]), atol=1e-6)
    if "lens" in camera:
        found = mi.traverse(sensor)
        names = [name for name in ("x_fov", *OFFSETS) if name in found]
        numbers = {name: float(np.ravel(np.array(found[name]))[0]) for name in names}
        lens, (width, height) = camera["lens"], sensor.film().size()
        assert (lens["width"], lens["height"]) == (width, height)
        assert np.tan(np.radians(numbers["x_fov"]) / 2) == pytest.approx(width / (2 * lens["fx"]), rel=1e-5)
        for axis, side in (("x", width), ("y", height)):
            offset = numbers.get(f"principal_point_offset_{axis}", 0.0)
            assert lens[f"c{axis}"] == pytest.approx(side * (0.5 - offset), abs=1e-6 * side)


FOV = '<float name="fov" value="33.3"/>'
TURNED = placed('<rotate value="0 0 1" angle="-20"/>', '<lookat origin="3,1,2" target="0 0 0"/>')
ALIKE = {
    "nothing": scene(""),
    "integers": scene('<integer name="fov" value="40"/>'),
    "a plus": scene('<float name="fov" value=" +4e1 "/>'),
    "focal length": scene('<string name="focal_length" value="35mm"/>' + film(64, 48)),
    "focal length without unit": scene('<string name="focal_length" value=" 85 "/>' + film(48, 64)),
    "offsets": scene(FOV + '<float name="principal_point_offset_y" value="0.25"/>' + film(9, 5)),
    "thin lens": scene(FOV + TURNED + '<float name="aperture_radius" value="0.1"/>' + film(8, 8), "thinlens"),
    "clipping": scene(FOV + '<float name="near_clip" value="0.5"/><float name="far_clip" value="9"/>'),
    "shutter": scene('<float name="shutter_open" value="0.5"/><float name="shutter_close" value="0.75"/>'),
    "no up": scene(FOV + TURNED),
    "no up, downwards": scene(placed('<lookat origin="1 2 3" target="1 2 -4" up="0 0 0"/>')),
    "nine numbers": scene(placed('<matrix value="0 0 1, 1 0 0, 0 1 0"/>')),
    "sixteen numbers": scene(placed('<matrix value="0 0 1 5, 1 0 0 6, 0 1 0 7, 0 0 0 1"/>')),
    "mirrored": scene(placed('<scale x="-1"/>', '<translate value="2"/>')),
    "orthographic": scene(placed('<scale value="2.5"/>', '<rotate x="1" angle="77"/>') + film(64, 48), "orthographic"),
    "defaults": scene(
        '<float name="fov" value="$wide2"/>', before='<default name="w" value="4"/><default name="wide" value="$w"/>'
    ),
    "the first default": scene(
        '<float name="fov" value="$w"/>', before='<default name="w" value="4"/><default name="w" value="5"/>'
    ),
    "a default elsewhere": scene(
        '<float name="fov" value="$w"/>', before='<shape type="sphere"><default name="w" value="44"/></shape>'
    ),
    "old names": scene(
        '<string name="fovAxis" value="y"/><float name="fov" value="40"/><transform name="toWorld"/>', version="0.6.0"
    ),
}


@pytest.mark.parametrize("name", ALIKE)
def test_sensors_are_read_as_mitsuba_reads_them(tmp_path, name):
    assert_as_mitsuba(ours(tmp_path, ALIKE[name]), ALIKE[name])


@pytest.mark.parametrize("axis", ["x", "y", "diagonal", "smaller", "LARGER"])
@pytest.mark.parametrize("size", [(64, 48), (48, 64), (50, 50)])
def test_fields_of_view_along_every_side(tmp_path, axis, size):
    text = scene(FOV + f'<string name="fov_axis" value="{axis}"/>' + film(*size))
    assert_as_mitsuba(ours(tmp_path, text), text)


lengths = st.floats(-100, 100).map(lambda value: round(value, 4))
vectors = st.tuples(lengths, lengths, lengths)
directions = vectors.filter(lambda v: np.linalg.norm(v) > 1).map(lambda v: (np.array(v) / np.linalg.norm(v)).tolist())
PARTS = st.one_of(
    vectors.map(lambda v: f'<translate value="{v[0]},{v[1]} {v[2]}"/>'),
    st.tuples(st.sampled_from("xyz"), lengths).map(lambda part: f'<translate {part[0]}="{part[1]}"/>'),
    st.tuples(st.sampled_from("xyz"), st.floats(-720, 720)).map(lambda p: f'<rotate {p[0]}="1" angle="{p[1]!r}"/>'),
    st.tuples(directions, st.floats(-180, 180)).map(
        lambda p: f'<rotate value="{p[0][0]} {p[0][1]} {p[0][2]}" angle="{p[1]!r}"/>'
    ),
)
LOOKAT = st.tuples(vectors, directions, st.floats(1, 50), directions).filter(
    lambda p: np.linalg.norm(np.cross(p[1], p[3])) > 0.1
)


@given(parts=st.lists(PARTS, max_size=5), lookat=st.none() | LOOKAT, scale=st.floats(0.01, 50))
def test_transforms_are_mitsuba_s(tmp_path_factory, parts, lookat, scale):
    if lookat is not None:
        origin, towards, distance, up = (np.array(each) for each in lookat)
        words = (" ".join(map(repr, each.tolist())) for each in (origin, origin + distance * towards, up))
        parts = [*parts, '<lookat origin="{}" target="{}" up="{}"/>'.format(*words)]
    folder = tmp_path_factory.getbasetemp()
    for text in (
        scene(placed(*parts)),
        scene(placed(f'<scale x="{scale}" y="{scale}"/>', *parts), "orthographic"),
    ):
        assert_as_mitsuba(ours(folder, text), text)


def test_an_include_beside_the_sensors_does_no_harm(tmp_path):
    text = scene(FOV, before='<include filename="materials.xml"/>')
    assert ours(tmp_path, text) == ours(tmp_path, scene(FOV))
