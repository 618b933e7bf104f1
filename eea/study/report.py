"""The report of a study: tables, a summary and figures from its finished replicates."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from aquafish_gym.runs.storage import write_bytes, write_document


def report(folder: str | os.PathLike[str], formats: Sequence[str] = ("png",)) -> list[Path]:
    """Write results.csv, summary.json, summary.md and the figures of a study; return the files.

    They are a function of ``study.json`` and the finished replicates in ``runs/``, or of
    ``results.csv`` where there is no such folder. The same results give the same bytes. The formats
    of the figures are among "png", "pdf" and "svg".

    Raises
    ------
    InvalidArgumentError
        If there is no such format.
    ConfigurationError
        If the folder holds no study or no finished replicate.
    DamagedFileError
        If a file is damaged; the message names it.
    """
    # pandas, scipy and matplotlib take a second or two to import.
    from eea.study.figures import save_study_figures
    from eea.study.results import CSV, read_study
    from eea.study.summary import summarize_study
    from eea.study.tables import markdown

    path = Path(folder)
    results = read_study(path)
    summary = summarize_study(results)
    figures = save_study_figures(results, summary, path / "figures", formats)
    # Not every reader of Markdown shows PDF.
    best = next(form for form in ("png", "svg", "pdf") if form in formats)
    names = [f"figures/{file.name}" for file in figures if file.suffix == f".{best}"]
    written = [path / name for name in (CSV, "summary.json", "summary.md")]
    write_bytes(written[0], results.to_csv().encode())
    write_document(written[1], summary)
    write_bytes(written[2], markdown(results, summary, names).encode())
    return [*written, *figures]
