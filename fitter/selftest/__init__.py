"""Inputs at which shading models, integrations and fits break down, and what must hold there."""
