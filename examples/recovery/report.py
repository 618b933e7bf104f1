"""What the case study writes: ``report.json`` for programs and ``report.md`` for people."""

from __future__ import annotations

import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

from aquafish_gym.runs.storage import write_bytes, write_json
from recovery.statistics import FEWEST, Outcomes, paired_table, treatment_table

SCHEMA = "damage_recovery/1"
UNIT_IN_M = 0.05
LIBRARIES = ("aquafish-gym", "gymnasium", "neat-python", "numba", "numpy", "pybullet")

SAYS = {
    "undamaged": "the old body: the gait it swam with before the damage",
    "none": "plain EEA's model, which takes its fins to start at zero",
    "out-of-band": "Out-of-Band EEA's model, which infers where its fins started",
    "oracle": "the true damaged body: the best that self-modelling can give",
}


def versions() -> dict[str, str]:
    """Return the versions of what made the numbers."""
    found = {"python": platform.python_version()}
    for library in LIBRARIES:
        try:
            found[library] = version(library)
        except ModuleNotFoundError:
            found[library] = "not installed"
    return found


def build_report(config: dict[str, Any], seeds: list[int], outcomes: Outcomes) -> dict[str, Any]:
    """Return every number of the study, ready for JSON."""
    return {
        "schema": SCHEMA,
        "config": {name: value for name, value in config.items() if name != "versions"},
        "versions": config["versions"],
        "seeds": seeds,
        "unit_in_m": UNIT_IN_M,
        "treatments": treatment_table(outcomes),
        "paired": paired_table(outcomes),
        "replicates": outcomes,
    }


def write_report(directory: Path, report: dict[str, Any], figures: list[str]) -> None:
    """Write both files."""
    write_json(directory / "report.json", report)
    write_bytes(directory / "report.md", markdown(report, figures).encode())


def markdown(report: dict[str, Any], figures: list[str]) -> str:
    """Return the report for people."""
    config, seeds = report["config"], report["seeds"]
    damage, swims, trials = config["damage"], config["transfer"], config["eea"]
    lines = [
        "# Damage recovery",
        "",
        f"The robot has suffered `{damage}`. Each row believes in another body, evolved a gait on "
        f"it, and swam that gait for {swims['seconds']:g} s on the damaged robot "
        f"({swims['target_engine']}). Distances forward are in units of 5 cm; the robot is 4 "
        "units long.",
        "",
        f"{len(seeds)} replicate{'s' if len(seeds) > 1 else ''}, seed"
        f"{'s' if len(seeds) > 1 else ''} {', '.join(map(str, seeds))}"
        f"{'; means, with 95% bootstrap intervals' if len(seeds) >= FEWEST else ''}. "
        f"Self-models: {trials['rounds']} trials of {trials['steps'] / 100:g} s.",
        "",
        *_main_table(report["treatments"]),
        "",
        "*Own model* is the body the gait was evolved on. *Random poses* is the mean over "
        f"{swims['poses']} starts with the fins anywhere, since the robot cannot know where its "
        "fins are. *Share* is of the oracle's distance. The old body has eight of the nine "
        "dimensions right, so its OBJ_FIT is high although it is wrong where it matters; the "
        "self-models start from random bodies.",
        "",
    ]
    for treatment, sentence in SAYS.items():
        lines.append(f"- **{treatment}**: {sentence}")
    lost = sum(row["diverged_swims"] for row in report["treatments"].values())
    if lost:
        lines += ["", f"{lost} swims on the damaged robot diverged and count as no progress."]
    if len(seeds) > 1:
        lines += ["", "## Within replicates", "", *_paired_table(report["paired"])]
    lines += ["", "## Figures", ""]
    for name in figures:
        lines += [f"![{Path(name).stem.replace('_', ' ')}]({name})", ""]
    return "\n".join(lines).rstrip() + "\n"


def _number(summary: dict[str, Any], digits: int) -> str:
    text = f"{summary['mean']:.{digits}f}"
    low, high = summary["interval"] or (0.0, 0.0)
    if low < high:
        text += f" [{low:.{digits}f}, {high:.{digits}f}]"
    return text


def _share(row: dict[str, Any], name: str) -> str:
    value, interval = row[name], row["spread"][name]["interval"]
    if value is None:
        return "none"
    low, high = interval or (0.0, 0.0)
    return f"{value:.0%}" + (f" [{low:.0%}, {high:.0%}]" if low < high else "")


def _main_table(treatments: dict[str, Any]) -> list[str]:
    lines = [
        "| gait for | OBJ_FIT | own model | target | share | target, random poses | share |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, row in treatments.items():
        spread = row["spread"]
        lines.append(
            f"| {name} | {_number(spread['objective_fitness'], 3)} "
            f"| {_number(spread['native_distance'], 1)} "
            f"| {_number(spread['target_distance'], 1)} | {_share(row, 'share_of_oracle')} "
            f"| {_number(spread['target_distance_random_poses'], 1)} "
            f"| {_share(row, 'share_of_oracle_random_poses')} |"
        )
    return lines


def _paired_table(rows: list[dict[str, Any]]) -> list[str]:
    lines = [
        "| on the target | is better than | in | sign test | by (units) |",
        "|---|---|---|---|---|",
    ]
    for row in rows:
        where = ", random poses" if row["measure"].endswith("poses") else ", zero pose"
        lines.append(
            f"| {row['first']}{where} | {row['second']} | {row['wins']} of {row['replicates']} "
            f"| p = {row['sign_test_p']:.2g} | {_number(row['difference'], 1)} |"
        )
    return lines
