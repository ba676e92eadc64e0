"""Scenes that are each built to call for a known set of effects; a plan looks at their pixels' geometry alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from fit_material.renderer.geometry.mesh import Mesh, Shape, Sphere
from fit_material.renderer.images.image_file import write_exr
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.scene.lights import DirectionalLightSpec, LightSpec
from fit_material.renderer.synthesis.camera_placement import View, views
from fit_material.renderer.synthesis.scene_writer import scene_toml
from tests.renderer.rays.test_self_visibility import ball
from tests.support import bowl as golden
from tests.support.soft_scene import soft_light

MIRRORING = frozenset({"reflection", "blur", "horizon", "exact-fresnel", "pixel-footprint"})
BODY = frozenset({"diffuse-irradiance"})
SELF = frozenset({"self-visibility", "interreflection"})
LAMP = DirectionalLightSpec(type="directional", direction=(0.6, 0.7, 0.4), irradiance=(3.0, 3.0, 2.8))


@dataclass(frozen=True)
class PlanScene:
    """A scene and the effects that it calls for.

    Attributes:
        expected: the names of the effects.
        types: of the materials, by the mesh's order; () leaves them open.
        shape: what is seen.
        lights: directional lights.
        fidelity: of the fit that is planned.
        size: pixels along a photograph.
        looks: cameras; all round the object where left out.
    """

    expected: frozenset[str]
    types: tuple[str, ...] = ()
    shape: Shape = Sphere()  # noqa: RUF009 — frozen
    lights: tuple[LightSpec, ...] = ()
    fidelity: str = "standard"
    size: int = 48
    looks: tuple[View, ...] = ()

    def write(self, folder: Path) -> Path:
        """The scene's files, its photographs white where the object is; the path of scene.toml."""
        folder.mkdir(parents=True, exist_ok=True)
        write_exr(folder / "environment.exr", soft_light())
        poses, trace = self.looks or views(2, self.shape), gbuffer.tracer(self.shape)
        for index, pose in enumerate(poses):
            hit = gbuffer.pixel_centres(trace, pose.camera(self.size)).hit.numpy().astype(np.float32)
            write_exr(folder / f"view_{index}.exr", np.repeat(hit[..., None], 4, -1))
        mesh = None if isinstance(self.shape, Sphere) else write_obj(folder / "mesh.obj", self.shape)
        text = scene_toml(mesh, self.lights, poses)
        text += "".join(
            f'\n[[materials]]\nname = "{name}"\ntype = "{kind}"\n'
            for name, kind in zip(self.names, self.types, strict=False)
        )
        (folder / "scene.toml").write_text(text, encoding="utf-8")
        return folder / "scene.toml"

    @property
    def names(self) -> Sequence[str]:
        return self.shape.material_names if isinstance(self.shape, Mesh) else ("default",)


def write_obj(path: Path, mesh: Mesh) -> Path:
    """A mesh with its normals and material names."""
    normals = mesh.normals if mesh.normals is not None else np.zeros_like(mesh.vertices)
    lines = ["v {:.9g} {:.9g} {:.9g}".format(*vertex) for vertex in mesh.vertices]
    lines += ["vn {:.9g} {:.9g} {:.9g}".format(*normal) for normal in normals]
    for index, name in enumerate(mesh.material_names):
        lines.append(f"usemtl {name}")
        own = mesh.faces[mesh.material == index] + 1
        lines += ["f " + " ".join(f"{corner}//{corner}" for corner in face) for face in own]
    path.write_text("\n".join(lines))
    return path


def row_of_balls(distance: float, names: tuple[str, ...] = ("default", "default")) -> Mesh:
    """Balls of radius 1 whose centres are so far apart, of materials by name."""
    kinds = tuple(dict.fromkeys(names))
    places = [np.array([distance * (index - (len(names) - 1) / 2), 0.0, 0.0]) for index in range(len(names))]
    made = [ball(place, 3) for place in places]
    count = len(made[0].vertices)
    return Mesh(
        np.concatenate([each.vertices for each in made]),
        np.concatenate([each.faces + count * index for index, each in enumerate(made)]),
        np.concatenate([each.normals for each in made]),  # type: ignore[list-item]
        None,
        np.concatenate([np.full(len(each.faces), kinds.index(name)) for each, name in zip(made, names, strict=True)]),
        kinds,
    )


def torus() -> Mesh:
    """A ring, round everywhere and not convex."""
    solid = trimesh.creation.torus(1.0, 0.4, major_sections=48, minor_sections=24)
    faces = np.asarray(solid.faces)
    return Mesh(
        np.asarray(solid.vertices), faces, np.asarray(solid.vertex_normals), None, np.zeros(len(faces), dtype=int)
    )


SCENES = {
    "a lonely ball of metal": PlanScene(MIRRORING, ("metal",)),
    "a ball of metal with a lamp": PlanScene(MIRRORING | {"light-reflection"}, ("metal",), lights=(LAMP,)),
    "a lonely glossy ball": PlanScene(MIRRORING | BODY, ("glossy",)),
    "a glossy ball with a lamp": PlanScene(MIRRORING | BODY | {"light-reflection"}, ("glossy",), lights=(LAMP,)),
    "a ball that may be anything": PlanScene(MIRRORING | BODY),
    "a matte ball": PlanScene(BODY, ("matte",), size=256),
    "a matte ball with a lamp": PlanScene(BODY | {"pixel-footprint"}, ("matte",), lights=(LAMP,)),
    "a convex mesh of metal": PlanScene(MIRRORING, ("metal",), ball(np.zeros(3), 3)),
    "a bowl of metal": PlanScene(MIRRORING | SELF, ("metal",), golden.bowl(), looks=tuple(golden.looks())),
    "two balls of metal": PlanScene(MIRRORING | {"self-visibility"}, ("metal",), row_of_balls(2.5)),
    "two balls of metal, far apart": PlanScene(MIRRORING, ("metal",), row_of_balls(300.0), size=1024),
    "a matte ring": PlanScene(BODY | {"ambient-occlusion"}, ("matte",), torus()),
    "a matte ring with a lamp": PlanScene(
        BODY | {"ambient-occlusion", "self-visibility", "pixel-footprint"}, ("matte",), torus(), (LAMP,)
    ),
    "a glossy ring": PlanScene(MIRRORING | BODY | {"ambient-occlusion", "self-visibility"}, ("glossy",), torus()),
    "balls of three materials": PlanScene(
        MIRRORING | BODY | {"ambient-occlusion", "self-visibility"},
        ("metal", "glossy", "matte"),
        row_of_balls(2.2, ("first", "second", "third")),
    ),
    "a ball as the viewer draws it": PlanScene(frozenset({"reflection", "blur"}), ("metal",), fidelity="viewer"),
    "two balls as the viewer draws them": PlanScene(
        frozenset({"reflection", "blur"}), ("metal",), row_of_balls(2.5), fidelity="viewer"
    ),
}
