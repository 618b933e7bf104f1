"""A study's numbers: means, intervals and paired differences, as ``summary.json`` has them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from aquafish_gym.morphology import FINS
from eea.core.fitness import chance_level, mid_range_level, quantisation_errors, quantisation_limit
from eea.report.arms import comparisons
from eea.report.findings import ANGLE_ERRORS, DIMENSION_ERRORS, LAYOUT, SPREADS, Findings, Floats
from eea.report.statistics import paired_difference, rank_correlation, summarize

SCHEMA = "eea.summary/2"


def summarize_study(findings: Findings) -> dict[str, Any]:
    """Return every number of the summary, ready for JSON."""
    arms, truth = findings.arms, findings.truth
    return {
        "schema": SCHEMA,
        "run": findings.run,
        "rounds": findings.rounds,
        "rise_since_round": _earlier(findings),
        "truth": dict(zip(LAYOUT.names, truth.tolist(), strict=True)),
        "planned": sum(len(seeds) for own in findings.plan.values() for seeds in own.values()),
        "finished": len(findings.replicates),
        "missing": _missing(findings),
        "chance": chance_level(truth, LAYOUT),
        "mid_range": mid_range_level(truth, LAYOUT),
        "nearest": quantisation_limit(truth, LAYOUT),
        "durations": findings.durations(),
        "labels": findings.labels,
        "conditions": findings.conditions,
        "arms": {arm: _summarize_arm(findings, arm) for arm in arms},
        "paired": [_compare(findings, first, second) for first, second in comparisons(arms)],
        "dimensions": _summarize_dimensions(findings),
        "angle_error": {
            arm: {
                fin: summarize(last[column]) for fin, column in zip(FINS, ANGLE_ERRORS, strict=True)
            }
            for arm in arms
            if len(last := findings.last_rounds(arm))
        },
    }


def _earlier(findings: Findings) -> int:
    """Return the round that the last one is compared with: 15 of 25."""
    return max(1, round(0.6 * findings.rounds))


def _missing(findings: Findings) -> dict[str, dict[str, int]]:
    """Return how many planned replicates are not finished, where there are any."""
    finished = findings.replicates.groupby(level=["arm", "steps"]).size().to_dict()
    missing: dict[str, dict[str, int]] = {}
    for arm, durations in findings.plan.items():
        for steps, seeds in durations.items():
            if count := len(seeds) - int(finished.get((arm, steps), 0)):
                missing.setdefault(arm, {})[str(steps)] = count
    return missing


def _summarize_arm(findings: Findings, arm: str) -> dict[str, Any]:
    durations = {
        str(steps): _summarize_fitness(findings, arm, [steps]) for steps in findings.durations(arm)
    }
    sds = [numbers["objective_fitness"]["sd"] for numbers in durations.values() if numbers]
    return {
        "durations": durations,
        "mean_of_sds": None if None in sds else float(np.mean(sds)),
        "mean_of_durations": _summarize_fitness(findings, arm),
        "trials": float(findings.replicates.loc[arm]["trials"].mean()),
    }


def _summarize_fitness(
    findings: Findings, arm: str, durations: Sequence[int] | None = None
) -> dict[str, Any] | None:
    """Return the last round's numbers; None if no seed is finished in all durations."""
    objective, model = (findings.curves(arm, fit, durations) for fit in ("obj_fit", "mod_fit"))
    last = objective[findings.rounds]
    if last.empty:
        return None
    return {
        "objective_fitness": summarize(last),
        "model_fitness": summarize(model[findings.rounds]),
        "rise": summarize(last - objective[_earlier(findings)]),
    }


def _compare(findings: Findings, first: str, second: str) -> dict[str, Any]:
    """Return paired differences of two arms, at the last round and of the mean over rounds."""
    common = [s for s in findings.durations(first) if s in findings.durations(second)]
    rows = []
    for durations in [[steps] for steps in common] + ([common] if len(common) > 1 else []):
        curves = [findings.curves(arm, "obj_fit", durations) for arm in (first, second)]
        if not curves[0].index.intersection(curves[1].index).empty:
            last = [c[findings.rounds].to_dict() for c in curves]
            over = [c.mean(axis="columns").to_dict() for c in curves]
            row = {"durations": durations, "last_round": paired_difference(*last)}
            rows.append(row | {"mean_over_rounds": paired_difference(*over)})
    return {"first": first, "second": second, "rows": rows}


def chance_errors(truth: Floats) -> Floats:
    """Return the exact mean error of uniform random genomes, as shares of the ranges, (n,)."""
    pairs = zip(LAYOUT.variables, truth, strict=True)
    return np.array([np.abs(v.levels - true).mean() / (v.high - v.low) for v, true in pairs])


def _summarize_dimensions(findings: Findings) -> dict[str, Any]:
    """Return each dimension's final error and the models' spread, as shares of its range."""
    truth, span = findings.truth, LAYOUT.high - LAYOUT.low
    chance = chance_errors(truth)
    middle = np.abs(0.5 * (LAYOUT.low + LAYOUT.high) - truth) / span
    guesses = np.minimum(chance, middle)
    arms: dict[str, Any] = {}
    for arm in findings.arms:
        last, every = findings.last_rounds(arm), findings.replicates.loc[arm]
        if last.empty:
            continue
        sds = every.groupby("steps")[DIMENSION_ERRORS].std().mean()  # NaN of single replicates
        rows = {}
        for i, name in enumerate(LAYOUT.names):
            error = summarize(last[DIMENSION_ERRORS[i]])
            interval, sd = error["interval"], float(sds.iloc[i])
            rows[name] = {
                "error": error,
                "spread": summarize(last[SPREADS[i]]),
                "mean_of_error_sds": None if np.isnan(sd) else sd,
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
