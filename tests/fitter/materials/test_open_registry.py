"""A fourth type of material, defined in this file alone, is fitted, reported, written and exported.

Its photographs come from a quadrature in numpy.
"""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
import torch

from fit_material.fitter.export.export import export
from fit_material.fitter.materials.coordinates import REACH, UNIT, Coordinates, WidthInterval
from fit_material.fitter.materials.fittable import Fittable
from fit_material.fitter.materials.linear_starts import widths
from fit_material.fitter.materials.registry import FITTABLE
from fit_material.fitter.options.fidelity import PRESETS
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.fitter.pipeline.fit_scene import fit_scene
from fit_material.renderer.images.image_file import write_exr
from fit_material.renderer.materials.mtl_reader import read_mtl
from fit_material.shaders.materials.kinds import KINDS, Kind
from fit_material.shaders.materials.lobes import Blurred, Diffuse, Specular
from fit_material.shaders.materials.material import AbstractMaterial
from fit_material.shaders.materials.quantities import ALPHA, COLOR, F0, REFLECTANCE
from fit_material.shaders.materials.types import TYPES
from fit_material.shaders.materials.widths import Width, alpha_of, rho_of
from fit_material.shaders.optics import fresnel
from tests.support.registries import added

LACQUER = Kind(
    "lacquer",
    3,
    "a lacquer",
    (COLOR, REFLECTANCE),
    mirrors=True,
    has_body=True,
    derived=(F0,),
    same_as={F0.name: REFLECTANCE.name},
)


@dataclass(frozen=True)
class Lacquer(AbstractMaterial):
    """A Lambertian body under a tinted mirror, of which neither knows of the other."""

    color: torch.Tensor
    reflectance: torch.Tensor
    width: Width

    kind = LACQUER

    @staticmethod
    def reflectance_formula(asked: str, microfacets: bool) -> str:
        return "schlick"

    @property
    def f0(self) -> torch.Tensor:
        return self.reflectance

    @property
    def dtype(self) -> torch.dtype:
        return self.color.dtype

    def microfacet_lobes(self, distribution, reflectance):
        mirror = Specular(functools.partial(reflectance, self), alpha_of(self.width))
        return mirror, Diffuse(self.color, torch.ones_like, torch.ones_like)

    def thesis_lobes(self, reflectance, tint=None):
        color = self.color if tint is None else self.color * tint
        mirror = Blurred(self.schlick_reflectance, rho_of(self.width))
        return mirror, Diffuse(color, torch.ones_like, torch.ones_like)

    def exact_reflectance(self, cosine):
        return self.schlick_reflectance(cosine)

    def viewer_reflectance(self, cosine):
        return self.schlick_reflectance(cosine)

    def schlick_reflectance(self, cosine):
        return fresnel.schlick(cosine, self.reflectance)

    def albedo(self, distribution):
        return self.color + self.reflectance

    def with_color(self, color):
        return replace(self, color=color)

    def with_width(self, width):
        return replace(self, width=width)


@dataclass(frozen=True)
class LacquerCoordinates(Coordinates[Lacquer]):
    width: WidthInterval

    sizes: ClassVar[Mapping[str, int]] = {"color": 3, "reflectance": 3, "width": 1}

    def material(self, x):
        x = x.clamp(-REACH, REACH)
        color, reflectance = (UNIT.value(x[self.slices[name]]) for name in ("color", "reflectance"))
        return Lacquer(color, reflectance, self.width.width(x[self.slices["width"]]))

    def free(self, material):
        shares = [UNIT.free(UNIT.inside(each)) for each in (material.color, material.reflectance)]
        return torch.cat([*shares, self.width.free_width(material.width)])


def start(model, photograph, weight) -> Lacquer:
    """The width at which a linear fit is best: pictures are linear in colour and, by Schlick's formula, in F0."""
    white, black = torch.ones(3).double(), torch.zeros(3).double()
    tried = []
    for width in widths(model):
        dark, body, mirror = (
            model.radiance(Lacquer(color, f0, width)) for color, f0 in ((black, black), (white, black), (black, white))
        )
        columns = torch.stack([body - dark, mirror - dark], -1) * weight[..., None]
        wanted = ((photograph - dark) * weight)[..., None]
        color, f0 = torch.linalg.lstsq(columns.movedim(1, 0), wanted.movedim(1, 0)).solution[..., 0].T
        material = Lacquer(color.clamp(0.02, 0.95), f0.clamp(0.02, 0.95), width)
        error = float(((model.radiance(material) - photograph) * weight).abs().mean())
        tried.append((error, material))
    return min(tried, key=lambda each: each[0])[1]


FITTED = Fittable(
    LACQUER,
    coordinates=lambda start, width, fidelity: LacquerCoordinates(width),
    start=start,
    half_reflecting=lambda width: Lacquer(*torch.full((2, 3), 0.25).double(), width),
    examples=lambda width: {"lacquer": Lacquer(*torch.full((2, 3), 0.3).double(), width)},
    essential=(COLOR, F0, ALPHA),
    decisive=(COLOR, F0, ALPHA),
    foreseen=LacquerCoordinates,
)


@pytest.fixture(autouse=True)
def registered() -> Iterator[None]:
    with added(KINDS, LACQUER), added(TYPES, Lacquer), added(FITTABLE, FITTED):
        yield


# photographs, in numpy

LAMPS = (  # towards, sharpness, radiance
    ((1.0, 1.0, 1.0), 8.0, (6.0, 5.0, 4.0)),
    ((-2.0, 0.5, -1.0), 5.0, (1.0, 2.0, 3.0)),
    ((0.3, 0.2, 1.0), 12.0, (2.0, 2.0, 2.0)),
)
TRUE_COLOR, TRUE_REFLECTANCE, TRUE_ALPHA = np.array((0.5, 0.2, 0.08)), np.array((0.25, 0.35, 0.15)), 0.22
SIZE, RAYS, FOV, DISTANCE = 20, 2, 30.0, 4.0
NOISE = 0.005
RINGS, SPOKES = 64, 64


def light(towards: np.ndarray) -> np.ndarray:
    """Radiance by direction, [*d, 3]."""
    found = np.full(towards.shape, 0.3)
    for direction, sharpness, radiance in LAMPS:
        middle = np.array(direction) / np.linalg.norm(direction)
        found += np.exp(sharpness * (towards @ middle - 1))[..., None] * np.array(radiance)
    return found


def light_map(height: int) -> np.ndarray:
    polar = (np.arange(height) + 0.5) / height * np.pi
    azimuth = (np.arange(2 * height) + 0.5) / height * np.pi
    level = np.sin(polar)[:, None]
    towards = np.stack([level * np.sin(azimuth), np.cos(polar)[:, None] + 0 * azimuth, -level * np.cos(azimuth)], -1)
    return light(towards).astype(np.float32)


def smith(cosine: np.ndarray) -> np.ndarray:
    """G₁ of GGX [Walter 2007, eq. 34]."""
    tan2 = np.maximum(1 / cosine**2 - 1, 0)
    return 2 / (1 + np.sqrt(1 + TRUE_ALPHA**2 * tan2))


def radiance(normal: np.ndarray, view: np.ndarray) -> np.ndarray:
    """∫ (F D G/(4 n·l n·v) + color/π) L n·l dω at one point: by the quantiles of D(h) n·h, and of the cosine."""
    u1, u2 = np.meshgrid((np.arange(RINGS) + 0.5) / RINGS, (np.arange(SPOKES) + 0.5) / SPOKES)
    u1, turn = u1.ravel(), 2 * np.pi * u2.ravel()
    side = np.cross(normal, (0.0, 1.0, 0.0) if abs(normal[1]) < 0.9 else (1.0, 0.0, 0.0))
    side /= np.linalg.norm(side)
    frame = np.stack([side, np.cross(normal, side), normal])

    def directions(cosine: np.ndarray) -> np.ndarray:
        sine = np.sqrt(1 - cosine**2)
        return np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine], -1) @ frame

    body = TRUE_COLOR * light(directions(np.sqrt(1 - u1))).mean(0)
    cos_h = 1 / np.sqrt(1 + TRUE_ALPHA**2 * u1 / (1 - u1))
    half = directions(cos_h)
    cos_d = half @ view
    towards = 2 * cos_d[:, None] * half - view
    cos_l, cos_v = towards @ normal, normal @ view
    seen = (cos_l > 0) & (cos_d > 0)
    f = TRUE_REFLECTANCE + (1 - TRUE_REFLECTANCE) * (1 - np.clip(cos_d, 0, 1))[:, None] ** 5
    shadowed = smith(np.where(seen, cos_l, 1.0)) * smith(cos_v) * cos_d / (cos_v * cos_h) * seen
    return body + (f * shadowed[:, None] * light(towards)).mean(0)


def photograph(azimuth: float, generator: np.random.Generator) -> tuple[np.ndarray, list[float]]:
    """A ball of radius 1 with its coverage, [SIZE, SIZE, 4], and where the camera stands."""
    turn = math.radians(azimuth)
    origin = DISTANCE * np.array((math.sin(turn), 0.0, math.cos(turn)))
    forward = -origin / DISTANCE
    right, up = np.cross(forward, (0.0, 1.0, 0.0)), np.array((0.0, 1.0, 0.0))
    place = ((np.arange(SIZE * RAYS) + 0.5) / (SIZE * RAYS) * 2 - 1) * math.tan(math.radians(FOV / 2))
    picture = np.zeros((SIZE * RAYS, SIZE * RAYS, 4))
    for row, y in enumerate(-place):
        for column, x in enumerate(place):
            ray = forward + x * right + y * up
            ray /= np.linalg.norm(ray)
            along, nearest = -(origin @ ray), origin @ origin - (origin @ ray) ** 2
            if nearest < 1:
                normal = origin + (along - math.sqrt(1 - nearest)) * ray
                picture[row, column] = [*radiance(normal, -ray), 1.0]
    mean = picture.reshape(SIZE, RAYS, SIZE, RAYS, 4).mean((1, 3))
    mean[..., :3] *= 1 + NOISE * generator.standard_normal(mean[..., :3].shape)
    return mean.astype(np.float32), origin.tolist()


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Path:
    folder, generator = tmp_path_factory.mktemp("lacquer"), np.random.default_rng(3)
    write_exr(folder / "map.exr", light_map(128))
    lines = ["[geometry]", 'shape = "sphere"', "[environment]", 'map = "map.exr"']
    for azimuth in (0.0, 110.0):
        picture, origin = photograph(azimuth, generator)
        write_exr(folder / f"view_{azimuth:g}.exr", picture)
        lines += ["[[photographs]]", f'image = "view_{azimuth:g}.exr"', "[photographs.camera]"]
        lines += [f"origin = {json.dumps(origin)}", "target = [0, 0, 0]", f"fov = {FOV}"]
    lines += ["[[materials]]", 'name = "default"', f'type = "{LACQUER.name}"']
    (folder / "scene.toml").write_text("\n".join(lines) + "\n")
    return folder / "scene.toml"


def test_a_type_of_this_file_is_fitted_reported_written_and_exported(scene, tmp_path):
    """Each number within four of its standard errors, which are small: ten numbers, of which one in a thousand such
    runs would lie outside."""
    options = FitOptions(PRESETS["preview"], seed=1)
    result = fit_scene(scene, tmp_path, options)
    (found,) = result.materials
    assert (result.status, found.type) == ("converged", "lacquer")
    for name, truth, error in (("color", TRUE_COLOR, 0.01), ("reflectance", TRUE_REFLECTANCE, 0.02)):
        stderr = np.array(getattr(found.stderr, name))
        np.testing.assert_array_less(np.abs(np.array(getattr(found, name)) - truth), 4 * stderr)
        np.testing.assert_array_less(stderr, error)
        assert getattr(found.determined, name) == (True,) * 3
    assert abs(found.alpha - TRUE_ALPHA) < 4 * found.stderr.alpha < 0.02
    assert "a lacquer" in (tmp_path / "report.html").read_text()
    (appearance,) = read_mtl(next(tmp_path.glob("*.thesis.mtl"))).appearances.values()
    assert isinstance(appearance.material, Lacquer)
    torch.testing.assert_close(appearance.material.color, torch.tensor(found.color, dtype=torch.float32))
    (exported,) = export(result, ["gltf"], tmp_path / "out", "ball")
    (material,) = json.loads(exported.read_text())["materials"]
    assert material["pbrMetallicRoughness"]["baseColorFactor"][:3] == pytest.approx(found.color)
