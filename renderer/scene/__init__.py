"""`scene.toml`: its schema, and what it may leave to the fit."""
