"""The viewer's picture in OpenGL, without a window."""
