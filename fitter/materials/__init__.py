"""How each type of material is fitted: coordinates, bounds, starts."""
