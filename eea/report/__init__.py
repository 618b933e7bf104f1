"""What runs and studies say: tables, a summary and pictures, a function of what is finished.

Statistics, tables and pictures are loaded when they are first used: scipy, pandas and matplotlib
take a second or two. Nothing that depends on the clock enters, so that the same runs give the same
bytes.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path


def report(folder: str | os.PathLike[str], formats: Sequence[str] = ("png",)) -> list[Path]:
    """Write results.csv, summary.json, summary.md and the figures of a study; return the files.

    They depend on nothing but what ``study.json`` says is run and what is finished: in ``runs/``,
    or where there is no such folder in ``results.csv``, which comes out as it was. The formats
    of the pictures are some of "png", "pdf" and "svg".

    Raises
    ------
    UnknownNameError
        If there is no such format.
    ConfigurationError
        If the folder holds no study or no finished replicate.
    DamagedFileError
        If a file is damaged; the message names it.
    """
    from aquafish_gym.runs.storage import write_bytes, write_json
    from eea.report.figures import save_study_figures
    from eea.report.findings import CSV, read_study
    from eea.report.summary import summarize_study
    from eea.report.tables import markdown

    path = Path(folder)
    findings = read_study(path)
    summary = summarize_study(findings)
    figures = save_study_figures(findings, summary, path / "figures", formats)
    # Readers' programs show one of the formats, and not all of them show PDF.
    best = next(form for form in ("png", "svg", "pdf") if form in formats)
    names = [f"figures/{file.name}" for file in figures if file.suffix == f".{best}"]
    written = [path / name for name in (CSV, "summary.json", "summary.md")]
    write_bytes(written[0], findings.to_csv().encode())
    write_json(written[1], summary)
    write_bytes(written[2], markdown(summary, names).encode())
    return [*written, *figures]
