"""`fit-material`: one file per command."""
