"""The top of the ladder: a last fit with Mitsuba as the forward model, which sees what the object does to itself.

A light table knows the direct light exactly and nothing else. Mitsuba's paths give what it leaves out: light that the
object hides from itself, and light that it mirrors on itself. At a metal m₀ their sum is Mitsuba's picture, and so are
its derivatives; around it the table knows how direct light goes on:

    L(m) = table(m) + P(m₀) + ∂P/∂m (m - m₀)

The same pixels are fitted to it by the same least squares, in turn with paths for the metal found, until that moves no
more: first-order manifold mapping [Echeverría & Hemker 2005]. The paths' noise is independent from pixel to pixel, as
the photographs' is, so that the scatter of the residuals counts it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.functional import jvp

from fit_material.fitter.estimation.coarse_to_fine import Fit, Problem, refined
from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.forward.pixel_model import MixedPixels, PixelModel
from fit_material.fitter.least_squares.covariance import unbiased
from fit_material.fitter.least_squares.reduced_residuals import solved
from fit_material.fitter.least_squares.solvers import Solver
from fit_material.fitter.observations.scene_data import Loaded
from fit_material.fitter.options.fidelity import Fidelity
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.light_tables.light_table import LightTable
from fit_material.renderer.materials.bsdf import Bsdf, diffuse
from fit_material.renderer.mitsuba.conversion import bsdf
from fit_material.renderer.path_tracing import differentiable_scene
from fit_material.renderer.path_tracing.differentiable_scene import DifferentiableScene, Radiance
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.shaders.materials.types import Material, Metal
from fit_material.shaders.materials.widths import alpha_of
from fit_material.shaders.optics import fresnel
from fit_material.shaders.optics.microfacets import Distribution

SAMPLES = 1024  # paths per pixel
FEWER_SHOWN = 128  # … of a picture to look at
ROUNDS = 12
WIDE = 2.0  # factor of the first table's roughness, which what was left out may have moved far
SETTLED = 1.0  # standard errors
PATHS_SEED = 0x9A7B  # beside the fit's own, so that no path of a photograph made by `synth` is walked again
GREY = (0.5, 0.5, 0.5)  # of materials that no photograph shows


@dataclass(frozen=True)
class Tangent:
    """What paths add to the radiance of pixels, to first order around one metal.

    Its coordinates are F0, the share t = ln n / ln m of the way from n = 1 to the limit m that n has at this F0, and
    alpha. Both of the first are bounded: where the photographs leave n and k open, these may go anywhere without
    taking the picture along.

    Attributes:
        value: [p, 3] at the metal.
        slopes: its derivatives by the three coordinates.
        origin: the metal's coordinates.
    """

    value: Float[Tensor, "p 3"]
    slopes: tuple[Float[Tensor, "p 3"], ...]
    origin: tuple[Tensor, ...]

    @staticmethod
    def of(added: Radiance, metal: Metal) -> Tangent:
        """From the derivatives by n and k: (∂/∂F0, ∂/∂t) = (∂/∂n, ∂/∂k) J⁻¹, J of (F0, t) by (n, k) per channel."""
        at, one = (metal.n, metal.k), torch.ones_like(metal.n)
        by_n = jvp(_coordinates, at, (one, 0 * one))
        by_k = jvp(_coordinates, at, (0 * one, one))
        (f0_n, t_n), (f0_k, t_k) = by_n[1], by_k[1]
        determinant = f0_n * t_k - f0_k * t_n
        by_f0 = (added.by_n * t_k - added.by_k * t_n) / determinant
        by_t = (added.by_k * f0_n - added.by_n * f0_k) / determinant
        return Tangent(added.value, (by_f0, by_t, added.by_alpha), (*by_n[0], alpha_of(metal.width)))

    @property
    def mixed(self) -> Float[Tensor, "p 4 3"]:
        """Value and slopes."""
        return torch.stack([self.value, *self.slopes], 1)

    def mixing(self, metal: Metal) -> Float[Tensor, "4 3"]:
        """How much each of these counts at another metal: all of the value, and of each slope the way there."""
        place = (*_coordinates(metal.n, metal.k), alpha_of(metal.width).expand(3))
        ways = (there - here for there, here in zip(place, self.origin, strict=True))
        return torch.stack([torch.ones_like(metal.n), *ways])


def _coordinates(n: Float[Tensor, "3"], k: Float[Tensor, "3"]) -> tuple[Float[Tensor, "3"], Float[Tensor, "3"]]:
    f0 = fresnel.normal_reflectance(n, k)
    return f0, n.log() / fresnel.index_limit(f0).log()


@dataclass(frozen=True)
class PolishedPixels(MixedPixels):
    """A table's model with what Mitsuba's paths add to it.

    Attributes:
        base: the table's model.
        added: what the table leaves out, by independent sets of paths; the model has their mean.
    """

    base: PixelModel
    added: tuple[Tangent, ...]

    @property
    def table(self) -> LightTable | None:  # type: ignore[override]
        return self.base.table

    def under(self, table: LightTable | None) -> PolishedPixels:
        return replace(self, base=self.base.under(table))

    def half(self, which: int) -> PolishedPixels:
        """The same pixels with one half of the table's samples, and one half of the paths."""
        return PolishedPixels(self.base.half(which), self.added[which : which + 1])

    def radiance(self, material: Material) -> Float[Tensor, "p 3"]:
        """Radiance of every pixel."""
        added = torch.einsum("pqc,qc->pc", self._together, self.added[0].mixing(_as_metal(material)))
        return self.base.radiance(material) + added

    def mixing(self, material: Material) -> Float[Tensor, "q 3"] | None:
        """The base's, and the paths'."""
        assert isinstance(self.base, MixedPixels)
        direct = self.base.mixing(material)
        return None if direct is None else torch.cat([direct, self.added[0].mixing(_as_metal(material))])

    def mixed(self, pixels: slice) -> Float[Tensor, "p q 3"]:
        """The base's, and what the paths add."""
        assert isinstance(self.base, MixedPixels)
        return torch.cat([self.base.mixed(pixels), self._together[pixels]], 1)

    @cached_property
    def _together(self) -> Float[Tensor, "p 4 3"]:
        """The mean of all sets of paths, whose origin is the same metal."""
        return torch.stack([each.mixed for each in self.added]).mean(0)


@dataclass(frozen=True)
class Polish:
    """The polished fit of a metal.

    Attributes:
        fit: what was found, its model a `PolishedPixels`.
        scene: the object in Mitsuba.
        seed: of the paths.
    """

    fit: Fit
    scene: DifferentiableScene
    seed: int

    def picture(self, surface: GBuffer) -> Float[Tensor, "p 3"]:
        """What a table leaves out of the radiance of pixels [p, k], for pictures to look at."""
        metal = _metal(self.fit)
        return self.scene.radiance(surface, metal, samples=FEWER_SHOWN, seed=self.seed, beyond_direct=True).value


def polished(problem: Problem, fit: Fit, scene: DifferentiableScene) -> Polish:
    """Polish the fit of a metal; its solution is "stopped" where `ROUNDS` rounds did not settle.

    First come rounds with tables, weights and paths of their own, then some with all of these as they are: what is
    drawn anew each time moves a fit to few pixels too much to settle.

    Args:
        problem: that the fit solved.
        fit: where to begin.
        scene: the object in Mitsuba, the fitted metal the one that may change.
    """
    seed, alike = PATHS_SEED + problem.lighting.seed, fit.alike
    for span in (WIDE, WIDE, problem.fidelity.spans[-1]):
        lighting = replace(problem.lighting, fidelity=replace(problem.fidelity, spans=(span,)))
        added = _traced(problem, _metal(fit), scene, seed)
        fit = refined(replace(problem, lighting=lighting, corrected=partial(PolishedPixels, added=added)), fit)
    return Polish(replace(_settled(problem, fit, scene, seed), alike=alike), scene, seed)


def _settled(problem: Problem, fit: Fit, scene: DifferentiableScene, seed: int) -> Fit:
    """Rounds of the same table, weights and paths, until the steps vanish.

    Where the photographs leave n and k open, the light bends more within a step than its slopes predict, and steps may
    swing from one side to the other: each time they turn back, less of them is taken.
    """
    drawn, share, last = _metal(fit), 1.0, torch.zeros_like(fit.x)
    for _ in range(ROUNDS):
        asked = _again(fit, _traced(problem, _metal(fit), scene, seed, drawn), problem.solver)
        if _way(asked, fit.x) < SETTLED:
            return asked
        step = asked.x - fit.x
        share = share / 2 if float(step @ last) < 0 else share
        fit, last = replace(asked, x=fit.x + share * step), step
    return replace(fit, solution=replace(fit.solution, status="stopped"))


def _traced(
    problem: Problem, metal: Metal, scene: DifferentiableScene, seed: int, drawn: Metal | None = None
) -> tuple[Tangent, ...]:
    """What two sets of paths, `drawn` for another metal if that is given, add to the problem's pixels.

    Noise that residuals share with their slopes has a product with a mean, which makes F0 too dark;
    `uncertainty.unbiased` removes it by slopes and residuals of different sets.
    """

    def half(which: int) -> Tangent:
        progress = lambda share: problem.progress("tracing paths", (which + share) / 2)  # noqa: E731
        added = scene.radiance(
            problem.observed.surface,
            metal,
            samples=SAMPLES // 2,
            seed=2 * seed + which,
            beyond_direct=True,
            drawn=drawn,
            progress=progress,
        )
        return Tangent.of(added, metal)

    return half(0), half(1)


def _again(fit: Fit, added: tuple[Tangent, ...], solver: Solver) -> Fit:
    """The same pixels, table and weights with paths for the metal found."""
    model = fit.residuals.model
    assert isinstance(model, PolishedPixels)
    residuals = replace(fit.residuals, model=replace(model, added=added))
    solution = solved(residuals, [fit.x], solver)
    return Fit(residuals, solution, unbiased(residuals, solution.x), fit.solve_seconds + solution.seconds)


def _way(fit: Fit, before: Float[Tensor, " x"]) -> float:
    """How far the fit moved, in standard errors: the change of the residuals over their scatter."""
    now, then = fit.residuals(fit.x), fit.residuals(before)
    return float((now - then).norm() / now.square().mean().sqrt())


def _metal(fit: Fit) -> Metal:
    return _as_metal(fit.material)


def _as_metal(material: Material) -> Metal:
    assert isinstance(material, Metal)
    return material


def require_polishable(fidelity: Fidelity) -> None:
    """Refuse the viewer's model, whose blur no path follows, and a machine without LLVM, before anything is fitted.

    Raises:
        InputError: names the option and what it needs.
    """
    if fidelity.blurs:
        raise InputError("--polish", expected="preview, standard or reference for --fidelity: Mitsuba has no such blur")
    if fidelity.reflectance != "conductor":
        raise InputError("--polish", expected="--reflectance conductor, which is Mitsuba's")
    differentiable_scene.require_variant()


def polish_scene(
    loaded: Loaded, lighting: Lighting, materials: Mapping[int, Material], metal: int
) -> DifferentiableScene:
    """The object in Mitsuba, made of the fitted materials; `materials` by their index among the mesh's."""
    lobe = lighting.fidelity.lobe
    assert lobe == "ggx" or lobe == "beckmann"
    bsdfs = [_bsdf(materials[i], lobe) if i in materials else diffuse(GREY) for i in range(len(loaded.materials))]
    return DifferentiableScene(loaded.shape, lighting.environment, lighting.sources, bsdfs, metal)


def _bsdf(material: Material, lobe: Distribution) -> Bsdf:
    """A found material in Mitsuba's terms."""
    if material.color is not None:
        material = material.with_color(material.color.clamp(0, 1))
    alpha = 0.0 if material.width is None else float(alpha_of(material.width))
    return bsdf(material.type, lambda name: getattr(material, name).tolist(), alpha, lobe)
