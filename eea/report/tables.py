"""A study's summary for people: the numbers of ``summary.json`` as Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees
from pathlib import PurePath
from typing import Any

from eea.fish.gap import RealityGap
from eea.report.arms import angle_label

_STARTS = {
    "heading": ", and begins each trial with any heading",
    "attitude": ", and begins each trial in any attitude",
}
_SIGNALS = {"body_rates": "gyroscope", "attitude": "attitude"}
MINUS = "\u2212"


def markdown(summary: Mapping[str, Any], figures: Sequence[str]) -> str:
    """Return the whole text; ``figures`` are paths of pictures beside it."""
    rounds, labels = summary["rounds"], summary["labels"]
    lines = [
        "# Study",
        "",
        _run(summary["run"], rounds, labels),
        "",
        f"OBJ_FIT is one less the mean error of the nine dimensions (Eq. 4), after {rounds} "
        "rounds. A uniform random body scores "
        f"{summary['chance']:.3f} on average against this target, the body in the middle of all "
        f"ranges {summary['mid_range']:.3f}, and the body that a genome's bits allow nearest to "
        f"it, the quantisation limit, {summary['nearest']:.3f}. Intervals are 95% bootstrap "
        "intervals of means over replicates (BCa at Student's level; none for fewer than five).",
        "",
        *_missing(summary),
        "## OBJ_FIT by condition and duration",
        "",
        *_arms(summary),
        *_differences(summary["paired"], labels),
    ]
    arms = list(summary["arms"])
    lines += _dimensions(summary["dimensions"], arms, labels)
    angles = {
        angle_label(labels[arm], summary["conditions"][arm]): summary["angle_error"][arm]
        for arm in arms
        if arm in summary["angle_error"] and summary["conditions"][arm] != "ideal"
    }
    if angles:
        lines += _angles(angles)
    lines += ["## Figures", ""]
    for name in figures:
        lines += [f"![{PurePath(name).stem}]({name})", ""]
    return "\n".join(lines).rstrip() + "\n"


def _run(run: Mapping[str, Any], rounds: int, labels: Mapping[str, str]) -> str:
    """Return a paragraph that says what was run."""
    changed = [f"{spoken(name)} {size:g}" for name, size in run["target_changes"].items()]
    body = "nominal"
    if changed:
        body += f" but for {_listed(changed)} (in units of 5 cm),"
    damage = run["target_damage"]
    harm = "undamaged" if damage == "none" else f"damaged (`{damage}`)"
    start = _STARTS.get(run["target_orientation"], "")
    if run.get("gap"):
        start += f"; its world differs from its models' in this: {RealityGap(**run['gap'])}"
    steps = {arm: f"{_listed([str(n) for n in own])} steps" for arm, own in run["steps"].items()}
    signals = {
        arm: "an unknown signal" if signal is None else f"the {_SIGNALS.get(signal, signal)}"
        for arm, signal in run["signals"].items()
    }
    return (
        f"The target's body is {body} and {harm}{start}. Each replicate has {rounds} "
        f"round{'' if rounds == 1 else 's'}; trials are of {_of_arms(steps, labels)}, and "
        f"behaviours of {_of_arms(signals, labels)}. All settings are in `study.json`."
    )


def _of_arms(values: Mapping[str, str], labels: Mapping[str, str]) -> str:
    """Return the commonest value, and in brackets the arms that have another."""
    arms: dict[str, list[str]] = {}
    for arm, value in values.items():
        arms.setdefault(value, []).append(labels[arm])
    most, *others = sorted(arms, key=lambda value: -len(arms[value]))
    named = "; ".join(f"{_listed(arms[value])}: {value}" for value in others)
    return f"{most} ({named})" if named else most


def _missing(summary: Mapping[str, Any]) -> list[str]:
    if not summary["missing"]:
        return []
    missing = [
        f"{summary['labels'][arm]} at {steps} steps: {count}"
        for arm, durations in summary["missing"].items()
        for steps, count in durations.items()
    ]
    return [
        f"**The study is not complete: {summary['finished']} of {summary['planned']} replicates "
        f"are finished.** Missing: {'; '.join(missing)}.",
        "",
    ]


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
            sd = _plain(fit["sd"])
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
            "in brackets is the mean of the durations' SDs.",
            "",
        ]
    if len({tuple(found["durations"]) for found in summary["arms"].values()}) > 1:
        lines += [
            "Not every condition has the same durations yet, so that means over durations, here, "
            "below and in the figures, are not of the same trials; paired differences are.",
            "",
        ]
    return lines


def _differences(comparisons: Sequence[Mapping[str, Any]], labels: Mapping[str, str]) -> list[str]:
    rows = [
        [f"{labels[comparison['first']]} less {labels[comparison['second']]}", *cells]
        for comparison in comparisons
        for cells in _compared(comparison)
    ]
    columns = ["difference", "duration", "last round", "first is better in", "p"]
    text = (
        "Of OBJ_FIT within replicates: the target hides the same angles from every condition. "
        "*p* is the sign test's."
    )
    table = _table([*columns, "mean over rounds"], rows)
    return ["## Paired differences", "", text, "", *table] if rows else []


def _compared(comparison: Mapping[str, Any]) -> list[list[str]]:
    """Return a comparison's cells, a row a duration."""
    return [
        [
            duration_name(row["durations"]),
            _signed_mean(row["last_round"]),
            f"{row['last_round']['wins']} of {row['last_round']['replicates']}",
            f"{row['last_round']['sign_test_p']:.2g}",
            _signed_mean(row["mean_over_rounds"]),
        ]
        for row in comparison["rows"]
    ]


def _dimensions(
    found: Mapping[str, Any], shown: Sequence[str], labels: Mapping[str, str]
) -> list[str]:
    arms = {arm: found["arms"][arm] for arm in shown if arm in found["arms"]}
    rows, sds = [], []
    for name, chance in found["chance_error"].items():
        levels = [chance, found["mid_range_error"][name], found["nearest_error"][name]]
        cells, own = [f"{level:.3f}" for level in levels], []
        for numbers in arms.values():
            row = numbers["dimensions"][name]
            mark = "**" if row["better_than_guessing"] else ""
            cells.append(f"{mark}{row['error']['mean']:.3f}{mark} ({row['spread']['mean']:.3f})")
            own.append(_plain(row["mean_of_error_sds"]))
        rows.append([spoken(name), *cells])
        sds.append([spoken(name), *own])
    found_together = {arm: numbers["rank_correlation"] for arm, numbers in arms.items()}
    spread = [
        f"{labels[arm]} {'unknown' if value is None else signed(value, 2)}"
        for arm, value in found_together.items()
    ]
    names = [labels[arm] for arm in arms]
    return [
        "## What can be known of the body",
        "",
        "The best model's error in each dimension after the last round, as a share of the "
        "dimension's range, mean over replicates and durations; in brackets the spread (SD) of the "
        "final population. *Random* and *middle* are the errors of a random body and of the middle "
        "of the range, *quantisation limit* the least that a genome's bits allow. Bold where the "
        "whole 95% interval of the error is below those of both guesses.",
        "",
        *_table(["dimension", "random", "middle", "quantisation limit", *names], rows),
        "Whether a wide spread goes with a large error, over all dimensions and replicates (rank "
        f"correlation): {'; '.join(spread)}.",
        "",
        "The SD of the error from replicate to replicate, a share of the range, mean over "
        "durations:",
        "",
        *_table(["dimension", *names], sds),
    ]


def _angles(found: Mapping[str, Any]) -> list[str]:
    rows = []
    for name, fins in found.items():
        cells = []
        for error in fins.values():
            ends = error["interval"] and [degrees(end) for end in error["interval"]]
            cells.append(f"{degrees(error['mean']):.1f} {_interval(ends, 1)}".rstrip())
        rows.append([name, *cells])
    fins = [spoken(fin) for fin in next(iter(found.values()), {})]
    return [
        "## The inferred angles",
        "",
        "The distance, in degrees, of the true angle of the last round's trial from the middle of "
        "the range inferred for it, mean over replicates and durations. A guess is 90 off.",
        "",
        *_table(["condition", *fins], rows),
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
    """Return a number to some decimals with its sign, the minus a real one."""
    return f"{value:+.{digits}f}".replace("-", MINUS)


def _listed(words: Sequence[str]) -> str:
    """Return ``a, b and c``."""
    return " and ".join(filter(None, [", ".join(words[:-1]), words[-1]]))


def _plain(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}"


def _signed_mean(summary: Mapping[str, Any]) -> str:
    text = signed(summary["mean"])
    if summary["interval"] is not None:
        text += " [" + ", ".join(signed(end) for end in summary["interval"]) + "]"
    return text


def _interval(ends: Sequence[float] | None, digits: int = 3) -> str:
    return "" if ends is None else "[" + ", ".join(f"{end:.{digits}f}" for end in ends) + "]"
