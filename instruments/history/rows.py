"""The history's file: a line of JSON for each commit that measured something again."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from aquafish_gym.utils.storage import DamagedFileError, read_bytes, write_bytes
from aquafish_gym.utils.validation import InvalidArgumentError, parse_json
from instruments.history.figures import SOURCES, Figures, read_figure

COMMIT_DIGITS = 9
MAXIMUM_BYTES = 8 * 2**20  # of the file


@dataclass(frozen=True)
class Row:
    """What a commit measured.

    Attributes
    ----------
    commit, date, subject
        Its first 9 digits, its time in ISO 8601, and its message's first line.
    figures
        The figures whose values differ from those of the rows before. A figure that is the same
        to the last digit was not measured again.
    """

    commit: str
    date: str
    subject: str
    figures: Figures


def read_rows(file: Path) -> list[Row]:
    """Return the rows of a file, none if there is no file.

    Raises
    ------
    DamagedFileError
        If a line is no row.
    """
    if not file.exists():
        return []
    lines = read_bytes(file, "file", MAXIMUM_BYTES).decode("utf-8").splitlines()
    return [_read_row(line, f"file: {file}, line {i}") for i, line in enumerate(lines, 1)]


def _read_row(line: str, place: str) -> Row:
    document = parse_json(place, line)
    try:
        figures = {name: read_figure(numbers) for name, numbers in document["figures"].items()}
        return Row(document["commit"], document["date"], document["subject"], figures)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise DamagedFileError(f"{place} must be a row of the history; {error!r}") from None


def write_rows(file: Path, rows: Sequence[Row]) -> None:
    """Write a file of these rows, whole or not at all."""
    lines = []
    for row in rows:
        figures = {name: figure.document() for name, figure in row.figures.items()}
        document = {"commit": row.commit, "date": row.date, "subject": row.subject}
        lines.append(json.dumps(document | {"figures": figures}, ensure_ascii=False) + "\n")
    write_bytes(file, "".join(lines).encode())


def new_rows(repository: Path, rows: Sequence[Row]) -> list[Row]:
    """Return a row for each commit after the last of ``rows`` that measured something again.

    Of merged branches, the merge alone is a commit of the history.

    Raises
    ------
    InvalidArgumentError
        If ``repository`` is no Git repository, or the last row's commit is not in its history.
    """
    since = ""
    if rows:
        since = f"{rows[-1].commit}.."
        try:
            _git(repository, "merge-base", "--is-ancestor", rows[-1].commit, "HEAD")
        except subprocess.CalledProcessError:
            raise InvalidArgumentError(
                f"the history must end with a commit before the present one; got "
                f"{rows[-1].commit}, which is not in this clone's history; delete the last rows"
            ) from None
    known = {name: figure.document() for row in rows for name, figure in row.figures.items()}
    return list(_measured(repository, f"{since}HEAD", known))


def _measured(repository: Path, span: str, known: dict[str, list[float]]) -> Iterator[Row]:
    """Yield a row for each commit of a span that changed a value of ``known``."""
    form = "--format=%H%x09%cI%x09%s"
    try:
        log = _git(repository, "log", "--first-parent", "--reverse", form, span, "--", *SOURCES)
    except (OSError, subprocess.CalledProcessError) as error:
        raise InvalidArgumentError(
            f"repository must be a folder of a Git repository; {repository}: {error}"
        ) from None
    for line in log.splitlines():
        commit, date, subject = line.split("\t", 2)
        figures = {
            name: figure
            for name, figure in committed_figures(repository, commit).items()
            if name not in known or known[name][0] != figure.document()[0]
        }
        if figures:
            known |= {name: figure.document() for name, figure in figures.items()}
            yield Row(commit[:COMMIT_DIGITS], date, subject, figures)


def committed_figures(repository: Path, commit: str) -> Figures:
    """Return all figures of the files of a commit."""
    found: Figures = {}
    for path, read in SOURCES.items():
        try:
            text = _git(repository, "show", f"{commit}:{path}")
        except subprocess.CalledProcessError:
            continue  # the commit has no such file
        found |= read(text)
    return found


def _git(repository: Path, *words: str) -> str:
    done = subprocess.run(
        ["git", *words], cwd=repository, capture_output=True, check=True, encoding="utf-8"
    )
    return done.stdout
