"""From a coarse table to a fine one: search, roughness, choice of the type."""
