"""Read docs/howto/trainers.md: a section for each trainer, what to install and a block."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "howto" / "trainers.md"
#: Fences of blocks that tests/docs runs, and of those that need more than the extras test and rl.
FENCES = ("python", "py")


@dataclass(frozen=True)
class Trainer:
    """A section of the page: its heading, what pip installs, its block and the block's fence."""

    name: str
    requirements: str
    fence: str
    code: str


def read_trainers(page: str) -> dict[str, Trainer]:
    """Return the trainers of a page's text by their lower-case names."""
    found = {}
    for section in re.split(r"^## ", page, flags=re.MULTILINE)[1:]:
        name = section.partition("\n")[0]
        installs = re.findall(r"`pip install (.*?)`", section)
        blocks = re.findall(rf"^```({'|'.join(FENCES)})\n(.*?)^```$", section, re.M | re.S)
        if len(installs) != 1 or len(blocks) != 1:
            raise ValueError(
                f"{name} must have one `pip install ...` and one block of Python; "
                f"it has {len(installs)} and {len(blocks)}"
            )
        found[name.lower()] = Trainer(name, installs[0], *blocks[0])
    return found


def shown_line(page: str) -> str:
    """Return the line that the page shows, in whose form every block prints its score."""
    (line,) = re.findall(r"^```text\n(.*)\n```$", page.partition("\n## ")[0], re.MULTILINE)
    return str(line)


def form(line: str) -> str:
    """Return a line with # for each number."""
    return re.sub(r"[-+]?\d+(\.\d+)?", "#", line.strip())


def score(printed: str, shown: str) -> str | None:
    """Return the last printed line that has the form of the shown one, or None."""
    lines = printed.replace("\r", "\n").splitlines()
    return next((line for line in reversed(lines) if form(line) == form(shown)), None)
