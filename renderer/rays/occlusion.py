"""What an object hides of its surroundings from itself, by rays towards the light."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fit_material.renderer.backends.mitsuba_library import mitsuba_library
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.geometry.bounds import bounding_sphere
from fit_material.renderer.geometry.mesh import Mesh, Shape
from fit_material.renderer.mitsuba import conversion
from fit_material.renderer.mitsuba.raycast import Caster, caster
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.renderer.rays.self_visibility import cosine_directions

_RAYS = 64  # of openness: it is known to 1 or 2 %
OFF = 1e-4  # of the object's extent, by which rays start off their own facet


@dataclass(frozen=True)
class Occluder:
    """An object that may stand between its own surface and the light.

    Attributes:
        cast: the face that each ray meets first, -1 for none.
        offset: length by which rays start off the surface, in world units.
        compiled: the same question inside a Dr.Jit kernel, from origin and direction; None where there is no LLVM.
    """

    cast: Caster
    offset: float
    compiled: Callable[[Any, Any], Any] | None

    @staticmethod
    def of(shape: Shape) -> Occluder:
        """The occluder of a shape, were it convex; Mitsuba's current variant is afterwards what it was."""
        return Occluder(caster(shape), OFF * 2 * bounding_sphere(shape)[1], _compiled(shape))

    def origins(self, surface: GBuffer) -> Float[Tensor, "*p 3"]:
        """Where rays from the surface start."""
        return surface.position + self.offset * surface.geometric_normal

    def free(
        self,
        origins: Float[Tensor, "*#p 3"],
        directions: Float[Tensor, "*#p 3"],
        distance: Float[Tensor, "*p"] | None = None,
    ) -> Bool[Tensor, "*p"]:
        """Whether light from each direction reaches its place; the two broadcast.

        Args:
            origins: where shadow rays start.
            directions: unit, towards the light.
            distance: where they end; left out, or inf, for light from infinitely far away.
        """
        starts, towards = (each.double() for each in torch.broadcast_tensors(origins, directions))
        ends = () if distance is None else (distance.double().reshape(-1),)
        face = self.cast(starts.reshape(-1, 3), towards.reshape(-1, 3), *ends)
        return torch.from_numpy(face < 0).reshape(starts.shape[:-1])

    def openness(self, surface: GBuffer) -> Float[Tensor, " p"]:
        """The thesis's ambient occlusion of points [p]: share of even surroundings that light them, in [0, 1]."""
        u1, u2 = torch.quasirandom.SobolEngine(2, scramble=True, seed=0).draw(_RAYS).double().T
        towards = cosine_directions(surface, *(each.expand(len(surface.hit), -1) for each in (u1, u2)))
        return self.free(self.origins(surface)[:, None], towards).double().mean(1)

    def before(self, origins: Float[Tensor, "p s 3"]) -> Callable[[tuple[Tensor, ...]], Float[Tensor, "p s"]]:
        """From directions (x, y, z, each [p, s]) to 1 where light from there reaches these places, else 0."""

        def free(towards: tuple[Tensor, ...]) -> Float[Tensor, "p s"]:
            return self.free(origins, torch.stack(towards, -1).cpu()).to(towards[0])

        return free


def occluder(shape: Shape) -> Occluder | None:
    """The occluder of a shape; None where no part of it can stand before another."""
    return Occluder.of(shape) if isinstance(shape, Mesh) and not is_convex(shape) else None


def is_convex(mesh: Mesh) -> bool:
    """Whether the mesh is one closed convex surface, seen from outside: none of its points sees another.

    Vertices that files repeat along seams count as one.
    """
    import trimesh

    joined = trimesh.Trimesh(mesh.vertices, mesh.faces, process=True)
    return bool(joined.is_convex and joined.volume > 0)


def _compiled(shape: Shape) -> Callable[[Any, Any], Any] | None:
    """A function from origins and directions, Dr.Jit's arrays without derivatives, to whether light passes."""
    mi = mitsuba_library()
    before = mi.variant()
    try:
        mi = conversion.mitsuba("llvm_ad_rgb")
    except InputError:  # no LLVM here
        return None
    try:
        scene = mi.load_dict({"type": "scene", "object": conversion.mitsuba_shape(shape)})
        ray_type, point, vector = mi.Ray3f, mi.Point3f, mi.Vector3f  # of this variant, whatever is current later
    finally:
        if before is not None:
            mi.set_variant(before)

    def free(origin: Any, direction: Any) -> Any:
        import drjit as dr

        met = scene.ray_test(ray_type(point(*origin), vector(*direction)))
        return ~dr.detach(met, preserve_type=False)

    return free
