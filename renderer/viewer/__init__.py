"""The viewer: OpenGL through moderngl, on screen and off screen."""
