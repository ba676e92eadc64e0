"""Picture files and textures."""
