"""Pinhole cameras, lenses, offsets of poses, and photographs without distortion."""
