"""The documents are kept true: every symbol they name exists, every local link leads somewhere."""

from __future__ import annotations

import importlib
import json
import pathlib
import re
import tomllib
from itertools import chain

from packaging.requirements import Requirement

ROOT = pathlib.Path(__file__).parent.parent
GUIDES = ("README.md", "CONTRIBUTING.md", "RELEASING.md", "paper/paper.md")
PAGES = sorted(
    page
    for page in [*(ROOT / guide for guide in GUIDES), *(ROOT / "docs").rglob("*.md")]
    if "_build" not in page.parts
)
REFERENCE = (ROOT / "docs" / "reference" / "index.rst").read_text().split("All modules")[0]
ROLE = re.compile(r"\{py:\w+\}`~?([\w.]+)`")
SYMBOL = re.compile(
    r"`((?:aquafish|aquafish_gym|eea|gait|tests|experiments|instruments)(?:\.[A-Za-z_]\w*)+)`"
)
LINK = re.compile(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)")
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
        (dotted, str(page.relative_to(ROOT)))
        for page in PAGES
        for dotted in [*SYMBOL.findall(page.read_text()), *ROLE.findall(page.read_text())]
    }
    assert len(named) > 100
    assert [one for one in sorted(named) if not exists(one[0])] == []


def test_the_reference_lists_symbols_that_exist() -> None:
    names = re.findall(r"^   (\w+(?:\.\w+)+)$", REFERENCE, re.MULTILINE)
    assert len(names) > 20
    assert [name for name in names if not exists(name)] == []


def test_every_local_link_and_path_leads_somewhere() -> None:
    lost = []
    for page in PAGES:
        text = page.read_text()
        places = [(link, page.parent / link) for link in LINK.findall(text)]
        places += [(path, ROOT / path) for path in CODE_PATH.findall(text)]
        lost += [f"{page}: {name}" for name, place in places if not place.exists()]
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
