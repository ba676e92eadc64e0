"""A fit from the scene file to its folder."""
