"""Cameras moved until outlines and reflections agree."""
