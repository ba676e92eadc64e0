"""Light of a scene, integrated once for a grid of roughnesses."""
