"""A study's numbers: means, intervals and paired differences, as ``summary.json`` has them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from aquafish_gym.morphology import FINS
from eea.core.fitness import chance_level, mid_range_level, quantisation_errors, quantisation_limit
from eea.study.arms import comparisons
from eea.study.results import ANGLE_ERRORS, DIMENSION_ERRORS, LAYOUT, SPREADS, Floats, StudyResults
from eea.study.statistics import paired_difference, rank_correlation, summarize

SCHEMA = "eea.summary/3"


def summarize_study(results: StudyResults) -> dict[str, Any]:
    """Return every number of the report, ready for JSON."""
    arms, truth = results.arms, results.truth
    return {
        "schema": SCHEMA,
        "run": results.run,
        "rounds": results.rounds,
        "rise_since_round": _earlier(results),
        "truth": _by_name(truth),
        "planned": sum(len(seeds) for own in results.plan.values() for seeds in own.values()),
        "finished": len(results.replicates),
        "chance": chance_level(truth, LAYOUT),
        "mid_range": mid_range_level(truth, LAYOUT),
        "nearest": quantisation_limit(truth, LAYOUT),
        "durations": results.durations(),
        "labels": results.labels,
        "conditions": results.conditions,
        "arms": {arm: _summarize_arm(results, arm) for arm in arms},
        "paired": [_compare(results, first, second) for first, second in comparisons(arms)],
        "dimensions": _summarize_dimensions(results),
        "angle_error": {
            arm: {
                fin: summarize(last[column]) for fin, column in zip(FINS, ANGLE_ERRORS, strict=True)
            }
            for arm in arms
            if len(last := results.last_rounds(arm))
        },
    }


def _earlier(results: StudyResults) -> int:
    """Return the round that the last one is compared with: 15 of 25."""
    return max(1, round(0.6 * results.rounds))


def _summarize_arm(results: StudyResults, arm: str) -> dict[str, Any]:
    durations = {
        str(steps): _summarize_fitness(results, arm, [steps]) for steps in results.durations(arm)
    }
    sds = [numbers["objective_fitness"]["sd"] for numbers in durations.values() if numbers]
    return {
        "durations": durations,
        "mean_of_sds": None if None in sds else float(np.mean(sds)),
        "mean_of_durations": _summarize_fitness(results, arm),
    }


def _summarize_fitness(
    results: StudyResults, arm: str, durations: Sequence[int] | None = None
) -> dict[str, Any] | None:
    """Return the last round's numbers; None if no seed is finished in all durations."""
    objective, model = (results.curves(arm, fit, durations) for fit in ("obj_fit", "mod_fit"))
    last = objective[results.rounds]
    if last.empty:
        return None
    return {
        "objective_fitness": summarize(last),
        "model_fitness": summarize(model[results.rounds]),
        "rise": summarize(last - objective[_earlier(results)]),
    }


def _compare(results: StudyResults, first: str, second: str) -> dict[str, Any]:
    """Return paired differences of two arms, at the last round and of the mean over rounds."""
    common = [s for s in results.durations(first) if s in results.durations(second)]
    rows = []
    for durations in [[steps] for steps in common] + ([common] if len(common) > 1 else []):
        curves = [results.curves(arm, "obj_fit", durations) for arm in (first, second)]
        if not curves[0].index.intersection(curves[1].index).empty:
            last = [c[results.rounds].to_dict() for c in curves]
            over = [c.mean(axis="columns").to_dict() for c in curves]
            row = {"durations": durations, "last_round": paired_difference(*last)}
            rows.append(row | {"mean_over_rounds": paired_difference(*over)})
    return {"first": first, "second": second, "rows": rows}


def chance_errors(truth: Floats) -> Floats:
    """Return the exact mean error of uniform random genomes, as shares of the ranges, (n,)."""
    pairs = zip(LAYOUT.variables, truth, strict=True)
    return np.array([np.abs(v.levels - true).mean() / (v.high - v.low) for v, true in pairs])


def _summarize_dimensions(results: StudyResults) -> dict[str, Any]:
    """Return each dimension's final error and the models' spread, as shares of its range."""
    truth, span = results.truth, LAYOUT.high - LAYOUT.low
    chance = chance_errors(truth)
    middle = np.abs(0.5 * (LAYOUT.low + LAYOUT.high) - truth) / span
    guesses = np.minimum(chance, middle)
    arms: dict[str, Any] = {}
    for arm in results.arms:
        last, every = results.last_rounds(arm), results.replicates.loc[arm]
        if last.empty:
            continue
        rows = {}
        for i, name in enumerate(LAYOUT.names):
            error = summarize(last[DIMENSION_ERRORS[i]])
            interval = error["interval"]
            rows[name] = {
                "error": error,
                "spread": summarize(last[SPREADS[i]]),
                "better_than_guessing": interval and bool(interval[1] < guesses[i]),
            }
        arms[arm] = {
            "dimensions": rows,
            "rank_correlation": rank_correlation(
                every[DIMENSION_ERRORS].to_numpy().ravel(), every[SPREADS].to_numpy().ravel()
            ),
        }
    return {
        "chance_error": _by_name(chance),
        "mid_range_error": _by_name(middle),
        "nearest_error": _by_name(quantisation_errors(truth, LAYOUT)),
        "arms": arms,
    }


def _by_name(values: Floats) -> dict[str, float]:
    return dict(zip(LAYOUT.names, values.tolist(), strict=True))
