"""What the replicates say together: means, intervals, and differences within replicates."""

from __future__ import annotations

from typing import Any

import numpy as np

from eea.report.statistics import FEWEST, ratio_interval, sign_test
from eea.report.statistics import interval as mean_interval
from recovery.treatments import TREATMENTS

__all__ = [
    "COMPARISONS",
    "FEWEST",
    "Outcomes",
    "distances",
    "mean_interval",
    "paired_table",
    "ratio_interval",
    "sign_test",
    "summarize",
    "treatment_table",
]

# The questions of the case study: does the recovered gait beat the old one, and plain EEA's?
COMPARISONS = (("out-of-band", "undamaged"), ("out-of-band", "none"), ("oracle", "out-of-band"))

Outcomes = dict[str, list[dict[str, Any]]]  # treatment -> one outcome a replicate, same order


def summarize(values: list[float]) -> dict[str, Any]:
    """Return the mean, SD (None for one number) and 95% interval of the mean (None under 5)."""
    data = np.array(values, dtype=np.float64)
    return {
        "mean": float(data.mean()),
        "sd": float(data.std(ddof=1)) if len(data) > 1 else None,
        "interval": mean_interval(data),
        "values": data.tolist(),
    }


def distances(outcome: dict[str, Any]) -> dict[str, float]:
    """Return one outcome's four distances in units: by body, from zero and from random poses."""
    return {
        "native_distance": outcome["native_distance"],
        "target_distance": outcome["target_distance"],
        "native_distance_random_poses": float(np.mean(outcome["native_random_distances"])),
        "target_distance_random_poses": float(np.mean(outcome["target_random_distances"])),
    }


def treatment_table(outcomes: Outcomes) -> dict[str, dict[str, Any]]:
    """Return each treatment's numbers: means over the replicates, and the spread beside them.

    A share is the ratio of the mean distances, not the mean of ratios, which one slow oracle
    would rule.
    """
    table: dict[str, dict[str, Any]] = {}
    oracle = [distances(o) for o in outcomes["oracle"]]
    for treatment in TREATMENTS:
        swum = [distances(o) for o in outcomes[treatment]]
        row: dict[str, Any] = {
            "objective_fitness": float(
                np.mean([o["objective_fitness"] for o in outcomes[treatment]])
            )
        }
        spread = {
            "objective_fitness": summarize([o["objective_fitness"] for o in outcomes[treatment]])
        }
        for name in swum[0]:
            spread[name] = summarize([d[name] for d in swum])
            row[name] = spread[name]["mean"]
        for name, suffix in (
            ("target_distance", ""),
            ("target_distance_random_poses", "_random_poses"),
        ):
            best = np.array([d[name] for d in oracle])
            ours = np.array([d[name] for d in swum])
            sound = best.mean() > 0
            row[f"share_of_oracle{suffix}"] = float(ours.mean() / best.mean()) if sound else None
            spread[f"share_of_oracle{suffix}"] = {
                "interval": ratio_interval(ours, best) if sound else None
            }
        row["diverged_swims"] = sum(o["diverged"] for o in outcomes[treatment])
        table[treatment] = row | {"spread": spread}
    return table


def paired_table(outcomes: Outcomes) -> list[dict[str, Any]]:
    """Return the differences on the target within replicates, in units, and who won how often."""
    rows = []
    for name in ("target_distance", "target_distance_random_poses"):
        for first, second in COMPARISONS:
            pairs = zip(outcomes[first], outcomes[second], strict=True)
            gains = [distances(a)[name] - distances(b)[name] for a, b in pairs]
            rows.append(
                {
                    "measure": name,
                    "first": first,
                    "second": second,
                    "wins": sum(g > 0 for g in gains),
                    "replicates": len(gains),
                    "sign_test_p": sign_test(gains),
                    "difference": summarize(gains),
                }
            )
    return rows
