"""Processes that fit scenes for a batch."""
