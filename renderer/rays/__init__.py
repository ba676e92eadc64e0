"""What rays through the pixels meet: G-buffer, footprints, occlusion, relief."""
