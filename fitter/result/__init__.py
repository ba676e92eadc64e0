"""`result.json`: its schema, formatting, provenance."""
