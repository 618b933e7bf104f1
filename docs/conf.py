"""Sphinx: ``make docs``. The reference is written from the docstrings of the installed packages."""

import ast
import pathlib
import re

from sphinx.application import Sphinx

ROOT = pathlib.Path(__file__).parent.parent


def docstring(path: str, name: str) -> str:
    """Return a class's docstring without its first line, read from its source."""
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    found = (n for n in tree.body if isinstance(n, ast.ClassDef) and n.name == name)
    return (ast.get_docstring(next(found)) or "").partition("\n")[2]


project = "AquaFish"
html_title = "AquaFish"
author = "The AquaFish authors"
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
]
exclude_patterns = ["_build", "_templates"]
templates_path = ["_templates"]
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_theme = "furo"
myst_enable_extensions = ["colon_fence", "dollarmath", "substitution"]
myst_heading_anchors = 3
# Gymnasium's environments are described in Markdown, tables and all: those pages show it as it is.
myst_substitutions = {
    "aquafish_v0": docstring("aquafish_gym/envs/aquafish.py", "AquaFishEnv"),
}
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
default_role = "code"
napoleon_use_ivar = True
# "nodes" under Returns is a name, not a reference, and several classes have some.
suppress_warnings = ["ref.python"]

BARS = re.compile(r"(?<![`\w])\|(?=[^|`\s][^|`]*\|)|(?<=[^|`\s])\|(?![`\w|])")

ARRAY = re.compile(r"~?(?:numpy\.)?ndarray\[~?tuple\[~?(?:typing\.)?Any, \.\.\.\], ~?(?:numpy\.)?dtype\[~?(?:numpy\.)?([\w.]+)\]\]")


def as_restructured_text(
    _app: Sphinx, _what: str, _name: str, _object: object, _options: object, lines: list[str]
) -> None:
    """Make a docstring fit: |v| is a modulus here, and what is in Markdown has its own page."""
    if any(line.startswith("## ") for line in lines):
        lines[1:] = ["", "See :doc:`/environments/aquafish-v0`."]
    lines[:] = [BARS.sub(r"\\|", line) for line in lines]


def with_short_types(
    _app: Sphinx, _what: str, _name: str, _object: object, _options: object, *signature: str | None
) -> tuple[str | None, ...]:
    """Write an array's type as the sources do."""
    return tuple(part and ARRAY.sub(r"NDArray[\1]", part) for part in signature)


def setup(app: Sphinx) -> None:
    """Tell Sphinx of the above."""
    app.connect("autodoc-process-docstring", as_restructured_text)
    app.connect("autodoc-process-signature", with_short_types)
