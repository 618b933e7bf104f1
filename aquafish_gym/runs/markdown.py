"""Markdown of reports: tables, and the format of pictures."""

from __future__ import annotations

from collections.abc import Collection, Sequence


def markdown_table(rows: Sequence[Sequence[str]], words: int | None = None) -> str:
    """Return rows as a Markdown table; the first row is the head.

    The first ``words`` columns are set to the left, the others, which are numbers, to the right;
    all to the left by default.

    Examples
    --------
    >>> print(markdown_table([["fin", "size"], ["caudal", "0.8"]]))
    | fin | size |
    |---|---|
    | caudal | 0.8 |
    """
    head, *body = (f"| {' | '.join(row)} |" for row in rows)
    left = len(rows[0]) if words is None else words
    return "\n".join([head, "|" + "---|" * left + "---:|" * (len(rows[0]) - left), *body])


def shown_format(formats: Collection[str]) -> str:
    """Return the file format of a report's pictures; PDF last, because few readers show it."""
    return next(form for form in ("png", "svg", "pdf") if form in formats)
