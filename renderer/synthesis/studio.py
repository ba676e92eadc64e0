"""Surroundings made here, so that nothing need be downloaded: a photographer's studio, and sun and sky."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from fit_material.renderer.environment.environment import Environment, directions
from fit_material.renderer.environment.latlong import texel_solid_angles
from fit_material.renderer.geometry.bounds import Vector
from fit_material.renderer.mitsuba.conversion import mitsuba


@dataclass(frozen=True)
class SoftBox:
    """A bright rectangle with a soft rim, on a plane at distance 1.

    Attributes:
        towards: direction of its centre, any length.
        extent: half width and half height, as fractions of the distance.
        roll: degrees by which it is rotated in that plane.
        radiance: at its centre, linear Rec. 709.
        edge: width of the soft rim, in the units of `extent`.
    """

    towards: Vector
    extent: tuple[float, float]
    roll: float
    radiance: Vector
    edge: float = 0.08


@dataclass(frozen=True)
class Lamp:
    """A small round lamp with a Gaussian profile.

    Attributes:
        towards: direction of its centre, any length.
        width: standard deviation, degrees.
        radiance: at its centre, linear Rec. 709.
    """

    towards: Vector
    width: float
    radiance: Vector


# Placed all round, at many heights, and with no symmetry: a map that is mirrored, rotated or upside down by
# mistake shows in the picture, and every view has light behind the object for its grazing reflections.
SOFT_BOXES = (
    SoftBox((-0.75, 0.75, 0.65), (0.55, 0.40), 14, (9.0, 8.0, 6.8)),
    SoftBox((1.00, 0.20, 0.45), (0.16, 0.75), -6, (4.0, 4.2, 4.6)),
    SoftBox((0.35, 0.60, -1.00), (0.75, 0.22), 22, (5.6, 5.0, 4.3)),
    SoftBox((-1.00, -0.15, -0.55), (0.30, 0.45), -18, (2.8, 1.9, 1.2)),
    SoftBox((0.10, -0.80, 0.75), (0.50, 0.18), 35, (1.3, 1.2, 1.2)),
)
LAMPS = (
    Lamp((0.30, 0.85, 0.60), 1.5, (200.0, 190.0, 170.0)),
    Lamp((0.75, 0.45, -0.70), 1.8, (40.0, 75.0, 130.0)),
    Lamp((-0.95, 0.25, 0.15), 1.6, (120.0, 62.0, 25.0)),
    Lamp((-0.35, 0.10, -1.00), 2.2, (45.0, 60.0, 42.0)),
    Lamp((0.60, -0.35, 0.80), 2.0, (55.0, 30.0, 48.0)),
    Lamp((0.55, -0.75, -0.60), 2.4, (24.0, 22.0, 18.0)),
)
CEILING, HORIZON, FLOOR = (0.16, 0.17, 0.21), (0.42, 0.35, 0.29), (0.16, 0.11, 0.10)


def studio(height: int = 512) -> Environment:
    """A dim room with five soft boxes and six small coloured lamps; no two of its sides are alike.

    Args:
        height: rows of the map; it has twice as many columns. From 256 on the lamps are resolved.

    Returns:
        Radiance from 0.05 to about 200, linear Rec. 709.
    """
    texels = directions(height, 2 * height).numpy()
    radiance = _room(texels)
    for box in SOFT_BOXES:
        radiance += _soft_box(box, texels)
    for lamp in LAMPS:
        radiance += _glow(texels, _unit(lamp.towards), lamp.width) * np.array(lamp.radiance)
    return _environment(radiance)


def sun_and_sky(
    height: int = 512,
    towards_sun: Vector = (-0.55, 0.55, 0.62),
    turbidity: float = 3.0,
    scale: float = 10.0,
    ground: Vector = (0.18, 0.15, 0.11),
) -> Environment:
    """Mitsuba's `sunsky` emitter as a map, over a matte ground of even colour.

    The sun's disc (half a degree) is smaller than what a map resolves, so its irradiance is computed from the
    disc and given to a Gaussian spot of two texels: the light that arrives is kept, its radiance is not.

    Args:
        height: rows of the map; it has twice as many columns.
        towards_sun: direction of the sun, above the horizon; any length.
        turbidity: of the air, from 1 (clear) to 10 (hazy).
        scale: what Mitsuba's radiance, in W/m²/sr/nm, is multiplied by; 10 brings a clear sky near 1.
        ground: reflectance of the ground, linear Rec. 709.
    """
    sun = _unit(towards_sun)
    texels = directions(height, 2 * height).numpy()
    solid_angles = texel_solid_angles(height, 2 * height)[..., None]
    radiance = _sky(texels, sun, turbidity)
    spot = _glow(texels, sun, width=2 * 180 / (height - 1))
    radiance += spot / (spot * solid_angles).sum() * _sun_irradiance(sun, turbidity)
    above = texels[..., 1:2] > 0
    arriving = (radiance * np.clip(texels[..., 1:2], 0, None) * solid_angles).sum((0, 1))
    return _environment(scale * np.where(above, radiance, np.array(ground) / np.pi * arriving))


def _unit(vector: Vector) -> Float[np.ndarray, " 3"]:
    return np.array(vector) / np.linalg.norm(vector)


def _environment(radiance: Float[np.ndarray, "h w 3"]) -> Environment:
    return Environment(torch.as_tensor(radiance, dtype=torch.float32))


def _smooth_step(x: np.ndarray) -> np.ndarray:
    """0 below 0, 1 above 1, and 3x² - 2x³ between."""
    x = np.clip(x, 0, 1)
    return x * x * (3 - 2 * x)


def _room(texels: Float[np.ndarray, "h w 3"]) -> Float[np.ndarray, "h w 3"]:
    """Walls that are lightest at the horizon and darker on one side, between ceiling and floor."""
    x, y, z = np.moveaxis(texels, -1, 0)[..., None]
    upwards, downwards = _smooth_step(y), _smooth_step(-y)
    room = np.array(HORIZON) * (1 - upwards - downwards)
    room = room + np.array(CEILING) * upwards + np.array(FLOOR) * downwards
    return room * (0.75 + 0.25 * (0.8 * x + 0.6 * z))


def _soft_box(box: SoftBox, texels: Float[np.ndarray, "h w 3"]) -> Float[np.ndarray, "h w 3"]:
    """Radiance of the rectangle, seen by central projection on the plane before it."""
    centre, roll = _unit(box.towards), np.deg2rad(box.roll)
    level = _unit((centre[2], 0.0, -centre[0]))
    upright = np.cross(centre, level)
    right = np.cos(roll) * level + np.sin(roll) * upright
    up = np.cos(roll) * upright - np.sin(roll) * level
    depth = texels @ centre
    plane = np.stack([texels @ right, texels @ up], axis=-1) / np.maximum(depth, 1e-6)[..., None]
    inside = _smooth_step((np.array(box.extent) - np.abs(plane)) / box.edge + 0.5).prod(-1)
    return np.where(depth > 0, inside, 0)[..., None] * np.array(box.radiance)


def _glow(
    texels: Float[np.ndarray, "h w 3"], centre: Float[np.ndarray, " 3"], width: float
) -> Float[np.ndarray, "h w 1"]:
    """The Gaussian of the sphere (von Mises and Fisher's), 1 at its centre, of `width` degrees."""
    return np.exp((texels @ centre - 1) / np.deg2rad(width) ** 2)[..., None]


def _sunsky(sun: Float[np.ndarray, " 3"], turbidity: float, **parts: float):
    """Mitsuba's emitter, rotated from its own +Z to our +Y, as a function of the direction looked along."""
    mi = mitsuba("scalar_rgb")
    turn = mi.ScalarTransform4f().rotate([1, 0, 0], -90)
    settings = {"sun_direction": list(sun), "turbidity": turbidity, "to_world": turn}
    emitter, interaction = mi.load_dict({"type": "sunsky", **settings, **parts}), mi.SurfaceInteraction3f()

    def radiance(x: float, y: float, z: float):
        interaction.wi = mi.Vector3f(-x, -y, -z)
        return emitter.eval(interaction)

    return radiance


def _sky(
    texels: Float[np.ndarray, "h w 3"], sun: Float[np.ndarray, " 3"], turbidity: float
) -> Float[np.ndarray, "h w 3"]:
    """The sky without its sun; black below the horizon."""
    above = texels[..., 1] > 0
    sky = _sunsky(sun, turbidity, sun_scale=0.0)
    radiance = np.zeros(texels.shape)
    radiance[above] = [sky(*direction) for direction in texels[above].tolist()]
    return radiance


def _sun_irradiance(sun: Float[np.ndarray, " 3"], turbidity: float) -> Float[np.ndarray, " 3"]:
    """Radiance of the disc, which is even, times its solid angle; W/m²/nm on a plane that faces the sun."""
    disc = _sunsky(sun, turbidity, sky_scale=0.0)
    aperture = np.deg2rad(0.5358)  # Mitsuba's `sun_aperture`: the sun's full angle seen from the earth
    return np.array(disc(*sun.tolist())) * 2 * np.pi * (1 - np.cos(aperture / 2))
