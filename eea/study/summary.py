"""The numbers of ``summary.json``: means, intervals and paired differences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from eea.core.angles import Floats
from eea.core.fitness import chance_errors, dimension_errors, quantisation_errors
from eea.core.genome import BitLayout
from eea.study.arms import comparisons
from eea.study.results import StudyResults, angle_columns, dimension_columns
from eea.study.statistics import paired_difference, summary_statistics

SUMMARY_SCHEMA = "eea.summary/4"


def summarize_study(results: StudyResults) -> dict[str, Any]:
    """Return every number of the report, ready for JSON."""
    guesses = guess_errors(results.truths, results.layout)
    pairs = comparisons([results.plan[arm] for arm in results.arms])
    return {
        "schema": SUMMARY_SCHEMA,
        "target": results.target,
        "rounds": results.rounds,
        "rise_since_round": _earlier(results),
        "planned": results.planned,
        "finished": len(results.replicates),
        "guesses": {name: float(1.0 - errors.mean()) for name, errors in guesses.items()},
        "guess_errors": {
            name: dict(zip(results.layout.names, errors.tolist(), strict=True))
            for name, errors in guesses.items()
        },
        "fitness": [row for arm in results.arms for row in _fitness(results, arm)],
        "paired": [row for pair in pairs for row in _paired(results, *pair)],
        "dimension_error": {arm: _dimensions(results, arm, guesses) for arm in results.arms},
        "angle_error": {
            arm: {}
            if results.plan[arm].is_method
            else _summaries(results, arm, angle_columns(results.body_plan))
            for arm in results.arms
        },
    }


def guess_errors(truths: Floats, layout: BitLayout) -> dict[str, Floats]:
    """Return the mean errors (n,) of three guesses at bodies (D, n), as shares of the ranges."""
    middle = 0.5 * (layout.low + layout.high)
    errors = {
        "random bodies": [chance_errors(truth, layout) for truth in truths],
        "mid-range body": [dimension_errors(middle, truth, layout) for truth in truths],
        "quantisation limit": [quantisation_errors(truth, layout) for truth in truths],
    }
    return {name: np.mean(each, axis=0) for name, each in errors.items()}


def _earlier(results: StudyResults) -> int:
    """Return the round to compare with the last one: 15 of 25."""
    return max(1, round(0.6 * results.rounds))


def _duration_sets(durations: Sequence[int]) -> list[list[int]]:
    """Return each duration alone, then all together if there are several."""
    return [[steps] for steps in durations] + ([list(durations)] if len(durations) > 1 else [])


def _fitness(results: StudyResults, arm: str) -> list[dict[str, Any]]:
    """Return the last round's numbers of an arm, for seeds that are finished in all durations."""
    rows = []
    for durations in _duration_sets(results.durations(arm)):
        objective, model = (results.curves(arm, fit, durations) for fit in ("obj_fit", "mod_fit"))
        last = objective[results.rounds]
        if not last.empty:
            rows.append(
                {
                    "arm": arm,
                    "durations": durations,
                    "objective_fitness": summary_statistics(last),
                    "model_fitness": None
                    if model[results.rounds].isna().any()
                    else summary_statistics(model[results.rounds]),
                    "rise": summary_statistics(last - objective[_earlier(results)]),
                }
            )
    return rows


def _paired(results: StudyResults, first: str, second: str) -> list[dict[str, Any]]:
    """Return paired differences of two arms in the last round and in the mean over rounds."""
    rows = []
    common = [s for s in results.durations(first) if s in results.durations(second)]
    for durations in _duration_sets(common):
        curves = [results.curves(arm, "obj_fit", durations) for arm in (first, second)]
        if not curves[0].index.intersection(curves[1].index).empty:
            last = [c[results.rounds].to_dict() for c in curves]
            over = [c.mean(axis="columns").to_dict() for c in curves]
            rows.append(
                {
                    "first": first,
                    "second": second,
                    "durations": durations,
                    "last_round": paired_difference(*last),
                    "mean_over_rounds": paired_difference(*over),
                }
            )
    return rows


def _dimensions(
    results: StudyResults, arm: str, guesses: Mapping[str, Floats]
) -> dict[str, dict[str, Any]]:
    """Return the final error of each dimension, as a share of its range, beside guesses."""
    found = _summaries(results, arm, dimension_columns(results.body_plan))
    errors = map(min, guesses["random bodies"], guesses["mid-range body"])
    best = dict(zip(results.layout.names, errors, strict=True))
    for name, row in found.items():
        row["better_than_guessing"] = row["interval"] and bool(row["interval"][1] < best[name])
    return found


def _summaries(
    results: StudyResults, arm: str, columns: Mapping[str, str]
) -> dict[str, dict[str, Any]]:
    """Return summaries of columns of the last round; none without a seed in all durations."""
    last = results.last_rounds(arm)
    return {name: summary_statistics(last[column]) for name, column in columns.items() if len(last)}
