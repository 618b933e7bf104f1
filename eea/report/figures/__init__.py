"""Pictures of a study: each of the paper's figures, and what the paper does not show.

They are a function of the study's numbers: the same ones give the same bytes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from aquafish_gym.rendering.pictures import FORMATS, save_figure
from aquafish_gym.utils.validation import one_of
from eea.report.arms import FIGURES
from eea.report.figures.outcomes import final_figure, forest_figure, spread_figure
from eea.report.figures.rounds import (
    angles_figure,
    conditions_figure,
    dimensions_figure,
    rounds_figure,
)
from eea.report.findings import Findings

_MOST_LINES = 8  # that can be told apart in one picture
_NAMES = {
    *("final", "paired", "conditions", "dimensions", "spread", "angles"),
    *FIGURES.values(),
}


def save_study_figures(
    findings: Findings,
    summary: Mapping[str, Any],
    directory: Path,
    formats: Sequence[str] = ("png",),
) -> list[Path]:
    """Draw every picture that a study has the numbers for; return the files.

    Pictures of an earlier report that this one does not draw are removed from the directory.

    Raises
    ------
    UnknownNameError
        If a format is none of ``FORMATS``.
    """
    for form in formats:
        one_of("format", form, FORMATS)
    directory.mkdir(exist_ok=True)
    paths = []
    for name, figure in study_figures(findings, summary).items():
        for form in formats:
            paths.append(directory / f"{name}.{form}")
            save_figure(figure, paths[-1])
    for old in directory.iterdir():
        ours = old.stem in _NAMES or old.stem.startswith("rounds-")
        if ours and old.suffix[1:] in FORMATS and old not in paths:
            old.unlink()
    return paths


def study_figures(findings: Findings, summary: Mapping[str, Any]) -> dict[str, Figure]:
    """Return every picture that a study has the numbers for, by name."""
    arms, labels = findings.arms, summary["labels"]
    figures: dict[str, Figure] = {}
    for arm in arms:
        figures[FIGURES.get(arm, f"rounds-{arm}")] = rounds_figure(findings, summary, arm)
    figures["final"] = final_figure(findings, summary, arms)
    if any(comparison["rows"] for comparison in summary["paired"]):
        figures["paired"] = forest_figure(summary["paired"], labels, findings.durations())
    if len(arms) <= _MOST_LINES and any(arm in summary["dimensions"]["arms"] for arm in arms):
        figures["conditions"] = conditions_figure(findings, summary)
        figures["dimensions"] = dimensions_figure(findings, summary)
        figures["spread"] = spread_figure(summary)
        if any(findings.conditions[arm] != "ideal" for arm in arms):
            figures["angles"] = angles_figure(findings)
    return figures
