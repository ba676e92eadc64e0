"""Cameras from the files of other programs: COLMAP, NeRF's transforms, Mitsuba scenes."""
