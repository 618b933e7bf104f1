"""A study's summary for people: the numbers of ``summary.json`` as Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees
from pathlib import PurePath
from typing import Any

BASELINE = "baseline"  # what ablations are held against; begins the names of such arms
# The figures' names; other arms follow, by name.
ARMS = {
    "ideal": "fig5",
    "none": "fig6",
    "in-band": "fig7",
    "in-band-200": "fig8",
    "out-of-band": "fig9",
    "out-of-band-100": "fig10",
}
LABELS = {
    "ideal": "Ideal",
    "none": "None",
    "in-band": "In-Band",
    "in-band-200": "In-Band, {models} models",
    "in-band-split": "In-Band, dynamic split",
    "in-band-extended": "In-Band, wider range",
    "out-of-band": "Out-of-Band",
    "out-of-band-100": "Out-of-Band, {models} models",
}
STARTS = {
    "heading": ", and begins each trial with any heading",
    "attitude": ", and begins each trial in any attitude",
}
SIGNALS = {"body_rates": "gyroscope", "attitude": "attitude"}
MINUS = "\u2212"


def is_baseline(arm: str) -> bool:
    """Return whether an arm is what ablations are held against."""
    return arm == BASELINE or arm.startswith(f"{BASELINE}-")


def condition_of(baseline: str, arm: str) -> str:
    """Return the condition that both names end with, empty if there is none."""
    condition = baseline.removeprefix(BASELINE)[1:]
    return condition if condition and arm.endswith(f"-{condition}") else ""


def arm_label(arm: str, models: int | None = None) -> str:
    """Return an arm's name as a reader knows it; ``models`` is how many it has, if known."""
    if arm != BASELINE and is_baseline(arm):
        return f"{arm_label(arm.removeprefix(f'{BASELINE}-'), models)} (baseline)"
    label = LABELS.get(arm, arm)
    if "{models}" in label and models is None:
        return arm
    return label.replace("{models}", str(models))


def setting_label(arm: str, baseline: str, labels: Mapping[str, str]) -> str:
    """Return an ablation's name without the condition that it shares with its baseline."""
    condition = condition_of(baseline, arm)
    short = condition and arm != baseline
    return arm.removesuffix(f"-{condition}") if short else labels[arm]


def known_arms(summary: Mapping[str, Any]) -> list[str]:
    """Return the arms that are shown in full: of an ablation, the baselines say enough."""
    ablated = {effect["first"] for effect in summary["effects"]}
    return [arm for arm in summary["arms"] if arm not in ablated]


def signed(value: float) -> str:
    """Return a number to three digits with its sign, the minus a real one."""
    return f"{value:+.3f}".replace("-", MINUS)


def markdown(summary: dict[str, Any], figures: Sequence[str]) -> str:
    """Return the whole text; ``figures`` are paths of pictures beside it."""
    rounds = summary["rounds"]
    lines = [
        "# Study",
        "",
        _run(summary["run"], rounds, summary["labels"]),
        "",
        f"OBJ_FIT is one less the mean error of the nine dimensions (Eq. 4), after {rounds} "
        "rounds. A uniform random body scores "
        f"{summary['chance']:.3f} on average against this target, the body in the middle of all "
        f"ranges {summary['mid_range']:.3f}, and the nearest body that a genome can spell "
        f"{summary['nearest']:.3f}. Intervals are 95% bootstrap intervals of means over "
        "replicates (BCa with Student's quantiles; none for fewer than five).",
        "",
        *_unfinished(summary),
        "## OBJ_FIT by condition and duration",
        "",
        *_arms(summary),
    ]
    if any(comparison["rows"] for comparison in summary["paired"]):
        lines += [
            "## Paired differences",
            "",
            "Of OBJ_FIT within replicates: the target hides the same angles from every condition. "
            "*p* is the sign test's.",
            "",
            *_differences(summary["paired"], summary["labels"]),
        ]
    if any(comparison["rows"] for comparison in summary["effects"]):
        lines += [
            "## Effects against the baseline",
            "",
            "Of OBJ_FIT within replicates. Of twenty settings without any effect, one interval is "
            "expected to exclude zero.",
            "",
            *_effects(summary["effects"], summary["labels"]),
        ]
    arms, labels = known_arms(summary), summary["labels"]
    dimensions = _dimensions(summary["dimensions"], arms, labels)
    lines += ["## What can be known of the body", "", *dimensions]
    angles = {
        angle_label(labels[arm], summary["conditions"][arm]): summary["angle_error"][arm]
        for arm in arms
        if arm in summary["angle_error"] and summary["conditions"][arm] != "ideal"
    }
    if angles:
        lines += ["## The inferred angles", "", *_angles(angles)]
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
    start = STARTS.get(run["target_orientation"], "")
    steps = {arm: f"{_listed([str(n) for n in own])} steps" for arm, own in run["steps"].items()}
    signals = {
        arm: "an unknown signal" if signal is None else f"the {SIGNALS.get(signal, signal)}"
        for arm, signal in run["signals"].items()
    }
    text = (
        f"The target's body is {body} and {harm}{start}. Each replicate has {rounds} "
        f"round{'' if rounds == 1 else 's'}; trials are of {_of_arms(steps, labels)}, and "
        f"behaviours of {_of_arms(signals, labels)}. All settings are in `study.json`"
    )
    stamps = [f"`{stamp}`" for stamp in run["source"]]
    if not stamps:
        return f"{text}."
    several = "s are" if len(stamps) > 1 else " is"
    return f"{text}; the code's stamp{several} {_listed(stamps)}."


def _of_arms(values: Mapping[str, str], labels: Mapping[str, str]) -> str:
    """Return the commonest value, and in brackets the arms that have another."""
    arms: dict[str, list[str]] = {}
    for arm, value in values.items():
        arms.setdefault(value, []).append(labels[arm])
    most, *others = sorted(arms, key=lambda value: -len(arms[value]))
    if not others:
        return most
    return f"{most} ({'; '.join(f'{_listed(arms[value])}: {value}' for value in others)})"


def _listed(words: Sequence[str]) -> str:
    """Return ``a, b and c``."""
    return " and ".join(filter(None, [", ".join(words[:-1]), words[-1]]))


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    return [*lines, *("| " + " | ".join(row) + " |" for row in rows), ""]


def _unfinished(summary: dict[str, Any]) -> list[str]:
    finished, planned = summary["finished"], summary["planned"]
    if finished == planned:
        return []
    begun = [
        f"{summary['labels'][arm]} at {steps} steps: {count}"
        for arm, durations in summary["unfinished"].items()
        for steps, count in durations.items()
    ]
    text = f"**The study is not complete: {finished} of {planned} replicates are finished.**"
    return [f"{text} Begun and left out: {'; '.join(begun) or 'none'}.", ""]


def _arms(summary: dict[str, Any]) -> list[str]:
    rows, averaged = [], False
    for arm, found in summary["arms"].items():
        sets = [(f"{steps} steps", numbers) for steps, numbers in found["durations"].items()]
        if len(sets) > 1 and found["mean_of_durations"]:
            name = f"**mean of {len(sets)} durations**"
            sets.append((name, found["mean_of_durations"]))
            averaged = True
        for name, numbers in sets:
            fit, model, rise = (
                numbers[key] for key in ("objective_fitness", "model_fitness", "rise")
            )
            sd = _plain(fit["sd"])
            if numbers is found["mean_of_durations"] and found["mean_of_sds"] is not None:
                sd += f" ({found['mean_of_sds']:.3f})"
            rows.append(
                [
                    summary["labels"][arm],
                    name,
                    str(fit["replicates"]),
                    f"{fit['mean']:.3f}",
                    sd,
                    _interval(fit["interval"], "{:.3f}"),
                    _signed_mean(rise),
                    f"{model['mean']:.3f}".replace("-", MINUS),
                ]
            )
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


def _differences(comparisons: Sequence[dict[str, Any]], labels: Mapping[str, str]) -> list[str]:
    rows = []
    for comparison in comparisons:
        names = f"{labels[comparison['first']]} less {labels[comparison['second']]}"
        for row in comparison["rows"]:
            last, over = row["last_round"], row["mean_over_rounds"]
            rows.append(
                [
                    names,
                    duration_name(row["durations"]),
                    _signed_mean(last),
                    f"{last['wins']} of {last['replicates']}",
                    f"{last['sign_test_p']:.2g}",
                    _signed_mean(over),
                ]
            )
    columns = ["difference", "duration", "last round", "first is better in", "p"]
    return _table([*columns, "mean over rounds"], rows)


def _effects(comparisons: Sequence[dict[str, Any]], labels: Mapping[str, str]) -> list[str]:
    columns = ["setting", "duration", "last round", "better in", "p", "mean over rounds"]
    columns.append("trials, times the baseline's")
    lines = []
    for baseline in dict.fromkeys(comparison["second"] for comparison in comparisons):
        rows = []
        for comparison in comparisons:
            if comparison["second"] != baseline:
                continue
            ratio = comparison["trials_ratio"]
            for row in comparison["rows"]:
                last, over = row["last_round"], row["mean_over_rounds"]
                rows.append(
                    [
                        setting_label(comparison["first"], baseline, labels),
                        duration_name(row["durations"]),
                        _signed_mean(last),
                        f"{last['wins']} of {last['replicates']}",
                        f"{last['sign_test_p']:.2g}",
                        _signed_mean(over),
                        "" if ratio is None else f"{ratio:.2f}",
                    ]
                )
        if rows:
            lines += [f"### From {labels[baseline]}", "", *_table(columns, rows)]
    return lines


def duration_name(durations: Sequence[int]) -> str:
    """Return ``256 steps``, or ``mean of 4 durations``."""
    return f"{durations[0]} steps" if len(durations) == 1 else f"mean of {len(durations)} durations"


def _dimensions(
    found: dict[str, Any], shown: Sequence[str], labels: Mapping[str, str]
) -> list[str]:
    arms = {arm: found["arms"][arm] for arm in shown if arm in found["arms"]}
    rows = []
    for name, chance in found["chance_error"].items():
        levels = [chance, found["mid_range_error"][name], found["nearest_error"][name]]
        cells = [spoken(name), *(f"{level:.3f}" for level in levels)]
        for numbers in arms.values():
            row = numbers["dimensions"][name]
            mark = "**" if row["better_than_guessing"] else ""
            cells.append(f"{mark}{row['error']['mean']:.3f}{mark} ({row['spread']['mean']:.3f})")
        rows.append(cells)
    spread = [
        f"{labels[arm]} {_correlation(numbers['rank_correlation'])}"
        for arm, numbers in arms.items()
    ]
    between = [
        [
            spoken(name),
            *(_plain(a["dimensions"][name]["between_replicates"]) for a in arms.values()),
        ]
        for name in found["chance_error"]
    ]
    columns = ["dimension", "random", "middle", "nearest genome"]
    return [
        "The best model's error in each dimension after the last round, as a share of the "
        "dimension's range, mean over replicates and durations; in brackets the spread (SD) of the "
        "final population. *Random* and *middle* are the errors of a random body and of the middle "
        "of the range, *nearest genome* the least that a genome allows. Bold where the whole 95% "
        "interval of the error is below those of both guesses.",
        "",
        *_table([*columns, *(labels[arm] for arm in arms)], rows),
        "Whether a wide spread goes with a large error, over all dimensions and replicates (rank "
        f"correlation): {'; '.join(spread)}.",
        "",
        "The SD of the size found from replicate to replicate, a share of the range, mean over "
        "durations:",
        "",
        *_table(["dimension", *(labels[arm] for arm in arms)], between),
    ]


def _plain(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}"


def _correlation(value: float | None) -> str:
    return "unknown" if value is None else f"{value:+.2f}".replace("-", MINUS)


def _angles(found: dict[str, Any]) -> list[str]:
    rows = []
    for name, fins in found.items():
        cells = [name]
        for error in fins.values():
            interval = error["interval"]
            text = f"{degrees(error['mean']):.1f}"
            if interval is not None:
                text += f" {_interval([degrees(end) for end in interval], '{:.1f}')}"
            cells.append(text)
        rows.append(cells)
    fins = [spoken(fin) for fin in next(iter(found.values()), {})]
    return [
        "The distance, in degrees, of the true angle of the last round's trial from the middle of "
        "the range inferred for it, mean over replicates and durations. A guess is 90 off.",
        "",
        *_table(["condition", *fins], rows),
    ]


def angle_label(label: str, condition: str) -> str:
    """Return an arm's name beside its angles, which the condition None does not infer."""
    return f"{label} (assumes zero)" if condition == "none" else label


def spoken(name: str) -> str:
    """Return ``left pectoral width`` for ``left_pectoral.width``."""
    return name.replace("_", " ").replace(".", " ")


def _signed_mean(summary: dict[str, Any]) -> str:
    text = signed(summary["mean"])
    if summary["interval"] is not None:
        text += " [" + ", ".join(signed(end) for end in summary["interval"]) + "]"
    return text


def _interval(interval: Sequence[float] | None, form: str) -> str:
    return "" if interval is None else "[" + ", ".join(form.format(end) for end in interval) + "]"
