"""The shading model in GLSL: each file names its twin in torch."""
