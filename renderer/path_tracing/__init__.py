"""Mitsuba's path tracer, with derivatives."""
