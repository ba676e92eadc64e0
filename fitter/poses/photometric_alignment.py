"""A camera's pose by reflections: pixels of the photographs, and how the model's picture moves with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fit_material.fitter.estimation.coarse_to_fine import Fit, refit_nearby
from fit_material.fitter.estimation.model_selection import fit_type
from fit_material.fitter.estimation.problem import Problem
from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.least_squares.solvers import SOLVERS
from fit_material.fitter.observations.album import Album
from fit_material.fitter.observations.pixel_selection import Observations
from fit_material.fitter.observations.view_sampling import Pixels, sampled_views
from fit_material.fitter.options.progress import Progress
from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.cameras.pose_offset import Pose
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer, Tracer
from fit_material.shaders.materials.kinds import MaterialType
from fit_material.shaders.materials.types import Material
from fit_material.shaders.materials.widths import alpha_of

BY_ALPHA = 0.25  # radians per alpha by which derivatives turn a camera: within a lobe's width, far beyond noise
NARROWEST, WIDEST = 0.004, 0.05  # the least and the most of them
SLOPE_SAMPLES = 1024  # directions per pixel


@dataclass(frozen=True)
class Shown:
    """Pixels that show one material.

    Attributes:
        material: index among the mesh's.
        pixels: of each photograph in turn, row and column.
        radiance: what the photographs show there, float64.
    """

    material: int
    pixels: tuple[Pixels, ...]
    radiance: Float[Tensor, "p 3"]

    @property
    def photograph(self) -> Int[Tensor, " p"]:
        """Which photograph each pixel is of."""
        counts = torch.tensor([len(each) for each in self.pixels])
        return torch.repeat_interleave(torch.arange(len(counts)), counts)

    @property
    def place(self) -> Int[Tensor, "p 3"]:
        """Photograph, row and column."""
        return torch.cat([self.photograph[:, None], torch.cat(self.pixels)], 1)

    def seen(self, trace: Tracer, cameras: Sequence[Camera], footprint: int) -> GBuffer:
        """What they show if the photographs are taken by these cameras: [p, k] rays."""
        pairs = zip(cameras, self.pixels, strict=True)
        found = [gbuffer.pixel_footprints(trace, camera, each[:, 1], each[:, 0], footprint) for camera, each in pairs]
        return gbuffer.concatenate(found)

    def whole(self, surface: GBuffer) -> Tensor:
        """Pixels that show the front of this material and nothing else."""
        return (surface.front & (surface.material == self.material)).all(-1)

    def __getitem__(self, chosen: Tensor) -> Shown:
        parts = chosen.split([len(each) for each in self.pixels])
        pixels = tuple(each[part] for each, part in zip(self.pixels, parts, strict=True))
        return Shown(self.material, pixels, self.radiance[chosen])


def shown_pixels(
    photographs: Album, poses: Sequence[Pose], trace: Tracer, *, materials: int, count: int, footprint: int, seed: int
) -> list[Shown]:
    """Pixels of each material, spread evenly over the angles, `count` of them over all photographs.

    Those that mirror the object itself are left out as far as others are there. A material that is nowhere seen has
    none.
    """
    generator = torch.Generator().manual_seed(seed)
    pixels: list[list[Pixels]] = [[] for _ in range(materials)]
    radiance: list[list[Tensor]] = [[] for _ in range(materials)]
    for index, pose in enumerate(poses):
        photograph = photographs[index]
        views = sampled_views(
            trace,
            pose.camera,
            photograph.mask,
            materials=materials,
            count=-(-count // len(poses)),
            footprint=footprint,
            generator=generator,
        )
        for material, view in enumerate(views):
            pixels[material].append(view.pixels)
            radiance[material].append(photograph.radiance[view.pixels[:, 0], view.pixels[:, 1]].double())
    shown = (Shown(i, tuple(pixels[i]), torch.cat(radiance[i])) for i in range(materials))
    return [each for each in shown if len(each.radiance)]


@dataclass(frozen=True)
class Information:
    """Information of pixels about all poses together, for any material.

    Attributes:
        said: matrix of the normal equations, in which the slopes' noise is information, too.
        crossed: the same by products of slopes whose noise is independent.
        gradient: of half the sum of squares.
        fit: of the material, as things stand.
    """

    said: Float[Tensor, "v v"]
    crossed: Float[Tensor, "v v"]
    gradient: Float[Tensor, " v"]
    fit: Fit


def informed(
    shown: Shown,
    poses: Sequence[Pose],
    trace: Tracer,
    lighting: Lighting,
    kind: MaterialType | None,
    before: Fit | None,
    progress: Progress,
) -> Information:
    """One material's pixels: a fit at the present poses, and their slopes by the poses.

        S = Σ DᵀD - DᵀA (AᵀA)⁻¹ AᵀD,   g = Σ Dᵀr

    with r the whitened differences, A and D their derivatives by material and poses: the Gauss–Newton equations of both
    together, the material eliminated, by which the fit has Aᵀr = 0.

    Args:
        shown: the pixels.
        poses: of all photographs.
        trace: of the object.
        lighting: the light, and how accurately.
        kind: the material's type; None to find it.
        before: a fit by poses that were little different; None to begin with nothing.
        progress: called with the stage and the fraction of it done.
    """
    surface = shown.seen(trace, [pose.camera for pose in poses], lighting.fidelity.footprint)
    whole = shown.whole(surface)
    shown, surface = shown[whole], surface[whole]
    observed = Observations(surface, shown.radiance, 0.0, False, len(shown.radiance), shown.place)
    problem = Problem(observed, lighting, SOLVERS["lm"], progress)
    fit = fit_type(problem, kind).fit if before is None else refit_nearby(problem, before)
    whitening = fit.residuals.robust_whitening(fit.x)
    difference = torch.einsum("prc,pc->pr", whitening, fit.residuals.difference(fit.x))
    by_material = whitening @ fit.residuals.slope(fit.x)
    halves = whitening @ slopes(shown, surface, poses, trace, lighting, fit.material, progress)
    by_pose, photograph = halves.mean(0), shown.photograph

    def gathered(each: Tensor) -> Tensor:
        """Sums over each photograph's pixels."""
        return each.new_zeros(len(poses), *each.shape[1:]).index_add(0, photograph, each)

    def products(one: Float[Tensor, "p 3 6"], other: Float[Tensor, "p 3 6"]) -> Float[Tensor, "v v"]:
        found = torch.block_diag(*gathered(torch.einsum("pri,prj->pij", one, other)))
        return (found + found.T) / 2

    mixed = gathered(torch.einsum("pri,prx->pix", by_pose, by_material)).flatten(0, 1)
    material = torch.einsum("prx,pry->xy", by_material, by_material)
    shared = mixed @ torch.linalg.pinv(material, hermitian=True) @ mixed.T
    gradient = gathered(torch.einsum("pri,pr->pi", by_pose, difference)).flatten()
    return Information(products(by_pose, by_pose) - shared, products(*halves) - shared, gradient, fit)


def slopes(
    shown: Shown,
    surface: GBuffer,
    poses: Sequence[Pose],
    trace: Tracer,
    lighting: Lighting,
    material: Material,
    progress: Progress,
) -> Float[Tensor, "2 p 3 6"]:
    """Derivative of the pixels' radiance by the `motion` of their photograph's pose, by either half of the samples.

    By differences of pictures with other random numbers than the fit's: noise in a slope that knows that of the
    residuals would bias their product. The cameras go wide, along ways of which each shows: a step about the object is
    the small difference of a turn and a shift, in which noise would be all. Where a pixel leaves the object, the
    difference is one-sided.

    Args:
        shown: the pixels.
        surface: what they show by these poses, [p, k] rays.
        poses, trace, lighting, progress: as of `informed`.
        material: what they are made of.
    """
    other = replace(lighting, seed=lighting.seed + 1)
    alpha = None if material.width is None else float(alpha_of(material.width))
    angle = WIDEST if alpha is None else min(max(BY_ALPHA * alpha, NARROWEST), WIDEST)
    ways = torch.stack([pose.ways(angle) for pose in poses])
    columns = []
    for index in range(6):
        pictures, reached = [], torch.zeros(len(shown.radiance), dtype=torch.float64)
        for side in (1.0, -1.0):
            progress("moving the cameras", (2 * index + (side < 0)) / 12)
            cameras = [pose.by(side * way[index]).camera for pose, way in zip(poses, ways, strict=True)]
            moved = shown.seen(trace, cameras, lighting.fidelity.footprint)
            whole = shown.whole(moved)
            model = other.model(material, gbuffer.where(whole, moved, surface), SLOPE_SAMPLES)
            pictures.append(torch.stack([model.half(which).radiance(material) for which in (0, 1)]))
            reached = reached + whole
        change = torch.where(reached[:, None] > 0, pictures[0] - pictures[1], 0.0)
        columns.append(change / reached.clamp_min(1)[:, None])
    by_way = torch.stack(columns, -1)
    return by_way @ torch.linalg.inv(ways)[shown.photograph].mT
