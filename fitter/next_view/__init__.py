"""Which photograph to take next."""
