"""The textbook's own formulas at fifty digits, which no cancellation reaches."""

from __future__ import annotations

from typing import Any

import mpmath as mp

DIGITS = 50


def conductor(cos_d: float, n: float, k: float) -> float:
    """F from Fresnel's amplitudes with the complex cosine of refraction [Born & Wolf 1999, §1.5.2]."""
    return float(_reflected(cos_d, n, k))


def absorptance(cos_d: float, n: float, k: float) -> float:
    """1 - F."""
    with mp.workdps(DIGITS):
        return float(1 - _reflected(cos_d, n, k))


def dielectric(cos_d: float, ior: float) -> float:
    """F of k = 0."""
    return conductor(cos_d, ior, 0.0)


def transmittance(cos_d: float, ior: float) -> float:
    """1 - F of k = 0."""
    return absorptance(cos_d, ior, 0.0)


def _reflected(cos_d: float, n: float, k: float) -> Any:
    with mp.workdps(DIGITS):
        eta2, c = mp.mpc(n, k) ** 2, mp.mpf(cos_d)
        if eta2 == 1:
            return mp.mpf(0)  # nothing reflects, not even at c = 0, where the amplitudes are 0/0
        refracted = mp.sqrt(eta2 - (1 - c**2))
        s, p = (c - refracted) / (c + refracted), (eta2 * c - refracted) / (eta2 * c + refracted)
        return (abs(s) ** 2 + abs(p) ** 2) / 2


def cosine(angle: float) -> Any:
    """cos θ with all its digits."""
    with mp.workdps(DIGITS):
        return mp.cos(mp.mpf(angle))


def ggx(cos_h: float, alpha: float) -> float:
    """D = α² / (π [cos²(α² + tan²)]²) [Walter 2007, eq. 33]."""
    with mp.workdps(DIGITS):
        c, a = mp.mpf(cos_h), mp.mpf(alpha)
        return float(a**2 / (mp.pi * (c**2 * a**2 + 1 - c**2) ** 2))


def beckmann(cos_h: float, alpha: float) -> float:
    """D = exp(-tan²/α²) / (π α² cos⁴) [Walter 2007, eq. 25]."""
    with mp.workdps(DIGITS):
        c, a = mp.mpf(cos_h), mp.mpf(alpha)
        return float(mp.exp(-(1 / c**2 - 1) / a**2) / (mp.pi * a**2 * c**4))


def ggx_masking(cos: float, alpha: float) -> float:
    """G1 = 2 / (1 + √(1 + α² tan²)) [Walter 2007, eq. 34]."""
    if cos <= 0:
        return 0.0
    with mp.workdps(DIGITS):
        c, a = mp.mpf(cos), mp.mpf(alpha)
        return float(2 / (1 + mp.sqrt(1 + a**2 * (1 / c**2 - 1))))


def gaussian(distance: float, sigma: float) -> float:
    """(2πσ²)^(-½) exp(-x²/2σ²) [thesis 3.1]."""
    with mp.workdps(DIGITS):
        x, s = mp.mpf(distance), mp.mpf(sigma)
        return float(mp.exp(-((x / s) ** 2) / 2) / (mp.sqrt(2 * mp.pi) * s))
