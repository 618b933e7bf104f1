"""The case study's report: all numbers for programs, tables and sentences for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from aquafish.recovery.treatment import MODEL_CONDITIONS, TREATMENTS
from aquafish_gym.plans import AQUAFISH, check_plan
from aquafish_gym.rendering.scene import CM_PER_UNIT
from aquafish_gym.runs.markdown import markdown_table
from eea.study.statistics import (
    FEWEST_VALUES,
    paired_difference,
    ratio_interval,
    summary_statistics,
)

HELD_OUT = "held-out"  # instead of a damage, if each replicate has another one
# Recovered gaits against the old one and one for any damage, joint inference against the paper's
# method, with against without known fins, and each oracle against its self-model.
RECOVERY_TREATMENTS = ("swims-on", "joint-fins", "joint", "out-of-band")
TREATMENT_COMPARISONS = (
    *((ours, other) for ours in RECOVERY_TREATMENTS for other in ("undamaged", "randomised")),
    ("joint", "out-of-band"),
    ("joint-fins", "joint"),
    *((TREATMENTS[ours].oracle, ours) for ours in RECOVERY_TREATMENTS),
)
SHARES = ("share_of_oracle", "share_of_oracle_random_poses")
MEASURES = {"target_distance": "zero pose", "target_distance_random_poses": "random poses"}
LONG_FIELDS = ("rounds", "generations", "controller", "swims", "bodies")  # not in the report

Outcomes = Mapping[str, Sequence[Mapping[str, Any]]]  # treatment -> one outcome for each replicate
TextTable = list[list[str]]  # a table with its header


def build_report(
    config: dict[str, Any], code: list[dict[str, str]], outcomes: Outcomes
) -> dict[str, Any]:
    """Return every number of the study, ready for JSON.

    Parameters
    ----------
    config
        The study's settings: ``damage``, ``morphology``, ``eea``, ``gait``, ``transfer`` and more.
    code
        The versions of the code that made the numbers.
    outcomes
        The results of ``treat``, with the replicates of all treatments in the same order.
    """
    return {
        "config": config,
        "code": code,
        "seeds": [outcome["seed"] for outcome in outcomes["oracle"]],
        "unit_in_m": CM_PER_UNIT / 100,
        "treatments": {
            name: _summary(config, outcomes, name) for name in TREATMENTS if name in outcomes
        },
        "paired": [
            {"measure": measure, "first": first, "second": second}
            | paired_difference(
                *(
                    {o["seed"]: outcome_distances(o)[measure] for o in outcomes[t]}
                    for t in (first, second)
                )
            )
            for measure in MEASURES
            for first, second in TREATMENT_COMPARISONS
            if first in outcomes and second in outcomes
        ],
        "replicates": {
            name: [
                {key: value for key, value in outcome.items() if key not in LONG_FIELDS}
                | ({"finals": _finals(outcome)} if name == "direct" else {})
                for outcome in several
            ]
            for name, several in outcomes.items()
        },
    }


def outcome_distances(outcome: Mapping[str, Any]) -> dict[str, float]:
    """Return an outcome's four distances in units: by body, from zero and from random poses."""
    return {
        "native_distance": outcome["native_distance"],
        "target_distance": outcome["target_distance"],
        "native_distance_random_poses": float(np.mean(outcome["native_random_distances"])),
        "target_distance_random_poses": float(np.mean(outcome["target_random_distances"])),
    }


def shown_replicate(outcomes: Outcomes) -> int:
    """Return the index of the replicate that pictures show: the one with the median gain.

    The gain is the distance from the zero pose on the damaged robot, of the gait of ``joint-fins``
    less that of the old gait. Of an even number it is the lower of the two in the middle; equal
    gains are in the order of the seeds.
    """
    pairs = zip(outcomes["joint-fins"], outcomes["undamaged"], strict=True)
    gains = [ours["target_distance"] - old["target_distance"] for ours, old in pairs]
    return int(np.argsort(gains, kind="stable")[(len(gains) - 1) // 2])


def _summary(config: Mapping[str, Any], outcomes: Outcomes, name: str) -> dict[str, Any]:
    """Return a treatment's means over the replicates, with their spread.

    A share is the ratio of the mean distances: a mean of ratios would be ruled by one slow oracle.
    """
    ours, best = outcomes[name], outcomes[TREATMENTS[name].oracle]
    columns = {
        field: [outcome_distances(o)[field] for o in ours] for field in outcome_distances(ours[0])
    }
    fitness = [o["objective_fitness"] for o in ours]
    if None not in fitness:
        columns = {"objective_fitness": fitness} | columns
    spread: dict[str, Any] = {
        field: summary_statistics(values) | {"values": values} for field, values in columns.items()
    }
    row: dict[str, Any] = {"trials": _trials(config, name), "objective_fitness": None}
    row |= {field: found["mean"] for field, found in spread.items()}
    for suffix in ("", "_random_poses"):
        field, share = f"target_distance{suffix}", f"share_of_oracle{suffix}"
        reached = [outcome_distances(o)[field] for o in best]
        defined = np.mean(reached) > 0
        row[share] = row[field] / float(np.mean(reached)) if defined else None
        spread[share] = {"interval": ratio_interval(columns[field], reached) if defined else None}
    row |= {"diverged_swims": sum(o["diverged"] for o in ours), "spread": spread}
    return row | ({"robot_hours": _robot_hours(config, outcomes)} if name == "direct" else {})


def _trials(config: Mapping[str, Any], name: str) -> int:
    """Return the number of trials or swims on the damaged robot in a treatment."""
    if name == "direct":
        return _swims(config, config["gait_direct"]["generations"] + 1)
    if name not in MODEL_CONDITIONS:
        return 0
    joint = MODEL_CONDITIONS[name] == "joint"
    trials: int = config["joint_rounds"] if joint else config["eea"]["rounds"]
    return trials


def _swims(config: Mapping[str, Any], rows: int) -> int:
    """Return the number of swims in the first rows of the direct search, the first screening."""
    gait = config["gait_direct"]
    each: int = 1 + gait["poses"]
    swims: int = each * (gait["random_candidates"] + (rows - 1) * gait["population"])
    return swims


def _robot_hours(config: Mapping[str, Any], outcomes: Outcomes) -> list[float | None]:
    """Return the hours that each replicate's direct search swims until it equals joint inference.

    Both are compared in the mean over random poses; None if the search never gets there.
    """
    hours: list[float | None] = []
    for direct, joint in zip(outcomes["direct"], outcomes["joint"], strict=True):
        wanted = outcome_distances(joint)["target_distance_random_poses"]
        finals = _finals(direct)
        rows = next((i for i, final in enumerate(finals, 1) if final >= wanted), None)
        seconds = config["transfer"]["seconds"]
        hours.append(None if rows is None else _swims(config, rows) * seconds / 3600.0)
    return hours


def _finals(outcome: Mapping[str, Any]) -> list[float]:
    """Return the best score so far in each row of a search's history, as the report keeps it."""
    found: list[float] | None = outcome.get("finals")
    return [row["final"] for row in outcome["generations"]] if found is None else found


def to_markdown(report: dict[str, Any], pictures: Sequence[str] = (), short: bool = False) -> str:
    """Return the report as text, with these pictures; ``short`` is for a terminal."""
    config = report["config"]
    seeds = report["seeds"]
    swims = report["config"]["transfer"]
    plan = check_plan(config.get("plan", AQUAFISH))
    several = "s" if len(seeds) > 1 else ""
    parts = [
        "# Damage recovery",
        f"{_damage_line(report)} Each row has another gait, which swam for "
        f"{swims['seconds']:g} s on the damaged robot ({swims['target_engine']}). The robot is "
        f"{CM_PER_UNIT * plan.hull.length:g} cm long.{water_line(config)}",
        f"{len(seeds)} replicate{several}, seed{several} {', '.join(map(str, seeds))}"
        f"{'; means, with 95% bootstrap intervals' if len(seeds) >= FEWEST_VALUES else ''}. "
        f"Trials on the robot last {config['eea']['steps'] / 100:g} s, and its gyroscope has noise "
        f"of {config['gyro_noise']:g} rad/s.",
        markdown_table(_main_rows(report["treatments"], intervals=not short)),
        *headline(report),
    ]
    if short:
        return "\n\n".join(parts) + "\n"
    parts += [
        "*Own model* is the body that the gait was evolved for. *Random poses* is the mean over "
        f"{swims['poses']} swims from random fin angles, which the robot does not observe. An "
        "*oracle* is given the true body, and searches its gait by the same method with the same "
        "senses. The self-models start from random bodies.",
        "\n".join(
            f"- **{TREATMENTS[name].label}** (`{name}`): {_description(name)}"
            for name in report["treatments"]
        ),
    ]
    diverged = sum(row["diverged_swims"] for row in report["treatments"].values())
    if diverged:
        parts.append(f"Swims on the damaged robot that diverged and count as 0 cm: {diverged}.")
    if several:
        parts += ["## Within replicates", markdown_table(_paired_rows(report["paired"]))]
    if pictures:
        parts += ["## Figures", *(f"![{name.partition('.')[0]}]({name})" for name in pictures)]
    return "\n\n".join(parts) + "\n"


def _description(name: str) -> str:
    """Return what a treatment is, and which oracle it is compared with."""
    spec = TREATMENTS[name]
    if spec.oracle == name:
        return spec.description
    return f"{spec.description}. Its oracle: {TREATMENTS[spec.oracle].label}"


def _damage_line(report: dict[str, Any]) -> str:
    if report["config"]["damage"] == HELD_OUT:
        each = [o["damage"] for o in next(iter(report["replicates"].values()))]
        return f"Each replicate has another damage: {', '.join(f'`{d}`' for d in each)}."
    return f"Damage: `{report['config']['damage']}`."


def water_line(config: Mapping[str, Any]) -> str:
    """Return what a report adds where the water is not that of the paper."""
    if not config.get("reactive"):
        return ""
    return " It swims in water with added mass, and so do all its models."


def headline(report: dict[str, Any]) -> list[str]:
    """Return one sentence on the result of each way to recover."""
    rows = report["treatments"]
    sentence = _comparison if len(report["seeds"]) > 1 else _single_result
    found = [
        f"**{TREATMENTS[name].label}**: after {rows[name]['trials']} trials the gait "
        f"{sentence(report, name)}."
        for name in RECOVERY_TREATMENTS
        if name in rows
    ]
    if "direct" in rows:
        found.append(f"**{TREATMENTS['direct'].label}**: {_direct_result(report)}.")
    return found


def _single_result(report: Mapping[str, Any], name: str) -> str:
    """Return how far the gait of the only replicate swims, and how far others do."""
    field = "target_distance_random_poses"
    far = {
        other: f"{CM_PER_UNIT * row[field]:z.0f} cm" for other, row in report["treatments"].items()
    }
    oracle = TREATMENTS[name].oracle
    return (
        f"swims {far[name]} from random poses; {TREATMENTS['undamaged'].label} swims "
        f"{far['undamaged']}, {TREATMENTS['randomised'].label} {far['randomised']}, and that of "
        f"the oracle, {TREATMENTS[oracle].label}, {far[oracle]}"
    )


def _comparison(report: Mapping[str, Any], name: str) -> str:
    """Return in how many replicates a gait is the better one, and its share of the oracle's."""
    count = len(report["seeds"])
    wins = {(r["first"], r["second"], r["measure"]): r["wins"] for r in report["paired"]}
    old, any_damage = (
        " and ".join(f"{wins[name, other, measure]} of {count}" for measure in MEASURES)
        for other in ("undamaged", "randomised")
    )
    return (
        f"beats the old one in {old} replicates (from the zero pose and from random "
        f"poses), and the one for any damage in {any_damage}; "
        f"{_share_in_words(report['treatments'][name])}"
    )


def _direct_result(report: Mapping[str, Any]) -> str:
    """Return how long a search on the robot takes to equal joint inference's gait."""
    row = report["treatments"]["direct"]
    hours = [known for known in row["robot_hours"] if known is not None]
    total = row["trials"] * report["config"]["transfer"]["seconds"] / 3600
    count = len(report["seeds"])
    if count == 1:
        if not hours:
            return f"it does not reach the gait of joint inference in {total:.0f} hours"
        return f"it reaches the gait of joint inference after {hours[0]:.1f} hours of swimming"
    after = f", after a median of {np.median(hours):.1f} hours of swimming" if hours else ""
    return (
        f"it reaches the gait of joint inference in {len(hours)} of {count} replicates{after}, of "
        f"{total:.0f} hours"
    )


def _share_in_words(row: Mapping[str, Any]) -> str:
    """Return the shares of the oracle's distance, and whether they differ from 100%."""
    shares = [row[name] for name in SHARES]
    if None in shares:
        return "the gait for the true body makes no progress"
    text = f"it swims {shares[0]:.0%} and {shares[1]:.0%} as far as the gait for the true body"
    ends = [row["spread"][name]["interval"] for name in SHARES]
    if None in ends:
        return text
    apart = sum(not low <= 1.0 <= high for low, high in ends)
    return f"{text} ({('neither', 'one', 'both')[apart]} significantly different from 100%)"


def _main_rows(treatments: dict[str, Any], intervals: bool) -> TextTable:
    columns = (  # field, header, form, scale
        ("trials", "trials", "d", 1),
        ("objective_fitness", "OBJ_FIT", ".3f", 1),
        ("native_distance", "own model, cm", "z.0f", CM_PER_UNIT),
        ("target_distance", "target, cm", "z.0f", CM_PER_UNIT),
        ("share_of_oracle", "share of its oracle", ".0%", 1),
        ("target_distance_random_poses", "target, random poses, cm", "z.0f", CM_PER_UNIT),
        ("share_of_oracle_random_poses", "share of its oracle", ".0%", 1),
    )
    rows = [["gait", *(header for _, header, _, _ in columns)]]
    for name, row in treatments.items():
        spread = row["spread"] if intervals else {}
        ends = {field: found.get("interval") for field, found in spread.items()}
        cells = [
            _number(row[field], ends.get(field), form, scale) for field, _, form, scale in columns
        ]
        rows.append([TREATMENTS[name].label, *cells])
    return rows


def _paired_rows(rows: list[dict[str, Any]]) -> TextTable:
    return [["on the target", "is better than", "in", "sign test", "by, cm"]] + [
        [
            f"{TREATMENTS[row['first']].label}, {MEASURES[row['measure']]}",
            TREATMENTS[row["second"]].label,
            f"{row['wins']} of {row['replicates']}",
            f"p = {row['sign_test_p']:.2g}",
            _number(row["mean"], row["interval"], "z.0f", CM_PER_UNIT),
        ]
        for row in rows
    ]


def _number(
    value: float | None, interval: Sequence[float] | None, form: str, scale: int = 1
) -> str:
    if value is None:
        return "none"
    low, high = interval or (0.0, 0.0)
    text = f"{scale * value:{form}}"
    return f"{text} [{scale * low:{form}}, {scale * high:{form}}]" if low < high else text
