"""Environment maps as cubemaps."""
