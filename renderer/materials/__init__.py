"""Materials outside of a fit: catalogue, ground truth, MTL files, textures."""
