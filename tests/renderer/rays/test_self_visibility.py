"""What an object hides of its own surroundings, against closed forms, quadrature and Mitsuba's paths."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
import trimesh
from jaxtyping import Bool, Float
from torch import Tensor

from fit_material.renderer.cameras.camera import Camera, look_at
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.geometry.mesh import Mesh, Shape, Sphere
from fit_material.renderer.materials.bsdf import conductor
from fit_material.renderer.materials.catalogue import metal
from fit_material.renderer.path_tracing.path_tracer import render
from fit_material.renderer.rays import gbuffer, self_visibility
from fit_material.renderer.rays.gbuffer import GBuffer, Tracer
from fit_material.renderer.rays.self_visibility import ROUNDS, WIDE, hidden_share, sees_itself
from tests.support.soft_scene import soft_light

pytestmark = pytest.mark.dr_jit

CENTRES = np.array([[-1.25, 0.0, 0.0], [1.25, 0.0, 0.0]])
DIRECTIONS = sum(ROUNDS)


def ball(centre: np.ndarray, subdivisions: int = 4) -> Mesh:
    """Of radius 1."""
    solid = trimesh.creation.icosphere(subdivisions=subdivisions)
    normals = np.asarray(solid.vertices)
    return Mesh(normals + centre, np.asarray(solid.faces), normals, None, np.zeros(len(solid.faces), dtype=int))


def balls() -> Mesh:
    """Two, half a radius apart."""
    one, other = (ball(centre) for centre in CENTRES)
    return Mesh(
        np.concatenate([one.vertices, other.vertices]),
        np.concatenate([one.faces, other.faces + len(one.vertices)]),
        np.concatenate([one.normals, other.normals]),  # type: ignore[list-item]
        None,
        np.concatenate([one.material, other.material]),
    )


def bowl() -> Mesh:
    """The inner side of a half sphere that opens towards +Z."""
    whole = ball(np.zeros(3), 5)
    faces = whole.faces[(whole.vertices[whole.faces][..., 2] <= 1e-9).all(1)][:, ::-1]
    return Mesh(whole.vertices, faces, -whole.vertices, None, np.zeros(len(faces), dtype=int))


def camera(origin: tuple[float, float, float] = (1.0, 2.0, 6.0), size: int = 48, fov: float = 45.0) -> Camera:
    pose = look_at(*(torch.tensor(v, dtype=torch.float64) for v in (origin, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))))
    return Camera(pose, size, size, fov=fov)


def seen(trace: Tracer, view: Camera) -> GBuffer:
    surface = gbuffer.pixel_centres(trace, view)
    return surface[surface.front]


def facing(tilt: float) -> float:
    """Share of GGX facets that mirror a view straight down the normal by more than a tilt, in degrees.

    P(tan θ > t) = α² / (α² + t²), of facets as seen from above.
    """
    return WIDE**2 / (WIDE**2 + math.tan(math.radians(tilt / 2)) ** 2)


def test_the_pole_of_a_bowl_hides_what_the_closed_form_says():
    """A chord from the pole ends below the rim if it tilts by 45° to 90°. N points with 64 directions each know their
    mean share to 1/(2 √64N) at most; off the pole by δ, the 45° are off by at most δ: the share by P'(45°) δ."""
    trace = gbuffer.tracer(bowl())
    surface = seen(trace, camera((0.0, 0.0, 60.0), 96, 1.0))
    off = math.radians(6)
    pole = surface[surface.position[:, 2] < -math.cos(off)]
    assert len(pole.hit) > 100
    slope = (facing(44) - facing(46)) / math.radians(2)
    error = 4 / (2 * (DIRECTIONS * len(pole.hit)) ** 0.5) + slope * off**2
    assert hidden_share(trace, pole).mean().item() == pytest.approx(facing(45) - facing(90), abs=error)
    assert sees_itself(trace, pole).all()


def lobe_quadrature(surface: GBuffer, count: int = 120) -> tuple[Float[Tensor, "p q 3"], Float[Tensor, "p q"]]:
    """Directions into which GGX facets of alpha `WIDE` mirror the view, on a grid, and what each counts: the area that
    the viewer sees of the facets, max(0, v·h) D(h) dω."""
    slope, azimuth = torch.meshgrid(
        WIDE * torch.tan((torch.arange(count).double() + 0.5) / count * math.pi / 2),
        2 * math.pi * (torch.arange(count).double() + 0.5) / count,
        indexing="ij",
    )
    h_z = 1 / (1 + slope**2).sqrt()
    local = torch.stack([slope * h_z * azimuth.cos(), slope * h_z * azimuth.sin(), h_z], -1).reshape(-1, 3)
    # D dω = t dt / (cos θ (1 + (t/α)²)²) and steps of t = α tan x are dt ∝ 1 + (t/α)²
    weight = (slope / WIDE / (1 + (slope / WIDE) ** 2) / h_z).reshape(-1)
    across = torch.nn.functional.normalize(torch.linalg.cross(surface.normal, surface.view), dim=-1)
    frame = torch.stack([torch.linalg.cross(across, surface.normal), across, surface.normal], 1)
    half = torch.einsum("qi,pij->pqj", local, frame)
    v_dot_h = torch.einsum("pqj,pj->pq", half, surface.view)
    return 2 * v_dot_h[..., None] * half - surface.view[:, None], v_dot_h.clamp_min(0) * weight


def meets_other_ball(position: Float[Tensor, "p 3"], towards: Float[Tensor, "p q 3"]) -> Bool[Tensor, "p q"]:
    """From a point on one ball."""
    centres = torch.from_numpy(CENTRES)
    other = centres[(position[:, 0] < 0).long()] - position
    along = torch.einsum("pqj,pj->pq", towards, other)
    return (along > 0) & ((other**2).sum(-1, keepdim=True) - along**2 < 1)


def test_two_balls_hide_what_quadrature_says():
    """64 directions, spread evenly, err by less than 64 random ones: by √(s (1 - s) / 64) each."""
    trace = gbuffer.tracer(balls())
    surface = seen(trace, camera())
    towards, weight = lobe_quadrature(surface)
    below = (towards * surface.geometric_normal[:, None]).sum(-1) <= 0
    met = meets_other_ball(surface.position, towards) & ~below
    expected = (met * weight).sum(1) / weight.sum(1)
    found = hidden_share(trace, surface)
    assert len(found) > 300
    assert ((found - expected) ** 2).mean() < (expected * (1 - expected)).mean() / DIRECTIONS
    assert abs((found - expected).mean()) < 0.003  # facets of 4° are 0.0006 off their ball; quadrature in steps of 3°
    none = expected == 0
    assert none.double().mean() > 0.2
    free = ~sees_itself(trace, surface)
    assert free[none].all()
    assert not free[expected > 0.2].any()  # would pass by chance with 0.8⁶⁴ = 6e-7 each


@pytest.mark.parametrize("shape", [Sphere(), ball(np.zeros(3))], ids=["sphere", "mesh"])
def test_what_is_convex_is_asked_once(shape: Shape):
    trace, rays = gbuffer.tracer(shape), []

    def counting(origins: Tensor, directions: Tensor) -> GBuffer:
        rays.append(len(origins))
        return trace(origins, directions)

    surface = seen(trace, camera())
    assert not sees_itself(counting, surface).any()
    assert sum(rays) <= ROUNDS[0] * len(surface.hit)
    assert len(surface.hit) > 200


def test_many_points_are_looked_from_in_blocks(monkeypatch):
    """In any blocks the same is seen; and no more rays are asked for at once than a block has."""
    trace, rays = gbuffer.tracer(balls()), []

    def counting(origins: Tensor, directions: Tensor) -> GBuffer:
        rays.append(len(origins))
        return trace(origins, directions)

    surface = seen(trace, camera())
    whole = sees_itself(trace, surface), hidden_share(trace, surface)
    monkeypatch.setattr(self_visibility, "BLOCK", 17)
    assert torch.equal(sees_itself(counting, surface), whole[0])
    assert torch.equal(hidden_share(counting, surface), whole[1])
    assert max(rays) <= 17 * max(ROUNDS)


def test_of_nothing_nothing_is_seen():
    nothing = seen(gbuffer.tracer(balls()), camera())[:0]
    assert sees_itself(gbuffer.tracer(balls()), nothing).shape == hidden_share(gbuffer.tracer(balls()), nothing).shape


@pytest.mark.parametrize("alpha", [0.1, 0.4])
def test_pixels_that_are_free_have_no_interreflection(alpha: float):
    """Mitsuba's photographs with one reflection and with all, of the same first segments, so that noise cancels.

    Of a pixel's light a share of at most 1/64 of the directions, in the mean, can come from the other ball, which is
    as bright as what it mirrors: over all pixels kept that is less than 1/64 of their light.
    """
    shape, view, gold = balls(), camera(), metal("Au")
    light = Environment(torch.from_numpy(soft_light()))
    once, always = (
        render(shape, view, light, conductor(gold.n, gold.k, alpha), spp=256, seed=1, max_depth=depth)[..., :3]
        for depth in (2, 8)
    )
    trace = gbuffer.tracer(shape)
    front = gbuffer.pixel_centres(trace, view).front.numpy()
    mirrored = sees_itself(trace, seen(trace, view)).numpy()
    added = (always - once)[front].sum(-1)
    share = [added[which].sum() / once[front].sum(-1)[which].sum() for which in (~mirrored, mirrored)]
    assert 0.3 < mirrored.mean() < 0.8
    assert share[0] < 1 / DIRECTIONS
    assert share[1] > 0.05
