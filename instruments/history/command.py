"""The command: read what was committed, append it, and say what changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from aquafish_gym.rendering.pictures import save_figure
from aquafish_gym.utils.storage import write_bytes
from aquafish_gym.utils.validation import InvalidArgumentError
from instruments.history.changes import Change, find_changes
from instruments.history.plots import history_picture
from instruments.history.rows import Row, new_rows, read_rows, write_rows
from instruments.verification.tables import Table, fill_page


@dataclass(frozen=True)
class History:
    """Append the figures of new commits to the history, and name the commits that moved one.

    A row is a commit whose files of results hold a figure that the commits before do not: coverage
    of intervals, the league, returns, the case study, ratios of speed, seconds to a score. Nothing
    is measured. A commit that has a row, or measured nothing, adds none.
    """

    example: ClassVar[str] = "--page docs/history.md --picture docs/results/history/history.png"

    file: Annotated[Path, tyro.conf.arg(metavar="FILE")] = Path(
        "docs/results/history/figures.jsonl"
    )
    """The history, a line of JSON for each commit; if it is missing, made from all commits."""
    page: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """A Markdown page whose marked tables to fill, such as docs/history.md."""
    picture: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """A picture to draw: .png, .pdf or .svg."""
    repository: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path()
    """The clone whose commits are read."""

    def execute(self) -> None:
        """Append rows, print what changed and write what was asked for."""
        if self.page is not None and not self.page.is_file():
            raise InvalidArgumentError(f"page must be a file that exists; got {self.page}")
        rows = read_rows(self.file)
        new = new_rows(self.repository, rows)
        rows += new
        if not rows:
            raise InvalidArgumentError(
                f"repository must have commits with results; {self.repository} has none"
            )
        if new:
            write_rows(self.file, rows)
        print(f"{len(rows)} rows, {len(new)} of them new")
        changes = find_changes(rows)
        for change in changes:
            print(say_change(change, rows))
        if self.page is not None:
            filled = fill_page(self.page.read_text(encoding="utf-8"), make_tables(rows, changes))
            write_bytes(self.page, filled.encode())
        if self.picture is not None:
            save_figure(history_picture(rows), self.picture)


def say_change(change: Change, rows: Sequence[Row]) -> str:
    """Return a sentence that names the commit where a figure left its band."""
    row = rows[change.row]
    late = "" if change.noticed == change.row else f", noticed at {rows[change.noticed].commit}"
    return (
        f"{change.figure}: {change.before:.3g} before {row.commit}, {change.since:.3g} since"
        f"{late} ({row.subject})"
    )


def make_tables(rows: Sequence[Row], changes: Sequence[Change]) -> dict[str, Table]:
    """Return the page's tables: what changed, and how long the history is."""
    changed = [
        (change.figure, rows[change.row].commit, f"{change.before:.3g}", f"{change.since:.3g}",
         rows[change.row].subject)
        for change in changes
    ]  # fmt: skip
    names = {name for row in rows for name in row.figures}
    count = sum(len(row.figures) for row in rows)
    return {
        "changes": Table(
            "figures that left their band",
            ("figure", "left its band at", "before", "since", "commit"),
            changed,
        ),
        "rows": Table(
            "the history",
            ("commits", "figures", "values", "first", "last"),
            [(str(len(rows)), str(len(names)), str(count), rows[0].commit, rows[-1].commit)],
            words=0,
        ),
    }
