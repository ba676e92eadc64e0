"""Colour maps of a surface, and the light that it sends to itself."""
