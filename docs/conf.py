"""Sphinx: ``make docs``. The reference is generated from the docstrings of the packages."""

import pathlib
import re
from importlib import import_module

from docutils import nodes
from numpy.typing import ArrayLike
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.transforms.post_transforms import SphinxPostTransform
from sphinx.util.nodes import make_refnode
from sphinx.util.typing import stringify_annotation

from aquafish.page import write_live_page

ROOT = pathlib.Path(__file__).parent.parent


def is_gone(page: pathlib.Path) -> bool:
    """Return whether the module of a page of the reference is gone."""
    module = ROOT.joinpath(*page.stem.split("."))
    return not module.is_dir() and not module.with_suffix(".py").exists()


# The reference has a generated page for each module, and packages list theirs: all are generated
# again if a module is gone.
PAGES = list((ROOT / "docs" / "reference").glob("*.rst"))
if any(is_gone(page) for page in PAGES if page.stem != "index"):
    for page in PAGES:
        if page.stem != "index":
            page.unlink()

project = "AquaFish"
html_title = "AquaFish"
author = "The AquaFish authors"
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
]
exclude_patterns = ["_build", "_templates"]
templates_path = ["_templates"]
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_theme = "furo"
myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 3
autodoc_member_order = "bysource"
# Modules that need the extra "rl" are described without it.
autodoc_mock_imports = ["sb3_contrib", "stable_baselines3", "torch"]
autodoc_typehints_format = "short"
autodoc_type_aliases = {"ArrayLike": "ArrayLike"}  # of attributes; else ten types
default_role = "code"
napoleon_attr_annotations = False  # an array's shape says more than its type
napoleon_use_ivar = True
# "nodes" under Returns is a name, not a reference, and several classes have some.
suppress_warnings = ["ref.python"]

BARS = re.compile(r"(?<![`\w])\|(?=[^|`\s][^|`]*\|)|(?<=[^|`\s])\|(?![`\w|])")

ARRAY = re.compile(
    r"~?(?:numpy\.)?ndarray\[~?tuple\[~?(?:typing\.)?Any, \.\.\.\], "
    r"~?(?:numpy\.)?dtype\[~?(?:numpy\.)?([\w.]+)\]\]"
)


# The titles of the studies' reports, which do not name the study.
STUDIES = {
    "results/figs-5-to-10/summary": "Figs. 5 to 10, every table",
}


def name_study(_app: Sphinx, page: str, source: list[str]) -> None:
    """Give a study's report its title, and a committed table no place among the pages."""
    if page in STUDIES:
        source[0] = source[0].replace("# Study", f"# {STUDIES[page]}", 1)
    elif page.startswith("results/"):
        source[0] = f"---\norphan: true\n---\n\n{source[0]}"


def as_restructured_text(
    _app: Sphinx, _what: str, _name: str, _object: object, _options: object, lines: list[str]
) -> None:
    """Adapt a docstring: |v| is a modulus, and a Markdown docstring has its own page."""
    if any(line.startswith("## ") for line in lines):
        lines[1:] = ["", "See :doc:`/environments/aquafish-v0`."]
    lines[:] = [BARS.sub(r"\\|", line) for line in lines]


def with_short_types(
    _app: Sphinx, _what: str, _name: str, _object: object, _options: object, *signature: str | None
) -> tuple[str | None, ...]:
    """Shorten the types of arrays to those of the sources."""
    written = [stringify_annotation(ArrayLike, "smart"), "TypeAliasForwardRef('ArrayLike')"]
    array_like = re.compile("|".join(map(re.escape, written)))
    return tuple(
        part and ARRAY.sub(r"NDArray[\1]", array_like.sub("ArrayLike", part)) for part in signature
    )


class LinkedNames(SphinxPostTransform):
    """Makes `eea.core.behavior.summarize` on a page a link to its place in the reference."""

    default_priority = 5

    def run(self, **_: object) -> None:
        """Link every literal that is a full name in the reference."""
        known = self.env.get_domain("py").objects
        for literal in list(self.document.findall(nodes.literal)):
            found = known.get(literal.astext())
            if found and not isinstance(literal.parent, (nodes.reference, addnodes.pending_xref)):
                here = self.env.current_document.docname
                link = (self.app.builder, here, found.docname, found.node_id, literal.deepcopy())
                literal.replace_self(make_refnode(*link))


def add_public_names(_app: Sphinx, env: BuildEnvironment) -> list[str]:
    """Let the names that users import, such as eea.Robot, lead to where they are documented."""
    objects = env.get_domain("py").objects
    for package in ("aquafish_gym", "aquafish.online", "eea", "gait"):
        module = import_module(package)
        for name in module.__all__:
            one = getattr(module, name)
            place = f"{getattr(one, '__module__', '')}.{getattr(one, '__qualname__', '')}"
            if place in objects:
                objects[f"{package}.{name}"] = objects[place]._replace(aliased=True)
    return []


def add_page(app: Sphinx, error: Exception | None) -> None:
    """Write the page in which the fish swims beside the documents."""
    if error is None and app.builder.format == "html":
        write_live_page(pathlib.Path(app.outdir) / "fish.html")


def setup(app: Sphinx) -> None:
    """Register the above with Sphinx."""
    app.connect("build-finished", add_page)
    app.connect("source-read", name_study)
    app.connect("env-updated", add_public_names)
    app.add_post_transform(LinkedNames)
    app.connect("autodoc-process-docstring", as_restructured_text)
    app.connect("autodoc-process-signature", with_short_types)
