"""What computed a number: a name for the code itself, which a version does not change with."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

PACKAGES = ("fit_material.fitter", "fit_material.renderer", "fit_material.shaders")
DATA = (".py", ".csv")


@cache
def code_digest() -> str:
    """A name for all code and data that a fit depends on, as they were at the first call.

    The same in a source tree and where it was installed from a wheel.
    """
    digest = hashlib.sha256()
    for package in PACKAGES:
        spec = find_spec(package)
        assert spec is not None
        for folder in spec.submodule_search_locations or ():
            for path in sorted(Path(folder).rglob("*")):
                if path.suffix in DATA:
                    digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def versions() -> dict[str, str]:
    """Of this program and of the libraries that compute for it."""
    return {name: version(name) for name in ("fit-material", "torch", "jax", "optimistix", "drjit", "mitsuba")}
