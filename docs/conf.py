"""Sphinx: ``make docs``."""

project = "AquaFish"
extensions = ["myst_parser", "sphinx.ext.mathjax"]
html_theme = "furo"
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
exclude_patterns = ["_build"]
suppress_warnings = ["myst.xref_missing"]
