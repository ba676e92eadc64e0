"""Sphinx: `make docs` makes pages of the Markdown here; warnings are errors."""

project = "fit-material"
extensions = ["myst_parser"]
exclude_patterns = ["_build"]
html_theme = "alabaster"
html_theme_options = {"page_width": "1100px"}
myst_heading_anchors = 3
