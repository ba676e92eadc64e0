"""Directions by density: of microfacets, of the environment's bright texels, of their product."""
