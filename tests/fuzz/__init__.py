"""Readers of files, fed with what nobody should have written."""
