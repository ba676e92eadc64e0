"""Everything a picture needs that is not the material: cameras, meshes, light, per-pixel geometry."""
