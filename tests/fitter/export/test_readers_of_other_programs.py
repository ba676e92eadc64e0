"""What other programs read of our exports: glTF, MaterialX and Mitsuba by their own readers, Blender by its names."""

import json
import shutil
import subprocess
import sys
import types
from dataclasses import dataclass, field

import MaterialX as mx
import MaterialX.PyMaterialXGenGlsl as mx_glsl
import MaterialX.PyMaterialXGenShader as mx_gen
import mitsuba
import numpy as np
import pygltflib
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from fit_material.fitter.export.blender import blender
from fit_material.fitter.export.gltf import gltf
from fit_material.fitter.export.materialx import materialx
from fit_material.fitter.export.mitsuba_xml import mitsuba_xml
from fit_material.fitter.export.values import identifiers
from fit_material.fitter.result.schema import Determined, FittedMaterial, StandardErrors
from tests.fitter.result.test_schema import gold

WRITERS = [gltf, materialx, mitsuba_xml, blender]
FLOAT32 = 2.0**-22  # relative: of a float32, after one rounding of a product or root
NAMES = st.text(max_size=8)


def glaze(**changes) -> FittedMaterial:
    values = {"color": (0.6, 0.1, 0.05), "reflectance": (0.04, 0.05, 0.03), "alpha": 0.1, "roughness": 0.3}
    errors = StandardErrors(reflectance=(0.001, None, 0.002))
    known = Determined(reflectance=(True, False, False))
    return FittedMaterial(
        **{"name": "glaze", "type": "glossy", **values, "stderr": errors, "determined": known, **changes}
    )


def clay(**changes) -> FittedMaterial:
    values = {"name": "clay", "type": "matte", "color": (0.5, 0.3, 0.2), "reflectance": (1.0, 0.5, 1.0)}
    return FittedMaterial(**{**values, **changes})


ALL = [gold(), glaze(), clay()]
CLAY = [0.5, 0.15, 0.2]  # color · reflectance, by hand


def near(expected):
    return pytest.approx(expected, rel=FLOAT32, abs=1e-12)


def reflectance_of(ior: float) -> float:
    return ((ior - 1) / (ior + 1)) ** 2


class TestGltf:
    @pytest.fixture(scope="class")
    def file(self, tmp_path_factory):
        path = tmp_path_factory.mktemp("gltf") / "a.gltf"
        path.write_text(gltf(ALL), "utf-8")
        return path

    def test_pygltflib_reads_every_number(self, file):
        metal, glossy, matte = pygltflib.GLTF2().load(str(file)).materials
        surface = metal.pbrMetallicRoughness
        assert surface.baseColorFactor == [0.96, 0.77, 0.39, 1]
        assert (surface.metallicFactor, surface.roughnessFactor) == (1, near(0.2**0.5))
        assert not metal.extensions
        surface = glossy.pbrMetallicRoughness
        assert surface.baseColorFactor == [0.6, 0.1, 0.05, 1]
        assert (surface.metallicFactor, surface.roughnessFactor) == (0, near(0.1**0.5))
        tint = np.array(glossy.extensions["KHR_materials_specular"]["specularColorFactor"])
        found = reflectance_of(glossy.extensions["KHR_materials_ior"]["ior"]) * tint
        np.testing.assert_allclose(found, [0.04, 0.05, 0.03], rtol=FLOAT32)
        assert matte.pbrMetallicRoughness.baseColorFactor == near([*CLAY, 1])
        assert matte.extensions["KHR_materials_specular"]["specularFactor"] == 0

    def test_errors_and_verdicts_travel_along(self, file):
        extras = pygltflib.GLTF2().load(str(file)).materials[0].extras["fit-material"]
        assert extras["n"] == [0.15, 0.43, 1.4]
        assert extras["stderr"]["n"] == [0.02, 0.04, None]
        assert extras["determined"]["n"] == [True, True, False]

    def test_trimesh_shows_a_ball_of_each(self, file):
        scene = trimesh.load_scene(file)
        assert len(scene.geometry) == len(ALL)
        for node, material in zip(("ball", "glaze", "clay"), ALL, strict=True):
            _, name = scene.graph[node]
            ball = scene.geometry[name]
            assert ball.is_watertight
            # a chord of icosphere 3 lies at most 1.5 % below the unit sphere, so its volume at most 4.5 %
            assert ball.volume == pytest.approx(4 / 3 * np.pi, rel=0.045)
            np.testing.assert_allclose(np.linalg.norm(ball.vertices, axis=1), 1, atol=1e-6)
            look = ball.visual.material
            assert (look.name, look.metallicFactor) == (material.name, float(material.type == "metal"))
            assert look.roughnessFactor == near(1.0 if material.alpha is None else material.alpha**0.5)

    @pytest.mark.slow
    def test_khronos_own_validator_finds_nothing(self, file, tmp_path):
        npm, node = shutil.which("npm"), shutil.which("node")
        if not npm or not node:
            pytest.skip("no npm and node: apt-get install npm")
        fetched = subprocess.run([npm, "install", "gltf-validator@2.0.0-dev.3.10"], cwd=tmp_path, capture_output=True)
        if fetched.returncode:
            pytest.skip("npm cannot fetch gltf-validator here")
        script = """
            const bytes = new Uint8Array(require('fs').readFileSync(process.argv[1]));
            require('gltf-validator').validateBytes(bytes).then(r => console.log(JSON.stringify(r.issues)));
        """
        told = subprocess.run([node, "-e", script, str(file)], cwd=tmp_path, capture_output=True, text=True, check=True)
        issues = json.loads(told.stdout)
        assert issues["messages"] == []


class TestMaterialX:
    @pytest.fixture(scope="class")
    def document(self):
        library, document = mx.createDocument(), mx.createDocument()
        mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), library)
        mx.readFromXmlString(document, materialx(ALL))
        document.setDataLibrary(library)
        return document

    def bsdf(self, document, name: str):
        surface = document.getNode(name).getConnectedNode("surfaceshader")
        return surface.getConnectedNode("bsdf")

    def test_its_own_check_finds_nothing(self, document):
        assert document.validate() == (True, "")
        assert [node.getName() for node in document.getMaterialNodes()] == ["ball", "glaze", "clay"]
        assert all(node.getNodeDef() is not None for node in document.getNodes())  # none is unknown to 1.39

    def test_every_number_is_read(self, document):
        metal, layer, body = (self.bsdf(document, name) for name in ("ball", "glaze", "clay"))
        assert metal.getCategory() == "conductor_bsdf"
        assert tuple(metal.getInputValue("ior")) == near((0.15, 0.43, 1.4))
        assert tuple(metal.getInputValue("extinction")) == near((3.5, 2.3, 1.9))
        assert tuple(metal.getInputValue("roughness")) == near((0.2, 0.2))
        top, base = layer.getConnectedNode("top"), layer.getConnectedNode("base")
        found = reflectance_of(top.getInputValue("ior")) * np.array(tuple(top.getInputValue("tint")))
        # the index is a float32; F0's slope in it is 4(η-1)/(η+1)³, which multiplies its rounding by less than 20 here
        np.testing.assert_allclose(found, [0.04, 0.05, 0.03], rtol=20 * FLOAT32)
        assert tuple(base.getInputValue("color")) == near((0.6, 0.1, 0.05))
        assert tuple(body.getInputValue("color")) == near(tuple(CLAY))

    def test_a_renderer_is_generated_from_it(self, document):
        """MaterialX's own generator writes GLSL with every node's function and number."""
        generator = mx_glsl.GlslShaderGenerator.create()
        context = mx_gen.GenContext(generator)
        context.registerSourceCodeSearchPath(mx.getDefaultDataSearchPath())
        generator.registerTypeDefs(document)
        for name, called in (("ball", "mx_conductor_bsdf"), ("glaze", "mx_dielectric_bsdf"), ("clay", "mx_oren_nayar")):
            shader = generator.generate(name, document.getNode(name), context)
            assert called in shader.getSourceCode(mx_gen.PIXEL_STAGE)

    def test_errors_stand_in_the_documentation(self, document):
        doc = document.getNode("ball").getDocString()
        assert "n = 0.15 ± 0.02, 0.43 ± 0.04, 1.4 (not determined)" in doc


class TestMitsuba:
    @pytest.fixture(scope="class")
    def read(self, tmp_path_factory):
        mitsuba.set_variant("scalar_rgb")
        path = tmp_path_factory.mktemp("mitsuba") / "a.xml"
        path.write_text(mitsuba_xml(ALL), "utf-8")
        return mitsuba.traverse(mitsuba.load_file(str(path)))

    def test_every_number_is_read(self, read):
        assert list(read["ball.eta.value"]) == near([0.15, 0.43, 1.4])
        assert list(read["ball.k.value"]) == near([3.5, 2.3, 1.9])
        assert read["ball.alpha.value"] == near(0.2)
        assert list(read["glaze.diffuse_reflectance.value"]) == near([0.6, 0.1, 0.05])
        assert read["glaze.alpha"] == near(0.1)
        found = reflectance_of(read["glaze.eta"]) * np.array(read["glaze.specular_reflectance.value"])
        np.testing.assert_allclose(found, [0.04, 0.05, 0.03], rtol=20 * FLOAT32)  # as of MaterialX's
        assert list(read["clay.reflectance.value"]) == near(CLAY)

    def test_other_scenes_include_it(self, tmp_path):
        mitsuba.set_variant("scalar_rgb")
        (tmp_path / "materials.xml").write_text(mitsuba_xml(ALL), "utf-8")
        shape = '<shape type="sphere"><ref id="glaze"/></shape>'
        (tmp_path / "scene.xml").write_text(
            f'<scene version="3.0.0"><include filename="materials.xml"/>{shape}</scene>', "utf-8"
        )
        scene = mitsuba.load_file(str(tmp_path / "scene.xml"))
        assert "RoughPlastic" in str(scene.shapes()[0].bsdf())

    def test_errors_stand_in_comments(self):
        assert "<!-- reflectance = 0.04 ± 0.001, 0.05 (not determined), 0.03 ± 0.002; not determined: blue -->" in (
            mitsuba_xml(ALL)
        )


@dataclass
class Socket:
    """A socket that takes what Blender's takes: a number, or a colour of four numbers."""

    value: object

    @property
    def default_value(self):
        return self.value

    @default_value.setter
    def default_value(self, new):
        assert np.shape(new) == np.shape(self.value)
        self.value = new


@dataclass
class Node:
    """Blender 4.2's Principled BSDF: its sockets' names, from the manual's page on it."""

    type: str = "BSDF_PRINCIPLED"
    inputs: dict = field(
        default_factory=lambda: {
            **{name: Socket((1.0,) * 4) for name in ("Base Color", "Specular Tint", "Coat Tint", "Sheen Tint")},
            **{name: Socket(0.0) for name in ("Metallic", "Roughness", "IOR", "Alpha", "Specular IOR Level")},
            **{name: Socket(0.0) for name in ("Anisotropic", "Transmission Weight", "Coat Weight", "Sheen Weight")},
        }
    )


class Materials(dict):
    """`bpy.data.materials`; a new material has an output and a Principled BSDF."""

    def new(self, name):
        tree = types.SimpleNamespace(nodes=[Node("OUTPUT_MATERIAL", {}), Node()])
        self[name] = types.SimpleNamespace(use_nodes=False, node_tree=tree)
        return self[name]


def by_blender(script: str, monkeypatch) -> dict[str, dict[str, object]]:
    """The sockets of each material after the script has run."""
    bpy = types.ModuleType("bpy")
    bpy.data = types.SimpleNamespace(materials=Materials())  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "bpy", bpy)
    exec(compile(script, "a.blender.py", "exec"), {})
    found = {}
    for name, material in bpy.data.materials.items():
        assert material.use_nodes
        found[name] = {key: socket.value for key, socket in material.node_tree.nodes[1].inputs.items()}
    return found


class TestBlender:
    def test_every_socket_has_its_value(self, monkeypatch):
        found = by_blender(blender(ALL), monkeypatch)
        metal, glossy, matte = (found[name] for name in ("ball", "glaze", "clay"))
        assert (metal["Base Color"], metal["Metallic"]) == ((0.96, 0.77, 0.39, 1.0), 1)
        assert metal["Roughness"] == near(0.2**0.5)
        assert (glossy["Base Color"], glossy["Metallic"]) == ((0.6, 0.1, 0.05, 1.0), 0)
        # Blender's F0 is that of the IOR, times twice the level, times the tint
        level = 2 * glossy["Specular IOR Level"] * reflectance_of(glossy["IOR"])
        np.testing.assert_allclose(level * np.array(glossy["Specular Tint"][:3]), [0.04, 0.05, 0.03], rtol=1e-7)
        assert matte["Base Color"] == near((*CLAY, 1.0))
        assert (matte["Specular IOR Level"], matte["Roughness"]) == (0, 1)

    @pytest.mark.parametrize(("n", "k"), [((0.15, 0.43, 1.4), (3.5, 2.3, 1.9)), ((2.9, 2.9, 2.6), (3.1, 2.9, 2.8))])
    def test_metals_reflect_at_82_degrees_as_their_index_says(self, n, k, monkeypatch):
        """Blender's curve there, mix(F0, 1, (6/7)⁵) · tint, against Mitsuba's exact Fresnel equations."""
        mitsuba.set_variant("scalar_rgb")
        f0, exact = (
            [mitsuba.fresnel_conductor(cosine, mitsuba.Complex2f(a, b)) for a, b in zip(n, k, strict=True)]
            for cosine in (1.0, 1 / 7)
        )
        values = by_blender(blender([gold(n=n, k=k, f0=tuple(f0))]), monkeypatch)["ball"]
        weight = (6 / 7) ** 5
        white = np.array(f0) * (1 - weight) + weight
        expected = np.minimum(exact, white)  # no tint is above 1; of the first metal's green it would have to be
        found = white * np.array(values["Specular Tint"][:3])
        np.testing.assert_allclose(found, expected, rtol=2e-6)  # Mitsuba's float32, over a few operations

    def test_errors_stand_in_comments(self):
        assert "        # n = 0.15 ± 0.02, 0.43 ± 0.04, 1.4 (not determined)\n" in blender(ALL)


@given(st.lists(NAMES, min_size=1, max_size=5))
def test_identifiers_are_valid_and_distinct(names):
    found = identifiers(names)
    assert len(set(found)) == len(names)
    assert all(mx.isValidName(name) and not name[0].isdigit() for name in found)


@settings(max_examples=30)
@given(NAMES)
def test_any_name_is_read_back(name):
    with pytest.MonkeyPatch.context() as patch:
        assert list(by_blender(blender([glaze(name=name)]), patch)) == [name]
    assert json.loads(gltf([clay(name=name)]))["materials"][0]["name"] == name
    mx.readFromXmlString(mx.createDocument(), materialx([gold(name=name)]))
    mitsuba.set_variant("scalar_rgb")
    mitsuba.load_string(mitsuba_xml([gold(name=name)]))


@pytest.mark.parametrize("writer", WRITERS)
def test_numbers_that_are_missing_or_no_reader_takes(writer):
    with pytest.raises(ValueError, match="glossy 'glaze' has no alpha"):
        writer([glaze(alpha=None)])
    broken = gold().model_copy(update={"n": (1.0, 1e39, 1.0), "f0": (1e39, 0.5, 0.5)})
    with pytest.raises(ValueError, match=r"1e\+39 cannot be exported"):
        writer([broken])


@pytest.mark.parametrize("writer", WRITERS)
def test_a_reflectance_that_no_dielectric_has(writer):
    with pytest.raises(ValueError, match="a reflectance of 1 has no index of refraction"):
        writer([glaze(reflectance=(0.04, 1.0, 0.04))])
