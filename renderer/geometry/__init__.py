"""Meshes: their files, tangents and bounds."""
