"""All types of material that can be fitted."""

from __future__ import annotations

from fit_material.fitter.materials.fittable import Fittable
from fit_material.fitter.materials.glossy import GLOSSY
from fit_material.fitter.materials.matte import MATTE
from fit_material.fitter.materials.metal import METAL
from fit_material.shaders.registry.registry import Registry

FITTABLE: Registry[Fittable] = Registry(METAL, GLOSSY, MATTE)
