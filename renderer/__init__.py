"""Everything a picture needs that is not the material: cameras, meshes, light, per-pixel geometry."""

from renderer.dr_jit import prepare_imports

prepare_imports()
