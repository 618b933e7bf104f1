"""What the treatments come to: every number for programs, and tables and words for people."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
from rich.console import Console
from rich.markdown import Markdown
from rich.table import Table

from aquafish.recovery.treatment import MODELLED, TREATMENTS, WAYS
from aquafish_gym import Damage, Morphology
from eea.study.statistics import FEWEST, paired_difference, ratio_interval, summarize

UNIT_IN_M = 0.05
LIBRARIES = ("aquafish-gym", "gymnasium", "neat-python", "numba", "numpy", "pybullet", "scipy")
HELD_OUT = "held-out"  # in the place of a damage, where each replicate has another
# The questions of the case study: does the recovered gait beat the old one, and one for any damage,
# and the paper's, what is it worth to know one's fins, and what would the true body add?
RECOVERED = ("joint-fins", "joint", "out-of-band")
COMPARISONS = (
    *((ours, other) for ours in RECOVERED for other in ("undamaged", "randomised")),
    ("joint", "out-of-band"),
    ("joint-fins", "joint"),
    *((WAYS[ours].oracle, ours) for ours in RECOVERED),
)
SHARES = ("share_of_oracle", "share_of_oracle_random_poses")
MEASURES = {"target_distance": "zero pose", "target_distance_random_poses": "random poses"}
# Of an outcome, in the report.
UNREPEATED = ("rounds", "generations", "controller", "swims", "bodies")

Outcomes = Mapping[str, Sequence[Mapping[str, Any]]]  # treatment -> one outcome a replicate
Rows = list[list[str]]  # a table, its header first


def versions(libraries: Sequence[str] = LIBRARIES) -> dict[str, str]:
    """Return the versions of what makes the numbers."""
    found = {"python": platform.python_version()}
    for library in libraries:
        try:
            found[library] = version(library)
        except PackageNotFoundError:
            found[library] = "not installed"
    return found


def build_report(
    config: dict[str, Any], code: list[dict[str, str]], outcomes: Outcomes
) -> dict[str, Any]:
    """Return every number of the study, ready for JSON, of those treatments that were done.

    Parameters
    ----------
    config
        The study's settings: ``damage``, ``morphology``, ``eea``, ``gait``, ``transfer`` and more.
    code
        Versions and sources of what made the numbers, one state of the code or more.
    outcomes
        What ``treat`` returned, every replicate in the same order in each treatment.
    """
    return {
        "config": config,
        "code": code,
        "seeds": [outcome["seed"] for outcome in outcomes["oracle"]],
        "unit_in_m": UNIT_IN_M,
        "treatments": {
            treatment: {"trials": _trials(config, treatment)}
            | _row(outcomes, treatment)
            | ({"robot_hours": _hours(config, outcomes)} if treatment == "direct" else {})
            for treatment in TREATMENTS
            if treatment in outcomes
        },
        "paired": [
            {"measure": measure, "first": first, "second": second}
            | paired_difference(
                *({o["seed"]: distances(o)[measure] for o in outcomes[t]} for t in (first, second))
            )
            for measure in MEASURES
            for first, second in COMPARISONS
            if first in outcomes and second in outcomes
        ],
        "replicates": {
            treatment: [
                {name: found for name, found in outcome.items() if name not in UNREPEATED}
                | ({"finals": _finals(outcome)} if treatment == "direct" else {})
                for outcome in done
            ]
            for treatment, done in outcomes.items()
        },
    }


def _trials(config: Mapping[str, Any], treatment: str) -> int:
    """Return how many trials, or swims, on the damaged robot a treatment takes."""
    if treatment == "direct":
        return _swims(config, config["gait_direct"]["generations"] + 1)
    if treatment not in MODELLED:
        return 0
    joint = MODELLED[treatment] == "joint"
    trials: int = config["joint_rounds"] if joint else config["eea"]["rounds"]
    return trials


def _swims(config: Mapping[str, Any], rows: int) -> int:
    """Return how many swims so many rows of the direct search's history take, the first screens."""
    gait = config["gait_direct"]
    each: int = 1 + gait["poses"]
    swims: int = each * (gait["random_candidates"] + (rows - 1) * gait["population"])
    return swims


def _hours(config: Mapping[str, Any], outcomes: Outcomes) -> list[float | None]:
    """Return how long the robot swims in each replicate until its own search is as good.

    As good as the gait of joint inference there, in the mean over random poses; None if it never
    is.
    """
    hours: list[float | None] = []
    for direct, joint in zip(outcomes["direct"], outcomes["joint"], strict=True):
        wanted = distances(joint)["target_distance_random_poses"]
        finals = _finals(direct)
        rows = next((i for i, final in enumerate(finals, 1) if final >= wanted), None)
        seconds = config["transfer"]["seconds"]
        hours.append(None if rows is None else _swims(config, rows) * seconds / 3600.0)
    return hours


def _finals(outcome: Mapping[str, Any]) -> list[float]:
    """Return what a search had come to in each row of its history, which the report keeps of it."""
    found: list[float] | None = outcome.get("finals")
    return [row["final"] for row in outcome["generations"]] if found is None else found


def distances(outcome: Mapping[str, Any]) -> dict[str, float]:
    """Return one outcome's four distances in units: by body, from zero and from random poses."""
    return {
        "native_distance": outcome["native_distance"],
        "target_distance": outcome["target_distance"],
        "native_distance_random_poses": float(np.mean(outcome["native_random_distances"])),
        "target_distance_random_poses": float(np.mean(outcome["target_random_distances"])),
    }


def _row(outcomes: Outcomes, treatment: str) -> dict[str, Any]:
    """Return a treatment's numbers: means over the replicates, and the spread beside them.

    A share is the ratio of the mean distances, not the mean of ratios, which one slow oracle
    would rule.
    """
    ours, best = outcomes[treatment], outcomes[WAYS[treatment].oracle]
    columns = {name: [distances(o)[name] for o in ours] for name in distances(ours[0])}
    fitness = [o["objective_fitness"] for o in ours]
    if None not in fitness:
        columns = {"objective_fitness": fitness} | columns
    spread: dict[str, Any] = {
        name: summarize(values) | {"values": values} for name, values in columns.items()
    }
    row: dict[str, Any] = {"objective_fitness": None}
    row |= {name: found["mean"] for name, found in spread.items()}
    for suffix in ("", "_random_poses"):
        name, share = f"target_distance{suffix}", f"share_of_oracle{suffix}"
        reached = [distances(o)[name] for o in best]
        sound = np.mean(reached) > 0
        row[share] = row[name] / float(np.mean(reached)) if sound else None
        spread[share] = {"interval": ratio_interval(columns[name], reached) if sound else None}
    return row | {"diverged_swims": sum(o["diverged"] for o in ours), "spread": spread}


def to_markdown(report: dict[str, Any], pictures: Sequence[str]) -> str:
    """Return the report for people, with these pictures' files shown."""
    parts = [_pipes(part) if isinstance(part, list) else part for part in _parts(report)]
    if pictures:
        parts += ["## Figures", *(f"![{name.partition('.')[0]}]({name})" for name in pictures)]
    return "\n\n".join(parts) + "\n"


def show(report: dict[str, Any], console: Console) -> None:
    """Print the report. On a narrow terminal numbers are folded, and no name is cut."""
    for part in _parts(report):
        shown = _table(part, console.width) if isinstance(part, list) else Markdown(part)
        console.print(shown, "")


def _parts(report: dict[str, Any]) -> list[str | Rows]:
    config, seeds = report["config"], report["seeds"]
    swims, trials = config["transfer"], config["eea"]
    body = Morphology.coerce(config["morphology"])
    several = "s" if len(seeds) > 1 else ""
    parts: list[str | Rows] = [
        "# Damage recovery",
        f"{_what_broke(report, body)} Each row has another gait, which swam for "
        f"{swims['seconds']:g} s on the damaged robot ({swims['target_engine']}). Distances "
        "forward are in units of 5 cm; the robot is 4 units long.",
        f"{len(seeds)} replicate{several}, seed{several} {', '.join(map(str, seeds))}"
        f"{'; means, with 95% bootstrap intervals' if len(seeds) >= FEWEST else ''}. "
        f"Trials on the robot are of {trials['steps'] / 100:g} s, and its gyroscope has noise of "
        f"{config['gyro_noise']:g} rad/s.",
        _main_table(report["treatments"]),
        *headline(report),
        "*Own model* is the body the gait was evolved on. *Random poses* is the mean over "
        f"{swims['poses']} starts with the fins anywhere, since the robot cannot know where its "
        f"fins are. *Share* is of the distance of the oracle that searches and senses alike. The "
        "self-models start from random bodies.",
        "\n".join(f"- **{name}**: {WAYS[name].says}" for name in report["treatments"]),
    ]
    lost = sum(row["diverged_swims"] for row in report["treatments"].values())
    if lost:
        swim, count = ("swim", "counts") if lost == 1 else ("swims", "count")
        parts.append(f"{lost} {swim} on the damaged robot diverged and {count} as no progress.")
    if several:
        parts += ["## Within replicates", _paired_table(report["paired"])]
    return parts


def _what_broke(report: dict[str, Any], body: Morphology) -> str:
    if report["config"]["damage"] == HELD_OUT:
        each = [o["damage"] for o in next(iter(report["replicates"].values()))]
        return f"What broke: in each replicate something else, {', '.join(f'`{d}`' for d in each)}."
    damage = Damage.parse(report["config"]["damage"])
    return f"What broke: {damage.in_words(body)} (`{damage}`)."


def headline(report: dict[str, Any]) -> list[str]:
    """Return a sentence on each way to recover: what it came to."""
    count = len(report["seeds"])
    won = {
        (r["first"], r["second"], r["measure"]): f"{r['wins']} of {count}" for r in report["paired"]
    }
    said = []
    for ours in (name for name in RECOVERED if name in report["treatments"]):
        row = report["treatments"][ours]
        old, any_body = (
            " and ".join(won[ours, other, m] for m in MEASURES)
            for other in ("undamaged", "randomised")
        )
        shares = [row[name] for name in SHARES]
        far = "the one for the true body gets nowhere"
        if None not in shares:
            far = f"it swims {shares[0]:.0%} and {shares[1]:.0%} as far as one for the true body"
        said.append(
            f"**{ours}**: after {row['trials']} trials the robot's gait beats the old one in {old} "
            f"replicates, from the zero pose and from random ones, and the one for any damage in "
            f"{any_body}; {far}{_told(row)}."
        )
    direct = report["treatments"].get("direct")
    if direct:
        known = [hours for hours in direct["robot_hours"] if hours is not None]
        reached = f"{len(known)} of {count} replicates"
        said.append(
            f"**direct**: a search on the robot itself comes to what joint inference's gait swims "
            f"in {reached}"
            + (f", after {np.median(known):.1f} hours of swimming in the median" if known else "")
            + f", of {direct['trials'] * report['config']['transfer']['seconds'] / 3600:.0f} hours."
        )
    return said


def _told(row: dict[str, Any]) -> str:
    """Return whether shares are told from all of the oracle's distance, where that is known."""
    ends = [row["spread"][name]["interval"] for name in SHARES]
    if None in ends:
        return ""
    apart = sum(not low <= 1.0 <= high for low, high in ends)
    return (", neither told from 100%", ", one told from 100%", ", both told from 100%")[apart]


def _number(value: float | None, interval: Sequence[float] | None, form: str) -> str:
    if value is None:
        return "none"
    low, high = interval or (0.0, 0.0)
    return f"{value:{form}}" + (f" [{low:{form}}, {high:{form}}]" if low < high else "")


def _main_table(treatments: dict[str, Any]) -> Rows:
    columns = (  # field, header, form
        ("trials", "trials", "d"),
        ("objective_fitness", "OBJ_FIT", ".3f"),
        ("native_distance", "own model", ".1f"),
        ("target_distance", "target", ".1f"),
        ("share_of_oracle", "share", ".0%"),
        ("target_distance_random_poses", "target, random poses", ".1f"),
        ("share_of_oracle_random_poses", "share", ".0%"),
    )
    return [["gait for", *(header for _, header, _ in columns)]] + [
        [
            name,
            *(
                _number(row[f], row["spread"].get(f, {}).get("interval"), form)
                for f, _, form in columns
            ),
        ]
        for name, row in treatments.items()
    ]


def _paired_table(rows: list[dict[str, Any]]) -> Rows:
    return [["on the target", "is better than", "in", "sign test", "by (units)"]] + [
        [
            f"{row['first']}, {MEASURES[row['measure']]}",
            row["second"],
            f"{row['wins']} of {row['replicates']}",
            f"p = {row['sign_test_p']:.2g}",
            _number(row["mean"], row["interval"], ".1f"),
        ]
        for row in rows
    ]


def _pipes(rows: Rows) -> str:
    head, *body = (f"| {' | '.join(row)} |" for row in rows)
    return "\n".join([head, "|" + "---|" * len(rows[0]), *body])


def _table(rows: Rows, room: int) -> Table:
    """Return a table folded to ``room``: a column has its longest word, and the first the rest."""
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    columns = list(zip(*rows, strict=True))
    least = [max(len(word) for cell in column for word in cell.split()) for column in columns]
    spare = max(0, room - sum(least) - len(least))
    for column, width in zip(columns, least, strict=True):
        more = min(spare, max(map(len, column)) - width)
        table.add_column(column[0], width=width + more)
        spare -= more
    for row in rows[1:]:
        table.add_row(*row)
    return table
