"""Pages show what their sources hold, name what exists, and have nothing that GitHub shows raw."""

from __future__ import annotations

import importlib
import json
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from itertools import chain
from pathlib import Path

import pytest
from markdown_it import MarkdownIt
from markdown_it.token import Token
from packaging.requirements import Requirement

from aquafish_gym.utils.validation import InvalidArgumentError
from experiments.pages import DOCS, ROOT, fill_page, pages, text_of

GUIDES = ("README.md", "CONTRIBUTING.md", "RELEASING.md", "paper/paper.md")
#: All pages, with those that commands write whole.
DOCUMENTS = [ROOT / guide for guide in GUIDES]
DOCUMENTS += [page for page in sorted(DOCS.rglob("*.md")) if "_build" not in page.parts]
PARSER = MarkdownIt("commonmark").enable(["table", "strikethrough"])


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("page", pages(), ids=name_of)
def test_make_pages_would_change_nothing(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert fill_page(text) == text, "run make pages"


def test_parts_are_filled_and_the_rest_stays() -> None:
    page = "# Page\n\n<!-- make pages: tiers -->\nold\n<!-- end -->\n\nSaid.\n"
    filled = fill_page(page)
    assert filled.startswith("# Page\n\n<!-- make pages: tiers -->\n\n|  | mild |")
    assert filled.endswith("\n\n<!-- end -->\n\nSaid.\n")
    assert "old" not in filled
    assert fill_page(filled) == filled
    assert fill_page("Said.\n") == "Said.\n"


@pytest.mark.parametrize(
    ("page", "message"),
    [
        ("<!-- make pages: nothing -->\n<!-- end -->\n", "got 'nothing'"),
        ("<!-- make pages: results/none.md -->\n<!-- end -->\n", "got 'results/none.md'"),
        (
            "<!-- make pages: physics/report.json: none -->\n<!-- end -->\n",
            "got 'physics/report.json: none'",
        ),
        ("<!-- make pages: tiers -->\n", "must end with a line <!-- end -->; 0 of them do"),
        (
            "<!-- make pages: tiers -->\n<!-- make pages: tiers -->\n<!-- end -->\n",
            "must end with a line <!-- end -->; 1 of them do",
        ),
    ],
)
def test_parts_without_source_or_end_are_refused(page: str, message: str) -> None:
    with pytest.raises(InvalidArgumentError, match=re.escape(message)):
        fill_page(page)


def test_a_source_is_a_file_a_text_or_a_table_of_a_report() -> None:
    assert text_of("results/league/table.md").startswith("| ")
    assert text_of("AquaFishEnv").startswith("## Description")
    assert text_of("physics/report.json: strokes").startswith("| fin |")
    assert text_of("inference/report.json: calibration").startswith("| setting |")
    assert text_of("results/method: Paired differences").startswith("| difference |")


# ---------------------------------------------------------------------------- what GitHub shows


def inline_tokens(tokens: list[Token]) -> Iterator[list[Token]]:
    for token in tokens:
        if token.type == "inline":
            yield token.children or []


#: Lines outside of code that only MyST or reStructuredText understands.
RAW_LINES = {
    "a colon fence": re.compile(r"^:{3,}"),
    "a target": re.compile(r"^\([^()\s]+\)=$"),
    "a comment": re.compile(r"^% "),
    "a block break": re.compile(r"^\+\+\+"),
    "attributes": re.compile(r"^\{[.#%][^}]*\}$"),
    "a directive": re.compile(r"^\.\. [\w-]+::"),
    "a field": re.compile(r"^:[\w-]+:( |$)"),
}
#: Parts of a text outside of code.
RAW_TEXTS = {
    "a substitution": re.compile(r"\{\{.*?\}\}"),
    "attributes": re.compile(r"(?<=[\])])\{[.#%:\w][^}]*\}"),
}
#: What ends a text before code in backticks: a role of MyST or of reStructuredText.
ROLE = re.compile(r"(\{[\w:.+-]+\}|:[\w:.+-]+:)$")


def raw_parts(text: str) -> list[str]:
    """Return what of a page GitHub would show as raw text, or as nothing."""
    tokens = PARSER.parse(text)
    found = [
        f"a directive: {token.info}"
        for token in tokens
        if token.type == "fence" and token.info.strip().startswith("{")
    ]
    for children in inline_tokens(tokens):
        line = ""
        for at, token in enumerate(children):
            if token.type == "code_inline":
                if role := ROLE.search(line):
                    found.append(f"a role: {role[0]}`{token.content}`")
                line += "``"
            elif token.type in ("softbreak", "hardbreak"):
                line += "\n"
            elif token.type == "link_close" and children[at - 1].type == "link_open":
                found.append(f"a link without text: {children[at - 1].attrs['href']}")
            else:
                line += token.content
        for one in line.split("\n"):
            found += [f"{kind}: {one}" for kind, raw in RAW_LINES.items() if raw.search(one)]
        found += [
            f"{kind}: {part}" for kind, raw in RAW_TEXTS.items() for part in raw.findall(line)
        ]
    return found


@pytest.mark.parametrize(
    "raw",
    [
        "```{include} results/league/table.md\n```",
        "```{toctree}\n:hidden:\n\npage\n```",
        "~~~{note}\nSaid.\n~~~",
        "- A list:\n\n  ```{figure} a.png\n  ```",
        ":::{container} cards\nSaid.\n:::",
        "See {py:class}`eea.Robot`.",
        "See {doc}`the page <page>` and more.",
        "See :py:func:`eea.infer_log`.",
        "| a | b |\n|---|---|\n| {ref}`a` | 1 |",
        "{{ tiers }}",
        "There are {{ count }} of them.",
        "(label)=\n\n# Title",
        "% a comment",
        "+++",
        "{#label .wide}\nSaid.",
        "[Said]{.wide} so.",
        ".. note:: Said.",
        "See [](page.md).",
    ],
)
def test_what_github_does_not_show_is_found(raw: str) -> None:
    assert raw_parts(f"# Page\n\n{raw}\n")


@pytest.mark.parametrize(
    "shown",
    [
        "```python\nprint({'a': 1})\n```",
        "```bibtex\nauthor = {{The AquaFish authors}},\n```",
        "The text `{{ tiers }}`, `{py:class}` and `(label)=` in code.",
        "A sum $\\sum_{i}{x_i}$ of 100% (or: {a, b}).",
        "<!-- make pages: tiers -->\n\n| a | b |\n|---|---|\n| {x} | `y` |\n\n<!-- end -->",
        "[text](page.md#part), ![picture](page.png) and <https://farama.org>.",
        "> [!NOTE]\n> Said.",
    ],
)
def test_what_github_shows_is_left_alone(shown: str) -> None:
    assert raw_parts(f"# Page\n\n{shown}\n") == []


def links_of(page: Path) -> list[str]:
    """Return the local links of a page."""
    tokens = PARSER.parse(page.read_text(encoding="utf-8"))
    links = [
        str(token.attrs["href"])
        for children in inline_tokens(tokens)
        for token in children
        if token.type == "link_open"
    ]
    return [link for link in links if not re.match(r"[a-z]+:", link)]


@cache
def reached() -> list[Path]:
    """Return the pages that a reader of the README can open by links."""
    found = [ROOT / "README.md"]
    for page in found:
        for link in links_of(page):
            path = (page.parent / link.partition("#")[0]).resolve()
            if path.suffix == ".md" and path.is_file() and path not in found:
                found.append(path)
    return found


def anchors_of(page: Path) -> set[str]:
    """Return the names that GitHub gives a page's headings."""
    tokens = PARSER.parse(page.read_text(encoding="utf-8"))
    found: set[str] = set()
    for at, token in enumerate(tokens):
        if token.type == "heading_open":
            words = "".join(c.content for c in tokens[at + 1].children or [])
            name = re.sub(r"[^\w\- ]", "", words.strip().lower()).replace(" ", "-")
            count = 0
            unique = name
            while unique in found:
                count += 1
                unique = f"{name}-{count}"
            found.add(unique)
    return found


def test_the_readme_reaches_the_pages() -> None:
    names = [name_of(page) for page in reached()]
    assert len(names) > 30
    assert {"docs/swimming_on.md", "docs/howto/robot.md", "CONTRIBUTING.md"} <= set(names)


@pytest.mark.parametrize("page", reached(), ids=name_of)
def test_github_shows_the_page(page: Path) -> None:
    assert raw_parts(page.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize("page", DOCUMENTS, ids=name_of)
def test_links_of_the_page_lead_to_files_and_headings(page: Path) -> None:
    for link in links_of(page):
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), link
        if anchor and target.suffix == ".md":
            assert anchor in anchors_of(target), link


def test_every_page_is_reached() -> None:
    others = {"docs/index.md", "docs/glossary.md", "docs/changelog.md", "paper/paper.md"}
    assert {name_of(page) for page in pages()} - {name_of(page) for page in reached()} <= others
    assert DOCS / "swimming_on.md" in reached()


# ------------------------------------------------------------------ symbols, paths, versions

REFERENCE = (ROOT / "docs" / "reference" / "index.rst").read_text().split("All modules")[0]
SYMBOL = re.compile(
    r"`((?:aquafish|aquafish_gym|eea|gait|tests|experiments|instruments)(?:\.[A-Za-z_]\w*)+)`"
)
CODE_PATH = re.compile(
    r"`((?:aquafish|aquafish_gym|eea|gait|tests|examples|experiments|instruments|docs)/[\w./-]+)`"
)


def resolve(dotted: str) -> object:
    parts = dotted.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            found: object = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError as error:
            if not dotted.startswith(error.name or dotted):
                raise  # a module that is there, and imports one that is not
            continue
        for name in parts[cut:]:
            found = getattr(found, name)
        return found
    raise ModuleNotFoundError(dotted)


def exists(dotted: str) -> bool:
    """Return whether a symbol can be imported."""
    try:
        resolve(dotted)
    except (ModuleNotFoundError, AttributeError):
        return False
    return True


def test_every_symbol_exists() -> None:
    named = {
        (dotted, name_of(page)) for page in DOCUMENTS for dotted in SYMBOL.findall(page.read_text())
    }
    assert len(named) > 100
    assert [one for one in sorted(named) if not exists(one[0])] == []


def test_the_reference_lists_symbols_that_exist() -> None:
    names = re.findall(r"^   (\w+(?:\.\w+)+)$", REFERENCE, re.MULTILINE)
    assert len(names) > 20
    assert [name for name in names if not exists(name)] == []


def test_every_path_leads_somewhere() -> None:
    lost = [
        f"{page}: {path}"
        for page in DOCUMENTS
        for path in CODE_PATH.findall(page.read_text())
        if not (ROOT / path).exists()
    ]
    assert lost == []


def test_every_row_of_the_paper_map_names_a_symbol() -> None:
    text = (ROOT / "docs" / "paper_map.md").read_text()
    rows = [line for line in text.splitlines() if line.startswith("| ") and "---" not in line]
    rows = [r for r in rows if not r.startswith(("| in the paper", "| choice"))]
    assert len(rows) >= 40
    for row in rows:
        assert SYMBOL.search(row), f"names no symbol: {row[:60]}"


def test_a_missing_symbol_is_found() -> None:
    assert exists("eea.core.fitness")
    assert not exists("eea.core.fitness.no_such_function")
    assert not exists("eea.no_such_module.function")


def test_the_version_and_the_citation_are_the_same_everywhere() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    citation = (ROOT / "CITATION.cff").read_text()
    zenodo = json.loads((ROOT / ".zenodo.json").read_text())
    readme = (ROOT / "README.md").read_text().split("```bibtex\n")[1].split("```")[0]
    of_software, of_paper = readme.split("@misc")

    (version,) = re.findall(r"^version: (.+)$", citation, re.MULTILINE)
    assert f"version = {{{version}}}" in of_software
    assert f"\n## [{version}]" in (ROOT / "CHANGELOG.md").read_text()

    title, paper = re.findall(r'title: "(.+)"', citation)
    assert f"title   = {{{title}}}" in of_software
    assert title == zenodo["title"]
    assert f"title  = {{{paper}}}" in of_paper
    for name in re.findall(r'family-names: (\w+)\n\s+given-names: "(.+)"', citation):
        assert ", ".join(name) in of_paper
    (author,) = re.findall(r'^  - name: "(.+)"', citation, re.MULTILINE)
    assert f"{{{{{author}}}}}" in of_software
    assert [author] == [one["name"] for one in project["authors"]]
    assert [author] == [one["name"] for one in zenodo["creators"]]


def test_the_constraints_pin_what_the_project_needs() -> None:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pinned = dict(line.lower().split("==") for line in lines if not line.startswith("#"))
    table = tomllib.loads((ROOT / "pyproject.toml").read_text())
    project = table["project"]
    lists = [*project["optional-dependencies"].values(), *table["dependency-groups"].values()]
    for needed in map(Requirement, [*project["dependencies"], *chain.from_iterable(lists)]):
        if needed.name != project["name"]:
            assert needed.specifier.contains(pinned[needed.name.lower().replace("_", "-")]), needed


def test_the_extras_have_what_the_pages_need() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    held = {
        name: {Requirement(one).name for one in needed}
        for name, needed in project["optional-dependencies"].items()
    }
    assert {"sb3-contrib", "stable-baselines3", "torch"} <= held["rl"]  # as load_extra says
    assert {"imageio-ffmpeg", "moviepy"} <= held["film"]
    scores = (ROOT / "docs" / "environments" / "scores.md").read_text(encoding="utf-8")
    assert 'pip install -e ".[all,rl]"  # stable-baselines3, and sb3-contrib' in scores
    train = (ROOT / "docs" / "howto" / "train.md").read_text(encoding="utf-8")
    assert re.search(r"RecordVideo.*\n.*moviepy, of the extra `film`", train)


def test_the_paper_cites_what_its_bibliography_holds() -> None:
    paper = (ROOT / "paper" / "paper.md").read_text()
    held = re.findall(r"^@\w+\{(\w+),", (ROOT / "paper" / "paper.bib").read_text(), re.MULTILINE)
    assert set(re.findall(r"@(\w+)[;\]]", paper)) == set(held)
