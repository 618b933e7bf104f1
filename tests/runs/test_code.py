"""The hash of the code behind results: what changes it, and what does not."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from aquafish_gym.runs import code
from aquafish_gym.runs.code import WITHOUT_RESULTS, code_hash, code_of, imported
from aquafish_gym.runs.manifest import write_manifest
from aquafish_gym.utils.validation import InvalidArgumentError
from eea.study.replicate import replicate

ROOT = Path(__file__).parents[2]
JOBS = [
    "eea.study.replicate", "aquafish.recovery.treatment", "gait.search.evolve",
    "experiments.league.episodes", "experiments.reality_gap.job",
]  # fmt: skip
# A package of a user's, whose result comes from three modules and a file.
TINY = {
    "__init__.py": "from tiny.work import answer",
    "work.py": """
from tiny import law
from tiny.shop import price
from tiny.figures import draw

def answer(job):
    from tiny.late import late
    return late(law.G * price())
""",
    "law.py": "G = 9.81\n",
    "late.py": "def late(x):\n    return x\n",
    "shop/__init__.py": """
import lazy_loader
__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__, submod_attrs={"prices": ["price"], "unused": ["other"]}
)
""",
    "shop/__init__.pyi": "from .prices import price as price\nfrom .unused import other as other\n",
    "shop/prices.py": "def price():\n    return 3\n",
    "shop/unused.py": "def other():\n    return 4\n",
    "shop/prices.json": "[1, 2]\n",
    "shop/data/deep/table.json": "[3]\n",
    "figures.py": "def draw():\n    pass\n",
    "command.py": "from tiny.work import answer\n",
}


@pytest.fixture
def tiny(tmp_path, monkeypatch):
    """Return the folder of the tiny package, which can be imported."""
    for name, text in TINY.items():
        path = tmp_path / "tiny" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(code, "PACKAGES", (*code.PACKAGES, "tiny"))
    yield tmp_path / "tiny"
    for name in [name for name in sys.modules if name.partition(".")[0] == "tiny"]:
        del sys.modules[name]


@pytest.mark.usefixtures("tiny")
def test_the_hash_covers_what_the_result_imports_and_its_data():
    assert set(code_of("tiny.work")) == {
        "tiny", "tiny.work", "tiny.law", "tiny.late", "tiny.shop", "tiny.shop.prices",
        "tiny.shop/prices.json", "tiny.shop/data/deep/table.json",
    }  # fmt: skip
    assert code_of("tiny.work")["tiny.law"] == b"G = 9.81\n"


@pytest.mark.parametrize(
    ("file", "changes"),
    [
        ("work.py", True),
        ("law.py", True),
        ("late.py", True),  # imported within a function
        ("shop/prices.py", True),  # imported when it is first used
        ("shop/prices.json", True),
        ("shop/data/deep/table.json", True),
        ("shop/unused.py", False),
        ("figures.py", False),  # drawing
        ("command.py", False),
    ],
)
def test_a_folder_of_other_code_is_refused_and_of_other_drawings_continues(
    tiny, tmp_path, file, changes
):
    from tiny.work import answer

    folder = tmp_path / "out"
    folder.mkdir()
    code._hash.cache_clear()
    write_manifest(folder, "a study", {"steps": 3}, work=answer)
    before = (folder / "settings.json").read_bytes()
    write_manifest(folder, "a study", {"steps": 3}, work=answer)
    (tiny / file).write_text(TINY[file] + "\n")
    code._hash.cache_clear()
    if changes:
        with pytest.raises(
            InvalidArgumentError, match=r"that other code made \(hash .*choose anot"
        ):
            write_manifest(folder, "a study", {"steps": 3}, work=answer)
    else:
        write_manifest(folder, "a study", {"steps": 3}, work=answer)
    assert (folder / "settings.json").read_bytes() == before


def test_line_ends_do_not_matter(tiny):
    before = code._hash.__wrapped__("tiny.work")
    for path in tiny.rglob("*.*"):
        path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    assert code._hash.__wrapped__("tiny.work") == before


def imported_by_syntax(source: bytes) -> set[str]:
    """Return the absolute modules and names that a source imports, as its syntax tree has them."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found |= {f"{node.module} {alias.name}" for alias in node.names}
    return found


@pytest.mark.parametrize("package", code.PACKAGES)
def test_every_import_of_every_module_is_found(package):
    paths = sorted((ROOT / package).rglob("*.py"))
    assert paths
    for path in paths:
        source = path.read_bytes()
        found = {f"{place} {name}" if name else place for place, name in imported(source, "any")}
        assert imported_by_syntax(source) <= found, path


def test_jobs_depend_on_what_they_name_in_quotes_or_read():
    study = code_of("eea.study.replicate")
    assert "aquafish_gym.engines.bullet.world" in study  # named in WORLDS
    assert "eea.infer.session" in study  # imported within a function
    assert "eea.fish/discrepancy.json" in study
    assert "gait.search/neat.ini" in code_of("gait.search.evolve")
    league = code_of("experiments.league.episodes")
    assert {"aquafish.online.agent", "aquafish.online/library.json"} <= league.keys()
    assert "experiments.league/data/policies/student-0.json" in league


@pytest.mark.parametrize("job", JOBS)
def test_no_job_depends_on_drawing_or_commands_and_a_hash_is_quick(job):
    began = time.process_time()
    found = code_of(job)
    assert time.process_time() - began < 0.3
    for name in found:
        parts = name.partition("/")[0].split(".")
        assert WITHOUT_RESULTS.isdisjoint(parts), name
        assert parts[1:] != ["__main__"]


HASH = "from aquafish_gym.runs.code import code_hash; from eea.study.replicate import replicate; "
HASH += "print(code_hash(replicate))"


def test_a_copy_has_the_same_hash_whatever_was_imported_until_its_code_is_edited(tmp_path):
    for name in ("aquafish_gym", "eea", "gait", "aquafish"):
        ignored = shutil.ignore_patterns("__pycache__", "web")
        shutil.copytree(ROOT / name, tmp_path / name, ignore=ignored)

    def hashed() -> str:
        environment = {**os.environ, "PYTHONPATH": str(tmp_path), "PYTHONSAFEPATH": "1"}
        words = [sys.executable, "-c", HASH]
        return subprocess.run(
            words, cwd=ROOT, env=environment, capture_output=True, text=True, check=True
        ).stdout.strip()

    assert hashed() == code_hash(replicate)
    (tmp_path / "eea/study/figures.py").write_text("")
    assert hashed() == code_hash(replicate)
    config = tmp_path / "eea/core/config.py"
    config.write_text(config.read_text().replace("whole_field(3, 1", "whole_field(5, 1"))
    assert hashed() != code_hash(replicate)
