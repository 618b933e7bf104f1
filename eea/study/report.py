"""The report of a study: its table, its summary in numbers and in Markdown, and its figures."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from math import degrees
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from aquafish_gym.runs.markdown import markdown_table, shown_format
from aquafish_gym.utils.storage import write_bytes, write_document
from eea.infer.words import COUNTS
from eea.study.arms import MINUS, angle_label, duration_name, signed, spoken
from eea.study.figures import save_study_figures
from eea.study.results import RESULTS_FILE, StudyResults, read_study
from eea.study.summary import summarize_study


def report(folder: str | os.PathLike[str], formats: Sequence[str] = ("png",)) -> list[Path]:
    """Write results.csv, summary.json, summary.md and the figures of a study; return the files.

    The files depend only on ``study.json`` and the finished replicates in ``runs/``, or on
    ``results.csv`` without that folder. The same results give the same bytes. ``formats`` of the
    figures are among "png", "pdf" and "svg".

    Raises
    ------
    InvalidArgumentError
        If a format is unknown.
    ConfigurationError
        If the folder holds no study or no finished replicate.
    DamagedFileError
        If a file is damaged; the message names it.
    """
    path = Path(folder)
    results = read_study(path)
    summary = summarize_study(results)
    figures = save_study_figures(results, summary, path / "figures", formats)
    shown = f".{shown_format(formats)}"
    names = [f"figures/{file.name}" for file in figures if file.suffix == shown]
    written = [path / name for name in (RESULTS_FILE, "summary.json", "summary.md")]
    write_bytes(written[0], results.to_csv().encode())
    write_document(written[1], summary)
    write_bytes(written[2], markdown(results, summary, names).encode())
    return [*written, *figures]


def markdown(results: StudyResults, summary: Mapping[str, Any], figures: Sequence[str]) -> str:
    """Return the whole text; ``figures`` are paths of pictures beside it."""
    rounds = summary["rounds"]
    guesses = summary["guesses"]
    count = len(results.layout)
    sizes = COUNTS[count] if count < len(COUNTS) else str(count)
    missing = ""
    if summary["finished"] < summary["planned"]:
        missing = (
            f"**The study is not complete: {summary['finished']} of {summary['planned']} "
            "replicates are finished.**"
        )
    blocks = [
        "# Study",
        f"{summary['target']} A replicate has {rounds} rounds. All settings are in `study.json`.",
        f"OBJ_FIT is one less the mean error of the {sizes} dimensions (Eq. 4), after {rounds} "
        f"rounds. On this target a random body scores {guesses['random bodies']:.3f} on average, "
        f"the body in the middle of all ranges {guesses['mid-range body']:.3f}, and the nearest "
        "body that the genome can express (the quantisation limit) "
        f"{guesses['quantisation limit']:.3f}. Intervals are 95% bootstrap intervals of means over "
        "replicates (BCa at Student's level; none for fewer than five).",
        missing,
        *_fitness(results, summary),
        *_paired(results, summary),
        *_dimensions(results, summary),
        *_angles(results, summary),
        "## Figures",
        *(f"![{PurePath(name).stem}]({name})" for name in figures),
    ]
    return "\n\n".join(block for block in blocks if block) + "\n"


def _fitness(results: StudyResults, summary: Mapping[str, Any]) -> list[str]:
    rows = []
    note = ""
    for row in summary["fitness"]:
        fit = row["objective_fitness"]
        model = row["model_fitness"]
        durations = row["durations"]
        name = duration_name(durations)
        sd = "" if fit["sd"] is None else f"{fit['sd']:.3f}"
        if len(durations) > 1:
            name = f"**{name}**"
            own = [
                r["objective_fitness"]["sd"] for r in summary["fitness"] if r["arm"] == row["arm"]
            ]
            sd += "" if None in own else f" ({np.mean(own[:-1]):.3f})"
            note = (
                "In the rows of means, each replicate counts once, with its mean over the "
                "durations; the mean of the durations' SDs is in brackets."
            )
        cells = [str(fit["replicates"]), f"{fit['mean']:.3f}", sd, _interval(fit["interval"])]
        shown = "" if model is None else f"{model['mean']:.3f}".replace("-", MINUS)
        rows.append([results.labels[row["arm"]], name, *cells, _signed_mean(row["rise"]), shown])
    since = f"rise since round {summary['rise_since_round']}"
    columns = ["condition", "duration", "replicates", "mean", "SD", "95% interval", since]
    return [
        "## OBJ_FIT by condition and duration",
        markdown_table([[*columns, "MOD_FIT"], *rows]),
        note,
    ]


def _paired(results: StudyResults, summary: Mapping[str, Any]) -> list[str]:
    labels = results.labels
    rows = [
        [
            f"{labels[row['first']]} less {labels[row['second']]}",
            duration_name(row["durations"]),
            _signed_mean(row["last_round"]),
            f"{row['last_round']['wins']} of {row['last_round']['replicates']}",
            f"{row['last_round']['sign_test_p']:.2g}",
            _signed_mean(row["mean_over_rounds"]),
        ]
        for row in summary["paired"]
    ]
    if not rows:
        return []
    columns = ["difference", "duration", "last round", "first is better in", "p"]
    text = (
        "Of OBJ_FIT within replicates: the target hides the same angles from every condition. "
        "*p* is the sign test's."
    )
    return ["## Paired differences", text, markdown_table([[*columns, "mean over rounds"], *rows])]


def _dimensions(results: StudyResults, summary: Mapping[str, Any]) -> list[str]:
    arms = {arm: found for arm, found in summary["dimension_error"].items() if found}
    rows = []
    for name in summary["guess_errors"]["random bodies"]:
        cells = [f"{errors[name]:.3f}" for errors in summary["guess_errors"].values()]
        for found in arms.values():
            mark = "**" if found[name]["better_than_guessing"] else ""
            cells.append(f"{mark}{found[name]['mean']:.3f}{mark}")
        rows.append([spoken(name), *cells])
    columns = ["dimension", *summary["guess_errors"], *(results.labels[arm] for arm in arms)]
    text = (
        "The best model's error after the last round, as a share of the dimension's range, mean "
        "over replicates and durations, beside the errors of guesses; the quantisation limit is "
        "the least that the genome's bits allow. An error is bold if its 95% interval lies below "
        "those of random bodies and of the mid-range body."
    )
    return ["## Error of each dimension", text, markdown_table([columns, *rows])]


def _angles(results: StudyResults, summary: Mapping[str, Any]) -> list[str]:
    rows = []
    for arm, fins in summary["angle_error"].items():
        if results.plan[arm].infers_angles and fins:
            row = [angle_label(results.plan[arm])]
            for error in fins.values():
                ends = error["interval"] and [degrees(end) for end in error["interval"]]
                row.append(f"{degrees(error['mean']):.1f} {_interval(ends, 1)}".rstrip())
            rows.append(row)
    if not rows:
        return []
    fins = results.body_plan.names
    text = (
        "The distance, in degrees, of the true angle of the last trial from the middle of the "
        "range inferred for it, mean over replicates and durations. A guess is 90 off."
    )
    return [
        "## The inferred angles",
        text,
        markdown_table([["condition", *map(spoken, fins)], *rows]),
    ]


def _signed_mean(summary: Mapping[str, Any]) -> str:
    text = signed(summary["mean"])
    if summary["interval"] is not None:
        text += " [" + ", ".join(signed(end) for end in summary["interval"]) + "]"
    return text


def _interval(ends: Sequence[float] | None, digits: int = 3) -> str:
    return "" if ends is None else "[" + ", ".join(f"{end:.{digits}f}" for end in ends) + "]"
