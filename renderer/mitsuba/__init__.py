"""Scenes for Mitsuba, and its rays."""
