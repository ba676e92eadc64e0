"""The shading model in GLSL: each file is the twin of the torch file of the same name."""
