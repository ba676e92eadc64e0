"""Options of a fit that do not go together, found before anything is read, or do not go with the object's shape."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fit_material.fitter.effects.plan import require_choosable
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.renderer.errors.input_error import InputError
from fit_material.shaders.materials.kinds import KINDS


def require_consistent(options: FitOptions) -> None:
    """Raises InputError where one option takes what another one gives: names both."""
    require_choosable(options.wanted, options.unwanted)
    if options.polish and "interreflection" in options.unwanted:
        raise InputError("--polish", value="--without interreflection", expected="one of the two, not both")
    reflectance = options.fidelity.reflectance
    if "exact-fresnel" in options.wanted and reflectance != "conductor":
        expected = "--reflectance conductor, which is exact"
        raise InputError("--with", value=f"exact-fresnel, --reflectance {reflectance}", expected=expected)
    if options.maps:
        if options.fidelity.blurs:
            expected = (
                "a fidelity of microfacets, such as --fidelity standard: the viewer's model is not linear in colour"
            )
            raise InputError("--maps", value=f"color, --lobe {options.fidelity.lobe}", expected=expected)
        if options.type != "auto" and not KINDS[options.type].has_body:
            bodies = ", ".join(kind.name for kind in KINDS.values() if kind.has_body)
            value, expected = f"color, --type {options.type}", f"--type {bodies} or auto beside it"
            raise InputError("--maps", value=value, expected=expected)
        if "color-map" in options.unwanted:
            raise InputError("--maps", value="color, --without color-map", expected="one of the two, not both")
    if options.tolerance is not None:
        from fit_material.fitter.uncertainty.tolerance import require_tolerance

        require_tolerance(options.tolerance, options.fidelity)


def require_mappable(shape: object, source: Path | None, maps: Sequence[str]) -> None:
    """Raises InputError where there is nothing to lay a texture over."""
    if not maps:
        return
    from fit_material.renderer.geometry.mesh import Mesh

    if not isinstance(shape, Mesh):
        raise InputError("--maps", value="color", expected="a mesh with texture coordinates, not a sphere")
    if shape.uv is None:
        raise InputError(source or "mesh", expected="texture coordinates (vt) for --maps color, on every part")
