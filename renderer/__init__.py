"""Everything a picture needs that is not the material: cameras, meshes, light, per-pixel geometry."""

from fit_material.renderer.backends.dr_jit import prepare_imports

prepare_imports()
