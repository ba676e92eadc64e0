"""What we write, through the readers that users have: Assimp, tinyobjloader, trimesh, our own, and F3D's pictures."""

import importlib.util
import json
import math
import shutil
import subprocess
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import tinyobjloader
import trimesh
from PIL import Image

from fit_material.fitter.export.mtl import Maps, ordinary_mtl, thesis_mtl
from fit_material.fitter.result.schema import FittedMaterial
from fit_material.renderer.materials.mtl_reader import read_mtl
from fit_material.renderer.materials.mtl_syntax import read_blocks

Found = dict[str, dict[str, object]]
"""By material and key: float32 numbers, and names of files."""

MAPS = Maps(color="c.png", normal="n.png", ambient_occlusion="ao.png")


def float32(*values) -> tuple[np.float32, ...]:
    return tuple(np.float32(value) for value in values)


def materials(low=1e-2, high=9e5, count=100) -> list[FittedMaterial]:
    """Materials of all types, whose numbers are float32 from all over [low, high].

    Between 10⁻⁴ and 10⁶ no number, nor the product of two below 1, is printed with an exponent.
    """
    generator = np.random.default_rng(7)

    def draw(top, size=3):
        exponents = generator.uniform(math.log(low), math.log(top), size)
        return tuple(float(value) for value in np.exp(exponents).astype(np.float32))

    def draw_one(index) -> FittedMaterial:
        kind = ("metal", "glossy", "matte")[index % 3]
        (alpha,), (roughness,) = draw(1.0, 1), draw(high, 1)
        values = {"f0": draw(1.0), "alpha": alpha, "roughness": roughness}
        values |= (
            {"n": draw(high), "k": draw(high)} if kind == "metal" else {"color": draw(1.0), "reflectance": draw(1.0)}
        )
        return FittedMaterial(name=f"m{index}", type=kind, **values)

    return [draw_one(index) for index in range(count)]


def write(folder: Path, text: str, names: list[str]) -> Path:
    """An OBJ with a triangle of each material, its MTL and the maps."""
    for file in ("c.png", "n.png", "ao.png"):
        Image.new("RGB", (1, 1), (128, 128, 255)).save(folder / file)
    (folder / "a.mtl").write_text(text, encoding="utf-8")
    faces = "".join(f"usemtl {name}\nf 1/1 2/1 3/1\n" for name in names)
    (folder / "a.obj").write_text("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\n" + faces, encoding="utf-8")
    return folder / "a.obj"


def by_our_parser(obj: Path) -> Found:
    blocks = {block.name: block for block in read_blocks(obj.with_suffix(".mtl"))}
    return {
        name: {key: float32(*(block.triple(key) or (0, 0, 0))) for key in ("Kd", "Ka", "Ks")}
        | {"Ns": np.float32(block.number("Ns"))}
        | {"Pr": np.float32(block.number("Pr") or 0), "Pm": np.float32(block.number("Pm") or 0)}
        | {"map_Kd": block.values.get("map_kd", ""), "map_Ka": block.values.get("map_ka", "")}
        | {"bump": block.values.get("bump", "").removeprefix("-bm 1.0 ")}
        for name, block in blocks.items()
    }


def by_tinyobjloader(obj: Path) -> Found:
    reader = tinyobjloader.ObjReader()
    assert reader.ParseFromFile(str(obj), tinyobjloader.ObjReaderConfig()), reader.Error()
    return {
        m.name: {"Kd": float32(*m.diffuse), "Ka": float32(*m.ambient), "Ks": float32(*m.specular)}
        | {"Ns": np.float32(m.shininess), "Pr": np.float32(m.roughness), "Pm": np.float32(m.metallic)}
        | {"map_Kd": m.diffuse_texname, "map_Ka": m.ambient_texname, "bump": m.bump_texname}
        for m in reader.GetMaterials()
    }


def by_trimesh(obj: Path) -> Found:
    """trimesh opens the colour map itself, and keeps the words of keys that it does not know."""
    parsed = trimesh.exchange.obj.parse_mtl(
        obj.with_suffix(".mtl").read_text("utf-8"), resolver=trimesh.resolvers.FilePathResolver(obj.parent)
    )
    return {
        name: {key: float32(*m.get(key.lower(), (0, 0, 0))) for key in ("Kd", "Ka", "Ks")}
        | {"Ns": np.float32(m["ns"])}
        | {key: np.float32(m.get(key.lower(), [0])[0]) for key in ("Pr", "Pm")}
        | {
            "map_Kd": "c.png" if "image" in m else "",
            "map_Ka": m.get("map_ka", [""])[0],
            "bump": m.get("bump", [""])[-1],
        }
        for name, m in parsed.items()
    }


def by_assimp_py(obj: Path) -> Found:
    """Assimp's own library under Python, which does not hand out Pr and Pm."""
    import assimp_py

    colours = {"Kd": "COLOR_DIFFUSE", "Ka": "COLOR_AMBIENT", "Ks": "COLOR_SPECULAR"}
    textures = {"map_Kd": "DIFFUSE", "map_Ka": "AMBIENT", "bump": "HEIGHT"}
    return {
        m["NAME"]: {key: float32(*m[name]) for key, name in colours.items()}
        | {"Ns": np.float32(m["SHININESS"])}
        | {key: m["TEXTURES"].get(getattr(assimp_py, f"TextureType_{kind}"), [""])[0] for key, kind in textures.items()}
        for m in assimp_py.import_file(str(obj), 0).materials
        if m["NAME"] != "DefaultMaterial"
    }


def by_assimp_utils(obj: Path) -> Found:
    """Debian's program, which prints six digits."""
    command = ["assimp", "export", obj.name, "a.json", "-f", "assjson"]
    subprocess.run(command, cwd=obj.parent, check=True, capture_output=True)
    numbers = {"Kd": "$clr.diffuse", "Ka": "$clr.ambient", "Ks": "$clr.specular"}
    single = {"Ns": "$mat.shininess", "Pr": "$mat.roughnessFactor", "Pm": "$mat.metallicFactor"}
    textures = {"map_Kd": 1, "map_Ka": 3, "bump": 5}  # aiTextureType_DIFFUSE, _AMBIENT, _HEIGHT
    found: Found = {}
    for material in json.loads((obj.parent / "a.json").read_text())["materials"]:
        values = {(p["key"], p["semantic"]): p["value"] for p in material["properties"]}
        found[values["?mat.name", 0]] = {
            **{key: float32(*values[name, 0]) for key, name in numbers.items()},
            **{key: np.float32(values.get((name, 0), 0)) for key, name in single.items()},
            **{key: values.get(("$tex.file", kind), "") for key, kind in textures.items()},
        }
    found.pop("DefaultMaterial", None)
    return found


def needs(module: str):
    return pytest.mark.skipif(importlib.util.find_spec(module) is None, reason=f"{module} is not installed")


no_assimp = pytest.mark.skipif(shutil.which("assimp") is None, reason="no assimp: apt-get install assimp-utils")
EXACT = [
    by_our_parser,
    by_tinyobjloader,
    by_trimesh,
    pytest.param(by_assimp_py, marks=needs("assimp_py")),
]
ALL = [*EXACT, pytest.param(by_assimp_utils, marks=no_assimp)]


def thesis_numbers(m: FittedMaterial) -> dict:
    """MODEL.md, 5, the table."""
    kd, ka = (m.n, m.k) if m.type == "metal" else (m.color, m.reflectance)
    rho = 0.0 if m.type == "matte" else m.roughness
    code = {"matte": 0, "glossy": 1, "metal": 2}[m.type]
    return {"Kd": float32(*kd), "Ka": float32(*ka), "Ks": float32(rho, rho, rho), "Ns": np.float32(code)}


def ordinary_numbers(m: FittedMaterial) -> dict:
    """The colours only: Ns, Pr and Pm have tests of their own."""
    if m.type == "metal":
        return {"Kd": float32(*m.f0), "Ks": float32(*m.f0)}
    if m.type == "glossy":
        return {"Kd": float32(*m.color), "Ks": float32(*m.reflectance)}
    product = [c * f for c, f in zip(m.color, m.reflectance, strict=True)]  # in float64, as %.9g prints it
    return {"Kd": float32(*(f"{value:.9g}" for value in product)), "Ks": float32(0, 0, 0)}


WRITERS = [(thesis_mtl, thesis_numbers), (ordinary_mtl, ordinary_numbers)]


@pytest.mark.parametrize(("writer", "expected"), WRITERS)
@pytest.mark.parametrize("reader", EXACT)
def test_every_reader_has_the_same_float32(tmp_path, reader: Callable[[Path], Found], writer, expected):
    written = materials()
    found = reader(write(tmp_path, writer(written), [m.name for m in written]))
    assert sorted(found) == sorted(m.name for m in written)
    for material in written:
        numbers = expected(material)
        assert {key: found[material.name][key] for key in numbers} == numbers


@pytest.mark.parametrize("reader", EXACT)
def test_numbers_of_any_size(tmp_path, reader):
    """Printed with an exponent they are exact, too; Assimp may miss them by the last bit, for it multiplies by 10ⁿ."""
    written = materials(low=1e-36, high=1e36)
    found = reader(write(tmp_path, thesis_mtl(written), [m.name for m in written]))
    for material in written:
        for key, expected in thesis_numbers(material).items():
            tolerance = 2.0**-23 if reader is by_assimp_py else 0
            np.testing.assert_allclose(found[material.name][key], expected, rtol=tolerance, atol=0)


@no_assimp
@pytest.mark.parametrize(("writer", "expected"), WRITERS)
def test_debian_s_assimp_has_the_same_to_the_digits_that_it_prints(tmp_path, writer, expected):
    written = materials()
    found = by_assimp_utils(write(tmp_path, writer(written), [m.name for m in written]))
    assert sorted(found) == sorted(m.name for m in written)
    for material in written:
        for key, numbers in expected(material).items():
            np.testing.assert_allclose(found[material.name][key], numbers, rtol=5.1e-6, atol=0)  # half of the sixth


@pytest.mark.parametrize("reader", ALL)
def test_roughness_and_metalness(tmp_path, reader):
    written = materials(count=9)
    found = reader(write(tmp_path, ordinary_mtl(written), [m.name for m in written]))
    for material in written:
        alpha = 1.0 if material.type == "matte" else material.alpha
        values = found[material.name]
        # six digits, as Assimp's program prints them, of √alpha to nine
        assert values["Ns"] == pytest.approx(min(2 / alpha**2 - 2, 1000), rel=1e-5)
        assert values.get("Pr", math.sqrt(alpha)) == pytest.approx(math.sqrt(alpha), rel=1e-5)
        assert values.get("Pm", material.type == "metal") == (material.type == "metal")


@pytest.mark.parametrize(("writer", "ao"), [(thesis_mtl, "ao.png"), (ordinary_mtl, "")])
@pytest.mark.parametrize("reader", ALL)
def test_maps(tmp_path, reader, writer, ao):
    """Assimp has `bump` for a HEIGHT and `map_Ka` for an AMBIENT texture, as MODEL.md says."""
    written = materials(count=6)
    text = writer(written, maps={"m1": MAPS, "m3": MAPS})
    found = reader(write(tmp_path, text, [m.name for m in written]))
    for material in written:
        expected = {"map_Kd": "c.png", "map_Ka": ao, "bump": "n.png"} if material.name in ("m1", "m3") else {}
        for key in ("map_Kd", "map_Ka", "bump"):
            assert found[material.name][key] == expected.get(key, "")


@pytest.mark.parametrize(("writer", "occlusion"), [(thesis_mtl, True), (ordinary_mtl, False)])
def test_our_own_reader_finds_the_maps(tmp_path, writer, occlusion):
    written = materials(count=6)
    obj = write(tmp_path, writer(written, maps={"m1": MAPS}), [])
    library = read_mtl(obj.with_suffix(".mtl"))
    maps = library.appearances["m1"].maps
    assert library.remarks == ()
    assert maps.color is not None
    assert maps.normal is not None
    assert (maps.ambient_occlusion is not None) == occlusion
    assert [appearance.material.type for appearance in library.appearances.values()] == [m.type for m in written]


SCREENSHOT = textwrap.dedent(
    """
    import json, sys
    import f3d
    import numpy as np

    f3d.Log.set_verbose_level(f3d.Log.QUIET)
    f3d.Engine.autoload_plugins()
    engine = f3d.Engine.create(True)
    engine.window.size = (96, 96)
    engine.scene.add(sys.argv[1])
    picture = engine.window.render_to_image(True)
    pixels = np.frombuffer(picture.content, np.uint8).reshape(-1, picture.channel_count)
    print("mean", json.dumps(pixels[pixels[:, 3] == 255, :3].mean(0).tolist()))
    """
)


@pytest.fixture
def picture(tmp_path):
    """The mean colour of a sphere in F3D, in a process of its own, for it is native code that draws."""

    def draw(text: str) -> np.ndarray:
        sphere = trimesh.creation.uv_sphere(count=[24, 48])
        lines = [f"v {x} {y} {z}\nvn {x} {y} {z}" for x, y, z in sphere.vertices]
        faces = ["f " + " ".join(f"{i + 1}//{i + 1}" for i in face) for face in sphere.faces]
        (tmp_path / "a.obj").write_text("\n".join(["mtllib a.mtl", *lines, "usemtl ball", *faces]))
        (tmp_path / "a.mtl").write_text(text)
        command = [sys.executable, "-c", SCREENSHOT, str(tmp_path / "a.obj")]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
        assert done.returncode == 0, done.stderr
        return np.array(json.loads(done.stdout.partition("mean ")[2]))

    return draw


GOLD = FittedMaterial(
    name="ball", type="metal", n=(0.15, 0.43, 1.4), k=(3.5, 2.3, 1.9), f0=(0.96, 0.77, 0.39), alpha=0.25, roughness=0.7
)
RED = FittedMaterial(name="ball", type="matte", color=(0.8, 0.05, 0.05), reflectance=(1.0, 1.0, 1.0))


@pytest.mark.slow
@needs("f3d")
def test_f3d_shows_the_colours_of_the_ordinary_file(picture):
    red = picture(ordinary_mtl([RED]))
    assert red[0] > 2 * max(red[1:])
    gold = picture(ordinary_mtl([GOLD]))
    # a highlight of white light pales a colour that is multiplied by grey light, so the shares come near F0's
    np.testing.assert_allclose(gold / gold[0], np.array(GOLD.f0) / GOLD.f0[0], atol=0.15)
    assert gold[0] > gold[1] > gold[2]


@pytest.mark.slow
@needs("f3d")
def test_f3d_loads_the_thesis_s_file_and_takes_n_for_a_colour(picture):
    """Why there are two files: gold's n looks blue."""
    shown = picture(thesis_mtl([GOLD]))
    assert shown[2] > shown[1] > shown[0] > 0
