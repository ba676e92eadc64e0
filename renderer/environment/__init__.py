"""Environment maps: files, lookups by direction, cubemaps."""
