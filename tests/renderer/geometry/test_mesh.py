"""Meshes against what was written, and every mesh that we could find against the promise of one sentence."""

import json
import struct

import numpy as np
import pytest
import trimesh

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.geometry.mesh import FORMATS, Mesh, read_mesh

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
NORMALS = "vn 0 0 1\nvn 0 1 1\nvn 1 0 1\n"


@pytest.fixture
def obj(tmp_path):
    def write(text: str | bytes):
        path = tmp_path / "a.obj"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def area(mesh) -> float:
    corner = mesh.vertices[mesh.faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    return float(np.linalg.norm(normal, axis=-1).sum() / 2)


@pytest.mark.parametrize("ending", FORMATS)
def test_every_format_gives_the_same_box(tmp_path, ending):
    box = trimesh.creation.box(extents=(1, 2, 3))
    box.apply_translation((0.5, 0.25, 4))
    box.export(tmp_path / f"a{ending}")
    mesh = read_mesh(tmp_path / f"a{ending}", smooth=False)
    assert len(mesh.faces) == 12
    assert mesh.normals is None
    assert mesh.material_names == ("default",) or ending == ".glb"
    # STL and GLB hold float32
    np.testing.assert_allclose(mesh.vertices.min(0), [0, -0.75, 2.5], atol=1e-6)
    np.testing.assert_allclose(mesh.vertices.max(0), [1, 1.25, 5.5], atol=1e-6)
    np.testing.assert_allclose(area(mesh), 22, rtol=1e-6)
    corner = mesh.vertices[mesh.faces] - [0.5, 0.25, 4]
    assert (np.linalg.det(corner) > 0).all()  # counter-clockwise from outside


def test_normals_are_kept_only_where_asked_and_made_unit(obj):
    path = obj(TRIANGLE + NORMALS + "f 1//1 2//2 3//3\n")
    normals = read_mesh(path).normals
    assert normals is not None
    expected = np.array([[0, 0, 1], [0, 1, 1], [1, 0, 1]]) / np.sqrt([[1], [2], [2]])
    np.testing.assert_allclose(normals, expected, atol=1e-15)
    assert read_mesh(path, smooth=False).normals is None
    assert read_mesh(obj(TRIANGLE + "f 1 2 3\n")).normals is None


def test_faces_without_normals_keep_their_facet_beside_faces_with_them(obj):
    more = "v 0 0 1\nv 0 1 1\nf 1//1 2//2 3//3\nf 1 3 5\n"
    mesh = read_mesh(obj(TRIANGLE + NORMALS + more))
    assert mesh.normals is not None
    facet = [corner for corner in mesh.normals[mesh.faces] if np.allclose(corner, [1, 0, 0])]
    assert len(facet) == 1


def test_texture_coordinates_stay_with_their_vertices(obj):
    mesh = read_mesh(obj(TRIANGLE + "vt 0.5 0.25\nvt 1 0\nvt 0 1\nf 1/3 2/1 3/2\n"))
    assert mesh.uv is not None
    found = {tuple(v): tuple(uv) for v, uv in zip(mesh.vertices, mesh.uv, strict=True)}
    assert found == {(0, 0, 0): (0, 1), (1, 0, 0): (0.5, 0.25), (0, 1, 0): (1, 0)}


def test_polygons_become_triangles(obj):
    angle = 2 * np.pi * np.arange(7) / 7
    corners = "".join(f"v {x} {y} 0\n" for x, y in zip(np.cos(angle), np.sin(angle), strict=True))
    mesh = read_mesh(obj(corners + "f 1 2 3 4 5 6 7\nf 1 2 3 4\n"))
    assert len(mesh.faces) == 5 + 2
    # between radii an angle of a apart lies sin(a)/2; the quadrilateral has three such, less the one that closes it
    assert area(mesh) == pytest.approx((7 + 3) / 2 * np.sin(angle[1]) - np.sin(angle[3]) / 2)


@pytest.mark.parametrize("library", ["", "mtllib none.mtl\n", "mtllib one.mtl\n"])
def test_material_names_survive_any_material_file(obj, tmp_path, library):
    (tmp_path / "one.mtl").write_text("newmtl red brass\nKd 1\nmap_Kd none.png\nnewmtl b\nKd\n")
    faces = "f 1 2 3\nusemtl red brass\nf 1 3 2\nf 2 1 3\nusemtl b\nf 3 2 1\nusemtl red brass\nf 3 1 2\n"
    mesh = read_mesh(obj(library + TRIANGLE + faces))
    names = [mesh.material_names[index] for index in mesh.material]
    assert sorted(names) == ["b", "default", "red brass", "red brass", "red brass"]


def test_relative_indices_count_back_from_their_line(obj):
    later = "v 5 0 0\nv 6 0 0\nv 5 2 0\nf -3 -2 -1\n"
    mesh = read_mesh(obj(TRIANGLE + "f -3 -2 -1\n" + later))
    assert area(mesh) == pytest.approx(0.5 + 1)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "latin-1"])
def test_encodings_and_loose_layout(obj, encoding):
    text = "# für alle\r\n\tv\t0 0 0 1 0 0\r\n v 1 0 0\r\nv 0 1 0\r\nusemtl  grün\r\nf 1 \\\r\n 2 3 # Ende\r\n"
    mesh = read_mesh(obj(text.encode(encoding)))
    assert mesh.material_names == ("grün",)
    assert area(mesh) == 0.5


def test_nodes_of_a_scene_are_placed_and_mirrored_ones_face_outwards(tmp_path):
    scene = trimesh.Scene()
    box = trimesh.creation.box()
    scene.add_geometry(box, transform=trimesh.transformations.translation_matrix((10, 0, 0)))
    scene.add_geometry(box, transform=np.diag([-2.0, 2, 2, 1]))
    scene.export(tmp_path / "a.glb")
    mesh = read_mesh(tmp_path / "a.glb")
    np.testing.assert_allclose(mesh.vertices.max(0), [10.5, 1, 1], atol=1e-6)
    corner = mesh.vertices[mesh.faces]
    centre = np.where(corner.mean(1)[:, :1] > 5, [[10, 0, 0]], 0)
    assert (np.linalg.det(corner - centre[:, None]) > 0).all()


def objects_of(mesh: Mesh) -> list[tuple[str, str]]:
    """Object and material of each face, sorted."""
    assert mesh.part is not None
    found = zip(mesh.part, mesh.material, strict=True)
    return sorted((mesh.part_names[part], mesh.material_names[material]) for part, material in found)


def test_objects_and_materials_of_a_face_are_told_apart(obj):
    faces = (
        "f 1 2 3\no a b\ng x\nusemtl red\nf 1 3 2\ng y\nf 2 1 3\no c\nf 3 2 1\nusemtl blue\nf 3 1 2\no a b\nf 2 3 1\n"
    )
    mesh = read_mesh(obj(TRIANGLE + faces))
    expected = [("a b", "blue"), ("a b", "red"), ("a b", "red"), ("c", "blue"), ("c", "red"), ("default", "default")]
    assert objects_of(mesh) == expected


@pytest.mark.parametrize("one", ["", "o ball\n", "o empty\no ball\n"])
def test_groups_are_objects_where_o_tells_none_apart(obj, one):
    mesh = read_mesh(obj(one + TRIANGLE + "g x y\nf 1 2 3\ng z\nf 1 3 2\nf 2 1 3\n"))
    assert objects_of(mesh) == [("x y", "default"), ("z", "default"), ("z", "default")]


@pytest.mark.parametrize("one", ["", "o ball\n", "g x\n", "o ball\ng x\n"])
def test_one_object_needs_no_index(obj, one):
    mesh = read_mesh(obj(one + TRIANGLE + "f 1 2 3\nusemtl red\nf 1 3 2\n"))
    assert mesh.part is None
    assert mesh.part_names == ("default",)


def test_objects_of_a_glb_are_its_nodes_whatever_their_materials(tmp_path):
    """Written by hand, for trimesh exports one material per node."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32).tobytes()
    primitive = {"attributes": {"POSITION": 0}}
    content = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"name": "pot", "mesh": 0}, {"name": "lid", "mesh": 1, "translation": [0, 0, 1]}],
        "meshes": [{"primitives": [primitive | {"material": m} for m in (0, 1)]}, {"primitives": [primitive]}],
        "materials": [{"name": "red"}, {"name": "blue"}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": len(corners)}],
        "buffers": [{"byteLength": len(corners)}],
    }
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(corners), b"BIN\0") + corners
    (tmp_path / "a.glb").write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    mesh = read_mesh(tmp_path / "a.glb")
    assert objects_of(mesh) == [("lid", "default"), ("pot", "blue"), ("pot", "red")]


def test_parts_without_texture_coordinates_leave_the_others_theirs(obj):
    mesh = read_mesh(obj(TRIANGLE + "vt 0.5 0.25\nf 1/1 2/1 3/1\nf 1 3 2\n"))
    assert mesh.uv is not None
    assert sorted(mesh.uv[mesh.faces].sum((1, 2))) == [0, 3 * 0.75]


def test_texture_coordinates_that_are_no_numbers_are_none(obj):
    assert read_mesh(obj(TRIANGLE + "vt 0.5 nan\nf 1/1 2/1 3/1\n")).uv is None


def test_triangles_without_area_are_dropped(obj):
    mesh = read_mesh(obj(TRIANGLE + "v 2 0 0\nf 1 2 3\nf 1 2 4\nf 1 1 2\n"))
    assert len(mesh.faces) == 1


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "faces: is 0, expected at least one triangle with an area"),
        (TRIANGLE, "faces: is 0, expected at least one triangle"),
        (TRIANGLE + "f 1 1 1\n", "faces: is 0, expected at least one triangle with an area"),
        (TRIANGLE + "f 1 2 4\n", "v index of a face: is 4, expected at most 3"),
        (TRIANGLE + NORMALS + "f 1//1 2//2 3//9\n", "vn index of a face: is 9, expected at most 3"),
        (TRIANGLE + "f 0 1 2\n", "expected a readable OBJ mesh .*index 0 .* out of range"),
        (TRIANGLE + "f -4 1 2\n", "expected a readable OBJ mesh .*index -4 .* out of range"),
        (TRIANGLE + "f a b c\n", "expected a readable OBJ mesh"),
        (TRIANGLE.replace("1 0 0", "nan 0 0") + "f 1 2 3\n", r"vertices: is \[nan, 0.0, 0.0\], expected finite"),
        (TRIANGLE.replace("1 0 0", "inf 0 0") + "f 1 2 3\n", r"vertices: is \[inf, 0.0, 0.0\], expected finite"),
        (TRIANGLE.replace("1 0 0", "one 0 0") + "f 1 2 3\n", "expected a readable OBJ mesh"),
    ],
)
def test_bad_geometry_is_one_sentence(obj, text, sentence):
    with pytest.raises(InputError, match=rf"a\.obj: {sentence}"):
        read_mesh(obj(text))


def test_ply_index_out_of_range(tmp_path):
    header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    body = "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n"
    (tmp_path / "a.ply").write_text(header + body)
    with pytest.raises(InputError, match="vertex index of a face: is 7, expected less than 3"):
        read_mesh(tmp_path / "a.ply")


@pytest.mark.parametrize("ending", FORMATS)
def test_foreign_bytes_are_one_sentence(tmp_path, ending):
    (tmp_path / f"a{ending}").write_bytes(bytes(range(256)) * 3)
    with pytest.raises(InputError, match=r"expected (a readable|at least one triangle)"):
        read_mesh(tmp_path / f"a{ending}")


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("none.obj", r"none\.obj: expected a mesh file here, but there is none"),
        ("a.fbx", r"a\.fbx: format: is \.fbx, expected one of \.obj \.ply \.stl \.glb"),
    ],
)
def test_missing_files_and_other_formats(tmp_path, name, sentence):
    with pytest.raises(InputError, match=sentence):
        read_mesh(tmp_path / name)


def test_compressed_glb_is_refused(shared_data):
    with pytest.raises(InputError, match="is KHR_draco_mesh_compression, expected meshes that are not compressed"):
        read_mesh(shared_data / "meshes" / "suzi.glb")


def mesh_or_sentence(path) -> Mesh | str:
    try:
        return read_mesh(path)
    except InputError as error:
        return str(error)


def test_every_mesh_at_hand_is_read_or_refused_in_one_sentence(shared_data, capfd):
    paths = [path for path in sorted(shared_data.rglob("*.*")) if path.suffix in FORMATS]
    read = 0
    for path in paths:
        mesh = mesh_or_sentence(path)
        if isinstance(mesh, str):
            assert mesh.startswith(f"{path}: ")
            assert "\n" not in mesh
            continue
        read += 1
        assert np.isfinite(mesh.vertices).all()
        assert mesh.faces.max() < len(mesh.vertices)
        assert mesh.normals is None or mesh.normals.shape == mesh.vertices.shape
        assert mesh.uv is None or len(mesh.uv) == len(mesh.vertices)
        assert len(mesh.material) == len(mesh.faces)
        assert mesh.material.max() < len(mesh.material_names)
        if mesh.part is not None:
            assert sorted(set(mesh.part)) == list(range(len(mesh.part_names)))  # none without faces
    assert read > 0.75 * len(paths)  # most of them are whole; the rest was made to be broken
    assert capfd.readouterr() == ("", "")


def test_bytes_that_are_no_stl_are_refused_without_a_word_about_packages(tmp_path):
    (tmp_path / "a.stl").write_bytes(b"\0\xffjunk" * 50)
    with pytest.raises(InputError, match=r"a\.stl: expected a readable STL mesh$"):
        read_mesh(tmp_path / "a.stl")
