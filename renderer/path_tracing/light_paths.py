"""Paths of light through a Mitsuba scene, and how what they carry depends on one of its metals.

The paths are drawn by Mitsuba and stay as they are when the metal changes: with detached sampling [Zeltner et al.
2021, section 4] the derivative of a path's contribution is the contribution times the sum, over its meetings with the
metal, of the logarithmic derivative of

    f = F(n, k) D(alpha) G(alpha) / (4 cos θi)

so that one pass over the paths gives the radiance and all derivatives. They may be drawn for another metal than they
meet: then each meeting counts by the ratio of the two f, and as a function of the metal the noise is smooth. Channels
never mix: a derivative by n holds, for each channel, that by its own n.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

# Dr.Jit's arrays have one type per variant, which is chosen at run time: here they are Any.
Spectrum = Any


@dataclass(frozen=True)
class Scores:
    """Logarithmic derivatives of a metal's f by n, k and alpha, or sums of them along paths."""

    by_n: Spectrum
    by_k: Spectrum
    by_alpha: Any

    @property
    def parts(self) -> tuple[Any, ...]:
        return self.by_n, self.by_k, self.by_alpha

    def __add__(self, other: Scores) -> Scores:
        return Scores(*(own + others for own, others in zip(self.parts, other.parts, strict=True)))


@dataclass(frozen=True)
class ChangingMetal:
    """A rough conductor whose numbers may change.

    Attributes:
        mi: Mitsuba, its variant one with derivatives.
        bsdf: as it stands in the scene.
        distribution: of the microfacets, a `MicrofacetType`.
        n, k: of the three channels.
        alpha: width of the microfacets.
        drawn: n, k and alpha for which the scene draws paths.
    """

    mi: Any
    bsdf: Any
    distribution: Any
    n: Spectrum
    k: Spectrum
    alpha: Any
    drawn: tuple[Spectrum, Spectrum, Any]

    def ratio(self, si: Any, outgoing: Any) -> Spectrum:
        """f of this metal over that of the one for which paths are drawn; 1 off this metal."""
        import drjit as dr

        known, half, cos_d = self._meeting(si, outgoing)
        n, k, alpha = self.drawn
        facets = [dr.exp(self._log_facets(si.wi, outgoing, half, each)) for each in (self.alpha, alpha)]
        mirrored = [dr.exp(self._log_reflectance(cos_d, *each)) for each in ((self.n, self.k), (n, k))]
        of_facets = dr.select(facets[1] > 0, facets[0] / facets[1], 0)
        return dr.select(known, mirrored[0] / mirrored[1] * of_facets, 1)

    def _meeting(self, si: Any, outgoing: Any) -> tuple[Any, Any, Any]:
        """Whether both directions are before this metal, the half vector between them, and its cosine with either."""
        import drjit as dr

        half = dr.normalize(si.wi + outgoing)
        cos_d = dr.dot(si.wi, half)
        own = si.bsdf() == self.mi.BSDFPtr(self.bsdf)
        return own & (si.wi.z > 0) & (outgoing.z > 0) & (cos_d > 0), half, cos_d

    def scores(self, si: Any, outgoing: Any) -> Scores:
        """Of the reflection from `si.wi` to `outgoing`, both in the local frame; 0 off this metal."""
        import drjit as dr

        known, half, cos_d = self._meeting(si, outgoing)
        found = (
            _derivative(lambda n: self._log_reflectance(cos_d, n, self.k), self.n),
            _derivative(lambda k: self._log_reflectance(cos_d, self.n, k), self.k),
            _derivative(lambda alpha: self._log_facets(si.wi, outgoing, half, alpha), self.alpha),
        )
        return Scores(*(dr.select(known & dr.isfinite(each), each, 0) for each in found))

    def _log_reflectance(self, cos_d: Any, n: Spectrum, k: Spectrum) -> Spectrum:
        import drjit as dr

        fresnel, index = self.mi.fresnel_conductor, self.mi.Complex2f
        return dr.log(self.mi.Color3f(*(fresnel(cos_d, index(n[c], k[c])) for c in range(3))))

    def _log_facets(self, incoming: Any, outgoing: Any, half: Any, alpha: Any) -> Any:
        import drjit as dr

        facets = self.mi.MicrofacetDistribution(self.distribution, alpha)
        return dr.log(facets.eval(half) * facets.G(incoming, outgoing, half))


def _derivative(function: Callable[[Any], Any], at: Any) -> Any:
    """Derivative of each value of an elementwise function, by forward mode."""
    import drjit as dr

    x = type(at)(at)
    dr.enable_grad(x)
    dr.set_grad(x, 1.0)
    return dr.forward_to(function(x))


@dataclass(frozen=True)
class _Walk:
    """Paths on their way.

    Attributes:
        ray: the next segment.
        active: which of them go on.
        throughput: share of the light that they will bring back.
        scores: of the throughput.
        last: the surface they come from, and the density of the direction they left it in.
    """

    ray: Any
    active: Any
    throughput: Spectrum
    scores: Scores
    last: tuple[Any, Any] | None = None


@dataclass(frozen=True)
class LightPaths:
    """Unidirectional path tracing with next-event estimation, joined by the power heuristic [Veach 1997, eq. 9.9].

    Attributes:
        mi: Mitsuba, its variant a vectorised one.
        scene: lit by its environment and by lights that no ray meets, none of which is seen itself.
        max_depth: segments of the longest path; 2 is light → object → camera.
        metal: by whose numbers to differentiate.
        beyond_direct: leave out what the first surface would mirror of the emitters if nothing hid them. What remains
            is what the object does to itself: it hides light, which counts as negative, and mirrors its own.
    """

    mi: Any
    scene: Any
    max_depth: int
    metal: ChangingMetal
    beyond_direct: bool = False

    def trace(self, ray: Any, sampler: Any) -> list[Spectrum]:
        """Radiance along each ray, and its derivatives by n, k and alpha: these take a tenth of the time."""
        import drjit as dr

        mi = self.mi
        walk = _Walk(ray, mi.Bool(True), mi.Color3f(1), Scores(mi.Color3f(0), mi.Color3f(0), mi.Float(0)))
        found = [mi.Color3f(0) for _ in range(4)]
        for depth in range(self.max_depth):
            si = self.scene.ray_intersect(walk.ray, mi.RayFlags.All, walk.active)
            if walk.last is not None:
                _add(found, self._from_surroundings(walk, si, depth), walk.scores)
            walk = replace(walk, active=walk.active & si.is_valid())
            if depth + 1 == self.max_depth or (depth and dr.none(walk.active)):
                break
            _add(found, *self._towards_emitter(walk, si, sampler, depth))
            walk = self._scattered(walk, si, sampler)
            sampler.schedule_state()
            dr.eval(found, walk.ray, walk.active, walk.throughput, walk.last, walk.scores.parts)
        return found

    def _from_surroundings(self, walk: _Walk, si: Any, depth: int) -> Spectrum:
        """What the surroundings send along the paths that leave the object, or do not send along those that do not."""
        import drjit as dr

        assert walk.last is not None
        surface, density = walk.last
        far = dr.zeros(self.mi.SurfaceInteraction3f)
        far.wi, far.t = -walk.ray.d, self.mi.Float(dr.inf)
        sample = self.mi.DirectionSample3f(self.scene, far, surface)
        other = self.scene.pdf_emitter_direction(surface, sample, walk.active)
        light = walk.throughput * sample.emitter.eval(far, walk.active) * _heuristic(density, other)
        return self._counted(light, walk.active, si.is_valid(), depth == 1)

    def _towards_emitter(self, walk: _Walk, si: Any, sampler: Any, depth: int) -> tuple[Spectrum, Scores]:
        """What a direction drawn from the emitters brings, and its scores."""
        import drjit as dr

        sample, light = self.scene.sample_emitter_direction(si, sampler.next_2d(walk.active), False, walk.active)
        outgoing, drawn = si.to_local(sample.d), walk.active & (sample.pdf > 0)
        reflected, density = si.bsdf().eval_pdf(self.mi.BSDFContext(), si, outgoing, drawn)
        light *= (
            walk.throughput
            * reflected
            * self.metal.ratio(si, outgoing)
            * dr.select(sample.delta, 1, _heuristic(sample.pdf, density))
        )
        hidden = self.scene.ray_test(si.spawn_ray_to(sample.p), drawn)
        return self._counted(light, drawn, hidden, depth == 0), walk.scores + self.metal.scores(si, outgoing)

    def _counted(self, light: Spectrum, active: Any, hidden: Any, direct: bool) -> Spectrum:
        """Light that arrives; where direct light is left out, less what the object hides of it."""
        import drjit as dr

        if direct and self.beyond_direct:
            return dr.select(active & hidden, -light, 0)
        return dr.select(active & ~hidden, light, 0)

    def _scattered(self, walk: _Walk, si: Any, sampler: Any) -> _Walk:
        """The paths' next segments, drawn from the materials."""
        import drjit as dr

        mi, context = self.mi, self.mi.BSDFContext()
        choice, point = sampler.next_1d(walk.active), sampler.next_2d(walk.active)
        drawn, weight = si.bsdf().sample(context, si, choice, point, walk.active)
        return _Walk(
            ray=si.spawn_ray(si.to_world(drawn.wo)),
            active=walk.active & (drawn.pdf > 0) & (dr.max(weight) > 0),
            throughput=walk.throughput * mi.Color3f(weight) * self.metal.ratio(si, drawn.wo),
            scores=walk.scores + self.metal.scores(si, drawn.wo),
            last=(si, drawn.pdf),
        )


def _heuristic(density: Any, other: Any) -> Any:
    """Weight of a direction that was drawn with the first of two densities."""
    import drjit as dr

    own, others = density * density, other * other
    return dr.select(own > 0, own / (own + others), 0)


def _add(found: list[Spectrum], brought: Spectrum, scores: Scores) -> None:
    """Add what paths bring to the radiance, and its changes to the derivatives."""
    for i, factor in enumerate((1, *scores.parts)):
        found[i] += brought * factor
