"""Files in general: read as data, checked by a schema, replaced together or not at all."""
