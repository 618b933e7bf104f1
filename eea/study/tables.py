"""A study's summary as Markdown: the numbers of ``summary.json`` in tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees
from pathlib import PurePath
from typing import Any

from eea.fish.gap import RealityGap
from eea.study.arms import angle_label

MINUS = "\u2212"


def markdown(summary: Mapping[str, Any], figures: Sequence[str]) -> str:
    """Return the whole text; ``figures`` are paths of pictures beside it."""
    rounds = summary["rounds"]
    lines = [
        "# Study",
        "",
        f"{_target(summary['run'])} A replicate has {rounds} rounds. All settings are in "
        "`study.json`.",
        "",
        f"OBJ_FIT is one less the mean error of the nine dimensions (Eq. 4), after {rounds} "
        f"rounds. On this target a random body scores {summary['chance']:.3f} on average, the "
        f"body in the middle of all ranges {summary['mid_range']:.3f}, and the nearest body that "
        f"the genome can express (the quantisation limit) {summary['nearest']:.3f}. Intervals are "
        "95% bootstrap intervals of means over replicates (BCa at Student's level; none for fewer "
        "than five).",
        "",
    ]
    if summary["finished"] < summary["planned"]:
        lines += [
            f"**The study is not complete: {summary['finished']} of {summary['planned']} "
            "replicates are finished.**",
            "",
        ]
    lines += ["## OBJ_FIT by condition and duration", "", *_arms(summary), *_paired(summary)]
    lines += [*_dimensions(summary), *_angles(summary), "## Figures", ""]
    for name in figures:
        lines += [f"![{PurePath(name).stem}]({name})", ""]
    return "\n".join(lines).rstrip() + "\n"


def _target(run: Mapping[str, Any]) -> str:
    """Return a sentence about the target."""
    changed = [f"{spoken(name)} {size:g}" for name, size in run["target_changes"].items()]
    text = "The target has the nominal body"
    if changed:
        text += f" with {', '.join(changed)} (in units of 5 cm)"
    damage = run["target_damage"]
    text += " without damage" if damage == "none" else f" and the damage `{damage}`"
    if run.get("gap"):
        text += f"; its world differs from its models' in {RealityGap(**run['gap'])}"
    return f"{text}."


def _arms(summary: Mapping[str, Any]) -> list[str]:
    rows, averaged = [], False
    for arm, found in summary["arms"].items():
        means = found["mean_of_durations"]
        sets = [(f"{steps} steps", numbers) for steps, numbers in found["durations"].items()]
        if len(sets) > 1 and means:
            sets.append((f"**mean of {len(sets)} durations**", means))
            averaged = True
        for name, numbers in sets:
            fit, model = numbers["objective_fitness"], numbers["model_fitness"]
            sd = "" if fit["sd"] is None else f"{fit['sd']:.3f}"
            if numbers is means and found["mean_of_sds"] is not None:
                sd += f" ({found['mean_of_sds']:.3f})"
            interval, fitness = _interval(fit["interval"]), f"{fit['mean']:.3f}"
            cells = [name, str(fit["replicates"]), fitness, sd, interval]
            shown = f"{model['mean']:.3f}".replace("-", MINUS)
            rows.append([summary["labels"][arm], *cells, _signed_mean(numbers["rise"]), shown])
    since = f"rise since round {summary['rise_since_round']}"
    columns = ["condition", "duration", "replicates", "mean", "SD", "95% interval", since]
    lines = _table([*columns, "MOD_FIT"], rows)
    if averaged:
        lines += [
            "In the rows of means, each replicate counts once, with its mean over the durations; "
            "the mean of the durations' SDs is in brackets.",
            "",
        ]
    return lines


def _paired(summary: Mapping[str, Any]) -> list[str]:
    labels = summary["labels"]
    rows = [
        [
            f"{labels[comparison['first']]} less {labels[comparison['second']]}",
            duration_name(row["durations"]),
            _signed_mean(row["last_round"]),
            f"{row['last_round']['wins']} of {row['last_round']['replicates']}",
            f"{row['last_round']['sign_test_p']:.2g}",
            _signed_mean(row["mean_over_rounds"]),
        ]
        for comparison in summary["paired"]
        for row in comparison["rows"]
    ]
    if not rows:
        return []
    columns = ["difference", "duration", "last round", "first is better in", "p"]
    text = (
        "Of OBJ_FIT within replicates: the target hides the same angles from every condition. "
        "*p* is the sign test's."
    )
    return ["## Paired differences", "", text, "", *_table([*columns, "mean over rounds"], rows)]


def _dimensions(summary: Mapping[str, Any]) -> list[str]:
    found, labels = summary["dimensions"], summary["labels"]
    rows = []
    for name, chance in found["chance_error"].items():
        levels = [chance, found["mid_range_error"][name], found["nearest_error"][name]]
        cells = [f"{level:.3f}" for level in levels]
        for numbers in found["arms"].values():
            row = numbers["dimensions"][name]
            mark = "**" if row["better_than_guessing"] else ""
            cells.append(f"{mark}{row['error']['mean']:.3f}{mark} ({row['spread']['mean']:.3f})")
        rows.append([spoken(name), *cells])
    correlations = [
        f"{labels[arm]} {'unknown' if value is None else signed(value, 2)}"
        for arm, value in ((arm, own["rank_correlation"]) for arm, own in found["arms"].items())
    ]
    names = [labels[arm] for arm in found["arms"]]
    return [
        "## Error of each dimension",
        "",
        "The best model's error after the last round, as a share of the dimension's range, mean "
        "over replicates and durations; the spread (SD) of the final population is in brackets. "
        "*Random* and *middle* are the errors of a random body and of the middle of the range, "
        "*quantisation limit* the least that the genome's bits allow. An error is bold if its 95% "
        "interval lies below both guesses.",
        "",
        *_table(["dimension", "random", "middle", "quantisation limit", *names], rows),
        "Rank correlation of spread and error, over all dimensions and replicates: "
        f"{'; '.join(correlations)}.",
        "",
    ]


def _angles(summary: Mapping[str, Any]) -> list[str]:
    rows = []
    for arm, fins in summary["angle_error"].items():
        condition = summary["conditions"][arm]
        if condition != "ideal":
            row = [angle_label(summary["labels"][arm], condition)]
            for error in fins.values():
                ends = error["interval"] and [degrees(end) for end in error["interval"]]
                row.append(f"{degrees(error['mean']):.1f} {_interval(ends, 1)}".rstrip())
            rows.append(row)
    if not rows:
        return []
    return [
        "## The inferred angles",
        "",
        "The distance, in degrees, of the true angle of the last trial from the middle of the "
        "range inferred for it, mean over replicates and durations. A guess is 90 off.",
        "",
        *_table(["condition", *map(spoken, next(iter(summary["angle_error"].values())))], rows),
    ]


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    return [*lines, *("| " + " | ".join(row) + " |" for row in rows), ""]


def duration_name(durations: Sequence[int]) -> str:
    """Return ``256 steps``, or ``mean of 4 durations``."""
    return f"{durations[0]} steps" if len(durations) == 1 else f"mean of {len(durations)} durations"


def spoken(name: str) -> str:
    """Return ``left pectoral width`` for ``left_pectoral.width``."""
    return name.replace("_", " ").replace(".", " ")


def signed(value: float, digits: int = 3) -> str:
    """Return a number to some decimals with its sign, with a real minus."""
    return f"{value:+.{digits}f}".replace("-", MINUS)


def _signed_mean(summary: Mapping[str, Any]) -> str:
    text = signed(summary["mean"])
    if summary["interval"] is not None:
        text += " [" + ", ".join(signed(end) for end in summary["interval"]) + "]"
    return text


def _interval(ends: Sequence[float] | None, digits: int = 3) -> str:
    return "" if ends is None else "[" + ", ".join(f"{end:.{digits}f}" for end in ends) + "]"
