"""Our cameras, shapes, surroundings and materials in Mitsuba's terms.

Mitsuba keeps its variant (number type and backend) in a global; `mitsuba` sets it, and whatever is made here
is of the variant that is current then. Nothing made under one variant can be used under another.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from fit_material.renderer.backends.mitsuba_library import mitsuba_library
from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.geometry.mesh import Mesh, Shape, Sphere
from fit_material.renderer.materials.bsdf import Bsdf, Distribution, rgb
from fit_material.renderer.materials.ground_truth import TRUE_TYPES, TrueMaterial
from fit_material.shaders.lights import DirectionalLight, Light
from fit_material.shaders.materials.kinds import MaterialType
from fit_material.shaders.registry.registry import Registry

AUTO = "auto"  # the fastest variant that runs here


def mitsuba(variant: str = "scalar_rgb") -> Any:
    """The module `mitsuba`, with its variant set.

    Args:
        variant: "scalar_rgb" needs nothing beside the wheel; "llvm_ad_rgb" is faster, and needs LLVM.

    Raises:
        InputError: where there is no such variant, or its library (LLVM, CUDA) cannot be loaded.
    """
    mi = mitsuba_library()
    known = [name for name in mi.variants() if name.endswith("_rgb")]
    if variant not in known:
        raise InputError("--variant", value=variant, expected=f"one of {', '.join(known)}, or {AUTO}")
    try:
        mi.set_variant(variant)
    except ImportError as error:
        library = "LLVM's shared library (Debian: apt install libllvm19)" if "llvm" in variant else "CUDA"
        raise InputError("--variant", value=variant, expected=f"{library}, or use scalar_rgb") from error
    return mi


def variant_here(variant: str = AUTO) -> str:
    """The variant's name; for "auto" that of the fast one where LLVM is found, else of the one that needs nothing.

    Raises:
        InputError: as `mitsuba`, about a variant that was requested by name.
    """
    if variant != AUTO:
        return mitsuba(variant).variant()
    try:
        return mitsuba("llvm_ad_rgb").variant()
    except InputError:
        return mitsuba("scalar_rgb").variant()


def bsdf_of(material: TrueMaterial) -> Bsdf:
    """A material that Mitsuba can show; see `renderer.materials.ground_truth.require_shadable`."""
    return bsdf(material.type, lambda name: getattr(material, name), material.alpha or 0.0, material.distribution)


def bsdf(kind: MaterialType, quantity: Callable[[str], Any], alpha: float, distribution: Distribution | None) -> Bsdf:
    """A material of that type.

    Args:
        quantity: computes the quantities that it stores by their names, as `TrueMaterial.bsdf` takes them.
        alpha, distribution: as `conductor`'s; nothing to a material that mirrors nothing.
    """
    return TRUE_TYPES[kind].bsdf(quantity, alpha, distribution or "ggx")


def sensor(camera: Camera, spp: int = 1) -> dict[str, Any]:
    """A camera with an RGBA film that adds up what falls into each pixel, without filtering across pixels."""
    half_width = camera.scale if camera.projection == "orthographic" else 1.0
    # Mitsuba looks along +Z with +X to the left, and takes an orthographic camera's extent from the scaling
    axes = torch.tensor([-half_width, half_width, -1, 1], dtype=torch.float64)
    lens = {"fov": camera.fov, "fov_axis": "x"} if camera.projection == "perspective" else {}
    film = {
        "type": "hdrfilm",
        "width": camera.width,
        "height": camera.height,
        "pixel_format": "rgba",
        "component_format": "float32",
        "rfilter": {"type": "box"},
    }
    return {
        "type": camera.projection,
        "to_world": _transform((camera.camera_to_world * axes).numpy()),
        "near_clip": 1e-4,  # the directions stay exact to float32 with these, and no object is cut off
        "far_clip": 1e8,
        "film": film,
        "sampler": {"type": "independent", "sample_count": spp},
        **lens,
    }


def envmap(environment: Environment) -> dict[str, Any]:
    """The far-away surroundings as an emitter, linear as they are."""
    mi = mitsuba_library()
    angle = np.deg2rad(environment.rotation)
    turn = np.eye(4)
    turn[0, 0] = turn[2, 2] = np.cos(angle)
    turn[0, 2], turn[2, 0] = np.sin(angle), -np.sin(angle)
    return {
        "type": "envmap",
        "bitmap": mi.Bitmap(environment.radiance.float().contiguous().cpu().numpy()),
        "to_world": _transform(turn),
    }


def directional(light: DirectionalLight) -> dict[str, Any]:
    """A far-away light as an emitter; Mitsuba's direction is that of propagation, its number the irradiance."""
    return {
        "type": "directional",
        "direction": (-light.towards).tolist(),
        "irradiance": rgb((torch.pi * light.radiance).tolist()),
    }


@dataclass(frozen=True)
class Emitter:
    """A type of light in Mitsuba's terms.

    Attributes:
        name: the `kind` of the light.
        made: from the light to Mitsuba's dictionary.
    """

    name: str
    made: Callable[[Any], dict[str, Any]]


EMITTERS = Registry(Emitter("directional", directional))


def emitters(lights: Sequence[Light]) -> dict[str, dict[str, Any]]:
    """Lights as entries of a Mitsuba scene."""
    return {f"light_{i}": EMITTERS[light.kind].made(light) for i, light in enumerate(lights)}


def mitsuba_shape(shape: Shape, bsdf: Bsdf | None = None) -> Any:
    """A shape for rendering or ray casting, in Mitsuba's current variant.

    Vertices and faces keep their order, so that `prim_index` of an intersection is the index of the face.

    Args:
        shape: a mesh without normals is shaded by its facets.
        bsdf: the material, as `conductor` gives it; Mitsuba's default (grey diffuse) where left out.
    """
    mi = mitsuba_library()
    material = {} if bsdf is None else {"bsdf": bsdf}
    if isinstance(shape, Sphere):
        return mi.load_dict({"type": "sphere", **material})
    properties = mi.Properties()
    if bsdf is not None:
        properties["mesh_bsdf"] = mi.load_dict(bsdf)
    if shape.normals is None:
        properties["face_normals"] = True
    return _mesh(mi, shape, properties)


def mitsuba_shapes(shape: Shape, bsdfs: Sequence[Bsdf]) -> dict[str, Any]:
    """A shape for rendering, a part of its own for each material, in Mitsuba's current variant.

    Args:
        shape: triangles of `material` i are made of the i-th of `bsdfs`.
        bsdfs: one for each of the mesh's `material_names`; one serves the whole of any shape.
    """
    if len(bsdfs) == 1 or isinstance(shape, Sphere):
        return {"object": mitsuba_shape(shape, bsdfs[0])}
    return {f"object_{i}": mitsuba_shape(_of_material(shape, i), bsdf) for i, bsdf in enumerate(bsdfs)}


def _of_material(mesh: Mesh, material: int) -> Mesh:
    """The triangles of one material, with the vertices that they use."""
    used, corners = np.unique(mesh.faces[mesh.material == material], return_inverse=True)
    faces = corners.reshape(-1, 3)
    normals, uv = (None if of_vertex is None else of_vertex[used] for of_vertex in (mesh.normals, mesh.uv))
    return Mesh(mesh.vertices[used], faces, normals, uv, np.zeros(len(faces), dtype=int))


def _mesh(mi: Any, mesh: Mesh, properties: Any) -> Any:
    result = mi.Mesh(
        "mesh",
        vertex_count=len(mesh.vertices),
        face_count=len(mesh.faces),
        props=properties,
        has_vertex_normals=mesh.normals is not None,
        has_vertex_texcoords=mesh.uv is not None,
    )
    buffers = mi.traverse(result)
    buffers["vertex_positions"] = mesh.vertices.astype(np.float32).ravel()
    buffers["faces"] = mesh.faces.astype(np.uint32).ravel()
    if mesh.normals is not None:
        buffers["vertex_normals"] = mesh.normals.astype(np.float32).ravel()
    if mesh.uv is not None:
        buffers["vertex_texcoords"] = mesh.uv.astype(np.float32).ravel()
    buffers.update()
    return result


def _transform(matrix: np.ndarray) -> Any:
    mi = mitsuba_library()
    return mi.ScalarTransform4f(matrix)
