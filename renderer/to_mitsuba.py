"""Our cameras, shapes, surroundings and metals in Mitsuba's terms.

Mitsuba keeps its variant (number type and backend) in a global; `mitsuba` sets it, and whatever is made here
is of the variant that is current then. Nothing made under one variant can be used under another.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import torch

from renderer.camera import Camera
from renderer.environment import Environment
from renderer.errors import InputError
from renderer.mesh import Mesh, Shape, Sphere

Distribution = Literal["ggx", "beckmann"]


def mitsuba(variant: str = "scalar_rgb") -> Any:
    """The module `mitsuba`, with its variant set.

    Args:
        variant: "scalar_rgb" needs nothing beside the wheel; "llvm_ad_rgb" is faster, and needs LLVM.

    Raises:
        InputError: where there is no such variant, or its library (LLVM, CUDA) cannot be loaded.
    """
    import mitsuba as mi

    known = [name for name in mi.variants() if name.endswith("_rgb")]
    if variant not in known:
        raise InputError("--variant", value=variant, expected=f"one of {', '.join(known)}")
    try:
        mi.set_variant(variant)
    except ImportError as error:
        library = "LLVM's shared library (Debian: apt install libllvm19)" if "llvm" in variant else "CUDA"
        raise InputError("--variant", value=variant, expected=f"{library}, or use scalar_rgb") from error
    return mi


def conductor(
    n: tuple[float, float, float],
    k: tuple[float, float, float],
    alpha: float,
    distribution: Distribution = "ggx",
) -> dict[str, Any]:
    """A rough metal as Mitsuba's `roughconductor`.

    Args:
        n, k: complex refractive index n + ik, red, green, blue; unitless.
        alpha: microfacet width, isotropic, > 0.
        distribution: of the microfacets' normals.
    """
    return {
        "type": "roughconductor",
        "eta": {"type": "rgb", "value": list(n)},
        "k": {"type": "rgb", "value": list(k)},
        "alpha": alpha,
        "distribution": distribution,
        "sample_visible": True,
    }


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
    import mitsuba as mi

    angle = np.deg2rad(environment.rotation)
    turn = np.eye(4)
    turn[0, 0] = turn[2, 2] = np.cos(angle)
    turn[0, 2], turn[2, 0] = np.sin(angle), -np.sin(angle)
    return {
        "type": "envmap",
        "bitmap": mi.Bitmap(environment.radiance.float().contiguous().cpu().numpy()),
        "to_world": _transform(turn),
    }


def mitsuba_shape(shape: Shape, bsdf: dict[str, Any] | None = None) -> Any:
    """A shape for rendering or ray casting, in Mitsuba's current variant.

    Vertices and faces keep their order, so that `prim_index` of an intersection is the index of the face.

    Args:
        shape: a mesh without normals is shaded by its facets.
        bsdf: the material, as `conductor` gives it; Mitsuba's default (grey diffuse) where left out.
    """
    import mitsuba as mi

    material = {} if bsdf is None else {"bsdf": bsdf}
    if isinstance(shape, Sphere):
        return mi.load_dict({"type": "sphere", **material})
    properties = mi.Properties()
    if bsdf is not None:
        properties["mesh_bsdf"] = mi.load_dict(bsdf)
    if shape.normals is None:
        properties["face_normals"] = True
    return _mesh(mi, shape, properties)


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
    import mitsuba as mi

    return mi.ScalarTransform4f(matrix)
