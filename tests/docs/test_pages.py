"""Pages show what their sources hold, and nothing that GitHub would show as raw text."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from markdown_it import MarkdownIt
from markdown_it.token import Token

from aquafish_gym.utils.validation import InvalidArgumentError
from experiments.pages import DOCS, ROOT, fill_page, pages, text_of

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


@pytest.mark.parametrize("page", reached(), ids=name_of)
def test_links_of_the_page_lead_to_headings(page: Path) -> None:
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
