"""Run code as in an installation with fewer packages than this one."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from importlib.metadata import PackageNotFoundError, distribution, packages_distributions
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
NAME = "aquafish-gym"

_HIDE = """
import sys
from importlib.machinery import PathFinder

class Fewer(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        hidden = name.partition(".")[0] in HIDDEN
        return None if hidden else super().find_spec(name, path, target)

    @staticmethod
    def find_distributions(*arguments):
        for found in PathFinder.find_distributions(*arguments):
            if found.metadata["Name"].lower().replace("_", "-") in THERE:
                yield found

HIDDEN = {hidden!r}
THERE = {there!r}
sys.meta_path[:] = [Fewer if finder is PathFinder else finder for finder in sys.meta_path]
"""


def project() -> dict[str, Any]:
    """Return the table ``project`` of pyproject.toml."""
    table: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    return table


def needed(*extras: str) -> set[str]:
    """Return the distributions that pip installs with the package and some of its extras."""
    table = project()
    found: set[str] = set()
    todo = [Requirement(f"{NAME}[{','.join(extras)}]" if extras else NAME)]
    seen: set[str] = set()
    while todo:
        one = todo.pop()
        name = one.name.lower().replace("_", "-")
        if str(one) in seen:
            continue
        seen.add(str(one))
        if name == NAME:
            extra = table["optional-dependencies"]
            lines = [*table["dependencies"], *(line for e in one.extras for line in extra[e])]
            todo += map(Requirement, lines)
            continue
        try:
            requires = distribution(one.name).requires or []
        except PackageNotFoundError:  # for another system or Python
            continue
        found.add(name)
        for line in map(Requirement, requires):
            if line.marker is None or any(
                line.marker.evaluate({"extra": e}) for e in (*one.extras, "")
            ):
                todo.append(line)
    return found


def run_bare(code: str, *extras: str, without: str = "") -> subprocess.CompletedProcess[str]:
    """Run Python code that can import only what the package and some of its extras install.

    ``without`` is a distribution that is not there in spite of them.
    """
    there = {*needed(*extras), NAME, "setuptools"} - {without}
    hidden = {
        top
        for top, names in packages_distributions().items()
        if not {name.lower().replace("_", "-") for name in names} & there
    }
    return subprocess.run(
        [sys.executable, "-c", _HIDE.format(hidden=hidden, there=there) + code],
        capture_output=True, text=True, check=False, timeout=300, cwd=ROOT,
    )  # fmt: skip
