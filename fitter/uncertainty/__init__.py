"""Intervals: by linear theory, by profile likelihood, at a bound; and the tolerance reached."""
