"""Formulas of optics: Fresnel's equations, microfacets, the blur of the environment, rough plastic, quadrature."""
