"""An environment map from photographs of a mirror ball."""
