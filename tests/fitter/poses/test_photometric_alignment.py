"""How pictures move with the camera: a way round a ball is the light turned the other way."""

from __future__ import annotations

from dataclasses import replace

import torch

from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.observations.album import Album
from fit_material.fitter.observations.photograph import Photograph
from fit_material.fitter.options.fidelity import PRESETS
from fit_material.fitter.poses.photometric_alignment import Shown, shown_pixels, slopes
from fit_material.renderer.cameras.camera import Camera, look_at
from fit_material.renderer.cameras.pose_offset import Pose
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.geometry.mesh import Sphere
from fit_material.renderer.rays import gbuffer
from fit_material.shaders.materials.types import Matte, Metal
from fit_material.shaders.materials.widths import Microfacet
from tests.support.soft_scene import soft_light

SIZE, PIXELS, ANGLE = 40, 200, 0.05
N, K, ALPHA = (torch.tensor(each, dtype=torch.float64) for each in ([0.15, 0.43, 1.4], [3.6, 2.3, 1.9], 0.3))
GOLD = Metal(N, K, Microfacet(ALPHA))
CLAY = Matte(*(torch.tensor(each, dtype=torch.float64) for each in ([0.5, 0.3, 0.2], [0.9] * 3)))


def album() -> Album:
    pose = look_at(*(torch.tensor(each, dtype=torch.float64) for each in ([0, 0, 4.0], [0, 0, 0], [0, 1.0, 0])))
    empty = torch.zeros(SIZE, SIZE, 3)
    return Album.of([Photograph("view", empty, torch.ones(SIZE, SIZE) > 0, Camera(pose, SIZE, SIZE), 1.0, 0, 0)])


def lighting(turned: float = 0.0) -> Lighting:
    """The light turned about +Y by radians."""
    light = Environment(torch.from_numpy(soft_light()), rotation=float(torch.rad2deg(torch.tensor(turned))))
    return Lighting(light, (), replace(PRESETS["preview"], footprint=4))


def seen() -> tuple[Shown, Pose, gbuffer.Tracer]:
    photographs, trace = album(), gbuffer.tracer(Sphere())
    pose = Pose.of(photographs[0].camera, Sphere())
    (shown,) = shown_pixels(photographs, [pose], trace, materials=1, count=PIXELS, footprint=4, seed=0)
    return shown, pose, trace


def assert_slopes_as_the_light_turns(material: Metal | Matte) -> None:
    shown, pose, trace = seen()
    surface = shown.seen(trace, [pose.camera], 4)
    found = slopes(shown, surface, [pose], trace, lighting(), material, lambda stage, share: None).mean(0)
    about = found @ pose.ways(ANGLE)[1]  # about +Y, which is up for this camera
    ahead, behind = (lighting(side * ANGLE).radiance(material, surface, 4096) for side in (-1, 1))
    expected = (ahead - behind) / 2
    # A metal's table of 1024 directions has a noise of some 2 %, the change is of the order of 5 %, by six differences.
    assert float((about - expected).norm() / expected.norm()) < 0.15


def test_a_metals_slopes_round_a_ball_are_those_of_the_light_turned():
    assert_slopes_as_the_light_turns(GOLD)


def test_a_matte_bodys_slopes_round_a_ball_are_those_of_the_light_turned():
    assert_slopes_as_the_light_turns(CLAY)


def test_pixels_that_leave_the_ball_are_told_by_the_other_side():
    """Where the outline passes a pixel, its slope is still finite, and of the size of its neighbours'."""
    shown, pose, trace = seen()
    surface = shown.seen(trace, [pose.camera], 4)
    found = slopes(shown, surface, [pose], trace, lighting(), CLAY, lambda stage, share: None)[0]
    assert bool(found.isfinite().all())
    rim = surface.n_dot_v.mean(1) < 0.3
    assert 10 < int(rim.sum()) < len(rim) / 2
    assert float(found[rim].norm(dim=(1, 2)).max()) < 20 * float(found[~rim].norm(dim=(1, 2)).median())


def test_pixels_are_of_the_ball_and_spread_over_its_angles():
    shown, pose, trace = seen()
    surface = shown.seen(trace, [pose.camera], 4)
    assert bool(shown.whole(surface).all())
    assert PIXELS * 0.8 < len(shown.radiance) <= PIXELS * 1.2
    half = shown[surface.n_dot_v.mean(1) < 0.5]
    assert 0.2 < len(half.radiance) / len(shown.radiance) < 0.7  # evenly in n·v, as far as the rim has pixels
    assert len(half.pixels[0]) == len(half.radiance) == len(half.photograph)
