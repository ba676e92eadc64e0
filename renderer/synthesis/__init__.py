"""Photographs made by Mitsuba, with their scene file."""
