"""Mitsuba's own inverse rendering of a metal, in three forms, as somebody who knows it well would write them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

import drjit as dr
import numpy as np
import torch
from jaxtyping import Bool, Float

from fit_material.fitter.observations.scene_data import Loaded
from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.geometry.mesh import Shape
from fit_material.renderer.materials.bsdf import conductor
from fit_material.renderer.mitsuba.conversion import envmap, mitsuba, mitsuba_shapes, sensor
from fit_material.renderer.path_tracing.differentiable_scene import DifferentiableScene
from fit_material.renderer.rays import gbuffer
from fit_material.shaders.materials.types import Metal
from fit_material.shaders.materials.widths import Microfacet

START = {"n": (1.0, 1.0, 1.0), "k": (3.0, 3.0, 3.0), "alpha": 0.4}  # of somebody who knows that it is a metal
Numbers = Float[np.ndarray, "*p 3"]
LEAST, WIDEST = 1e-3, 1.0
DAMPING = 1e-3
FOOTPRINT = 8
TUNED_RATE = 0.08


@dataclass(frozen=True)
class State:
    """Where a competitor is: seconds since it began, n and k per channel, alpha."""

    seconds: float
    n: Float[np.ndarray, " 3"]
    k: Float[np.ndarray, " 3"]
    alpha: float

    @property
    def f0(self) -> Float[np.ndarray, " 3"]:
        """Reflectance at normal incidence."""
        return ((self.n - 1) ** 2 + self.k**2) / ((self.n + 1) ** 2 + self.k**2)


class Pictures:
    """Mitsuba's pictures of a shape of one metal that may change, differentiable; its variant is llvm_ad_rgb.

    Attributes:
        mi: Mitsuba.
    """

    def __init__(self, shape: Shape, environment: Environment, cameras: Sequence[Camera], integrator: str) -> None:
        self.mi = mi = mitsuba("llvm_ad_rgb")
        self._sensors = [mi.load_dict(sensor(camera)) for camera in cameras]
        shapes = mitsuba_shapes(shape, [conductor(**START)])
        self._scene = mi.load_dict({"type": "scene", "light": envmap(environment), **shapes})
        self._integrator = mi.load_dict({"type": integrator, "hide_emitters": True})
        self._held = mi.traverse(self._scene)

    def render(self, n: Any, k: Any, alpha: Any, view: int, spp: int, seed: int) -> Any:
        """The picture [s, s, 3] of one view."""
        self._held.update({f"object.bsdf.{key}.value": v for key, v in (("eta", n), ("k", k), ("alpha", alpha))})
        camera, seed = self._sensors[view], len(self._sensors) * seed + view
        return self.mi.render(self._scene, self._held, camera, self._integrator, spp=spp, seed=seed)[..., :3]

    def derivatives(
        self, n: Sequence[float], k: Sequence[float], alpha: float, view: int, spp: int, seed: int
    ) -> list[Float[np.ndarray, "s s 3"]]:
        """A picture, and its derivatives by n and k of the same channel and by alpha, by forward mode.

        Channels do not mix: one pass has the derivatives by all three n, one those by all three k.
        """
        mi, made = self.mi, []
        for index in range(3):
            inputs = [mi.Color3f(*map(float, n)), mi.Color3f(*map(float, k)), mi.Float(float(alpha))]
            dr.enable_grad(inputs[index])
            dr.set_grad(inputs[index], 1.0)
            picture = self.render(*inputs, view, spp, seed)
            made.append(dr.forward_to(picture).numpy())
        return [dr.detach(picture).numpy(), *made]


class Target(Pictures):
    """The photographs of a metal at a smaller size, and the pictures that are to look like them.

    Attributes:
        seen: the photographs, box-filtered, [v, s, s, 3]; 0 outside `mask`.
        mask: pixels that the object covers wholly.
    """

    def __init__(self, loaded: Loaded, size: int, integrator: str) -> None:
        pairs = [_smaller(each.radiance.numpy(), each.mask.numpy(), size) for each in loaded.photographs]
        self.seen, self.mask = (np.stack(each) for each in zip(*pairs, strict=True))
        cameras = [replace(each.camera, width=size, height=size) for each in loaded.photographs]
        super().__init__(loaded.shape, loaded.environment, cameras, integrator)

    def reference(self, view: int) -> tuple[Any, Any]:
        """A view's photograph and its mask as Mitsuba's tensors."""
        return self.mi.TensorXf(self.seen[view]), self.mi.TensorXf(self.mask[view][..., None].astype(np.float32))


def _smaller(
    radiance: Float[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"], size: int
) -> tuple[Float[np.ndarray, "s s 3"], Bool[np.ndarray, "s s"]]:
    """Means over squares of pixels, and which of them the object covers wholly."""
    factor = len(radiance) // size
    squares = radiance.reshape(size, factor, size, factor, 3).mean((1, 3))
    whole = mask.reshape(size, factor, size, factor).all((1, 3))
    return (squares * whole[..., None]).astype(np.float32), whole


def tutorial(loaded: Loaded, limit: float) -> Iterator[State]:
    """Adam on raw eta, k and alpha, L2 loss, `prb`, full size, 16 samples, as Mitsuba's tutorials do."""
    target = Target(loaded, len(loaded.photographs[0].radiance), "prb")
    mi = target.mi
    optimiser = mi.ad.Adam(lr=0.02)
    optimiser["n"], optimiser["k"] = mi.Color3f(START["n"]), mi.Color3f(START["k"])
    optimiser["alpha"] = mi.Float(START["alpha"])

    def step(index: int) -> tuple[Any, Any, Any]:
        numbers = optimiser["n"], optimiser["k"], optimiser["alpha"]
        for view in range(len(target.seen)):
            seen, mask = target.reference(view)
            difference = (target.render(*numbers, view, 16, index + 1) - seen) * mask
            dr.backward(dr.mean(dr.square(difference)))
        optimiser.step()
        optimiser["n"], optimiser["k"] = (dr.maximum(optimiser[key], LEAST) for key in ("n", "k"))
        optimiser["alpha"] = dr.clip(optimiser["alpha"], LEAST, WIDEST)
        return optimiser["n"], optimiser["k"], optimiser["alpha"]

    return _timed(step, limit)


def tuned(loaded: Loaded, limit: float) -> Iterator[State]:
    """Adam on logarithms, relative L2 loss, `direct`, 64², its rate and samples scheduled with the truth known."""
    target = Target(loaded, 64, "direct")
    mi = target.mi
    optimiser = mi.ad.Adam(lr=TUNED_RATE)
    optimiser["n"], optimiser["k"] = (dr.log(mi.Color3f(START[key])) for key in ("n", "k"))
    optimiser["alpha"] = dr.log(mi.Float(START["alpha"]))

    def step(index: int) -> tuple[Any, Any, Any]:
        optimiser.set_learning_rate(max(TUNED_RATE * 0.985**index, 0.01))
        for view in range(len(target.seen)):
            seen, mask = target.reference(view)
            numbers = [dr.exp(optimiser[key]) for key in ("n", "k", "alpha")]
            picture = target.render(*numbers, view, _schedule(index), index + 1)
            dr.backward(dr.mean(dr.square((picture - seen) / (seen + 0.1 * dr.mean(seen)) * mask)))
        optimiser.step()
        optimiser["alpha"] = dr.minimum(optimiser["alpha"], math.log(WIDEST))
        return tuple(dr.exp(optimiser[key]) for key in ("n", "k", "alpha"))  # type: ignore[return-value]

    return _timed(step, limit)


def _schedule(index: int) -> int:
    """Samples of each step: few while the way is long."""
    return 16 if index < 40 else 64 if index < 80 else 256


def gauss_newton(loaded: Loaded, limit: float) -> Iterator[State]:
    """Damped Gauss–Newton on logarithms, 32², 1024 samples; derivatives by Mitsuba's own forward differentiation."""
    target = Target(loaded, 32, "direct")
    seen = np.concatenate([picture[mask] for picture, mask in zip(target.seen, target.mask, strict=True)])

    def derivatives(n: Numbers, k: Numbers, alpha: float, seed: int) -> list[Numbers]:
        views = [target.derivatives(n, k, alpha, view, 1024, seed) for view in range(len(target.seen))]
        masked = [[each[mask] for each in view] for view, mask in zip(views, target.mask, strict=True)]
        return [np.concatenate(each) for each in zip(*masked, strict=True)]

    return _newton(seen, derivatives, limit)


def gauss_newton_in_one_pass(loaded: Loaded, limit: float) -> Iterator[State]:
    """The same by `DifferentiableScene`, ours, which has all derivatives from one pass over Mitsuba's paths."""
    trace, seen, parts = gbuffer.tracer(loaded.shape), [], []
    for each in loaded.photographs:
        radiance, mask = _smaller(each.radiance.numpy(), each.mask.numpy(), 32)
        row, column = torch.from_numpy(mask).nonzero().T
        camera = replace(each.camera, width=32, height=32)
        parts.append(gbuffer.pixel_footprints(trace, camera, column, row, FOOTPRINT))
        seen.append(radiance[mask])
    surface = gbuffer.concatenate(parts)
    scene = DifferentiableScene(loaded.shape, loaded.environment, (), [conductor(**START)], max_depth=2)

    def derivatives(n: Numbers, k: Numbers, alpha: float, seed: int) -> list[Numbers]:
        index, extinct, width = (torch.as_tensor(each, dtype=torch.float64) for each in (n, k, alpha))
        metal = Metal(index, extinct, Microfacet(width))
        made = scene.radiance(surface, metal, samples=1024, seed=seed)
        return [each.numpy() for each in (made.value, made.by_n, made.by_k, made.by_alpha)]

    return _newton(np.concatenate(seen), derivatives, limit)


def _newton(seen: Numbers, derivatives: Callable[..., list[Numbers]], limit: float) -> Iterator[State]:
    """From the fourth step on each step starts from the mean of what was found since: noise averages out."""
    logs, found = np.log([*START["n"], *START["k"], START["alpha"]]), []
    weight = 1 / (seen + 0.1 * seen.mean(0))

    def step(index: int) -> tuple[Any, Any, Any]:
        nonlocal logs
        n, k, (alpha,) = np.split(np.exp(logs), [3, 6])
        value, by_n, by_k, by_alpha = derivatives(n, k, float(alpha), index)
        columns = np.zeros((*seen.shape, 7))
        for c in range(3):  # channels do not mix
            columns[:, c, c], columns[:, c, 3 + c] = by_n[:, c] * n[c], by_k[:, c] * k[c]
        columns[:, :, 6] = by_alpha * alpha
        jacobian = (columns * weight[..., None]).reshape(-1, 7)
        normal = jacobian.T @ jacobian
        residual = ((value - seen) * weight).ravel()
        way = np.linalg.solve(normal + DAMPING * np.diag(normal.diagonal()), -jacobian.T @ residual)
        found.append(np.clip(logs + np.clip(way, -1.5, 1.5), -7, [*[3] * 6, 0]))
        logs = found[-1] if index < 4 else np.mean(found[3:], 0)
        return tuple(np.split(np.exp(logs), [3, 6]))  # type: ignore[return-value]

    return _timed(step, limit)


def _timed(step: Callable[[int], tuple[Any, Any, Any]], limit: float) -> Iterator[State]:
    """States after each step, until the limit in seconds."""
    begun = time.perf_counter()
    for index in count():
        arrays = [np.array(each, dtype=float).ravel() for each in step(index)]
        yield State(time.perf_counter() - begun, arrays[0], arrays[1], float(arrays[2][0]))
        if time.perf_counter() - begun > limit:
            return
