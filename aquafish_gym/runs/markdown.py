"""What reports in Markdown share: tables, and the format of their pictures."""

from __future__ import annotations

from collections.abc import Collection, Sequence


def markdown_table(rows: Sequence[Sequence[str]]) -> str:
    """Return a table, whose first row is its head.

    Examples
    --------
    >>> print(markdown_table([["fin", "size"], ["caudal", "0.8"]]))
    | fin | size |
    |---|---|
    | caudal | 0.8 |
    """
    head, *body = (f"| {' | '.join(row)} |" for row in rows)
    return "\n".join([head, "|" + "---|" * len(rows[0]), *body])


def shown_format(formats: Collection[str]) -> str:
    """Return the one of some file formats that a report shows: PDF last, as few readers show it."""
    return next(form for form in ("png", "svg", "pdf") if form in formats)
