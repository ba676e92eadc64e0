"""Photographs, and the pixels of them that are fitted."""
