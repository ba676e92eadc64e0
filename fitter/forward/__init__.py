"""Radiance of the fitted pixels as a function of the material."""
