"""What a study's runs say: tables, a summary and pictures, a function of its finished replicates.

A study's folder holds ``study.json``, which says what is run, and
``runs/<arm>/<steps>/<seed>.jsonl``, a checksummed record a round. Nothing that depends on the
clock enters, so that the same runs give the same bytes.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.damage import Damage
from aquafish_gym.morphology import DIMENSIONS, FINS, Morphology
from aquafish_gym.runs.storage import DamagedFileError, read_records, write_bytes, write_json
from aquafish_gym.utils.validation import InvalidArgumentError
from eea.core.bits import BitLayout, model_layout
from eea.core.checks import ConfigurationError
from eea.core.fitness import chance_level, mid_range_level, quantisation_errors, quantisation_limit
from eea.report.statistics import paired_difference, rank_correlation, summarize
from eea.report.summary import ARMS, BASELINE, arm_label, condition_of, is_baseline, markdown
from eea.study.plan import Plan, read_plan

Floats = NDArray[np.float64]
Records = list[dict[str, Any]]  # one a round

STUDY, RUNS, FIGURES = "study.json", "runs", "figures"
CSV, SUMMARY, TEXT = "results.csv", "summary.json", "summary.md"
STUDY_SCHEMA, SCHEMA = "eea.study/1", "eea.summary/1"

# First less second, where a study has both.
COMPARISONS = (
    ("ideal", "out-of-band"),
    ("out-of-band", "in-band"),
    ("in-band", "none"),
    ("out-of-band-100", "out-of-band"),
    ("in-band-200", "in-band"),
    ("in-band-split", "in-band"),
    ("in-band-extended", "in-band"),
)


@dataclass(frozen=True)
class Findings:
    """The finished replicates of a study.

    Attributes
    ----------
    rounds
        Of each replicate.
    truth
        The target's dimensions, shape (n,).
    layout
        The models' genome, for the ranges of the dimensions.
    replicates
        Arm, then steps, then seed, to the records of a finished replicate; the arms in the
        paper's order, steps and seeds ascending. Only what has a finished replicate is there.
    unfinished
        Arm, then steps, to the number of replicates that are begun and not finished.
    planned
        How many replicates the study will have.
    labels
        Arm to its name for readers.
    conditions
        Arm to what is done about the angles: "ideal", "none", "in-band" or "out-of-band".
    run
        What was run, as study.json says it, ready for JSON.
    """

    rounds: int
    truth: Floats
    layout: BitLayout
    replicates: dict[str, dict[int, dict[int, Records]]]
    unfinished: dict[str, dict[int, int]]
    planned: int
    labels: dict[str, str]
    conditions: dict[str, str]
    run: dict[str, Any]

    @property
    def durations(self) -> list[int]:
        """Every length of trial that a finished replicate has."""
        return sorted({steps for durations in self.replicates.values() for steps in durations})

    def curves(self, arm: str, steps: int, field: str) -> dict[int, Floats]:
        """Return seed to one field of all rounds, shape (rounds,) or (rounds, k).

        A replicate that stopped early, at an accurate model, keeps its last round's value.
        """
        return {
            seed: np.array(
                [record[field] for record in records]
                + [records[-1][field]] * (self.rounds - len(records)),
                dtype=np.float64,
            )
            for seed, records in self.replicates[arm][steps].items()
        }

    def mean_curves(
        self, arm: str, field: str, durations: list[int] | None = None
    ) -> dict[int, Floats]:
        """Return as ``curves``, the means over durations, of the seeds finished in all of them.

        ``None`` is all of the arm's durations.
        """
        tables = [self.curves(arm, steps, field) for steps in durations or self.replicates[arm]]
        seeds = sorted(set.intersection(*(set(table) for table in tables)))
        return {seed: np.mean([table[seed] for table in tables], axis=0) for seed in seeds}


def report(folder: str | os.PathLike[str]) -> list[Path]:
    """Write results.csv, summary.json, summary.md and the figures of a study.

    They depend on nothing but what is finished in ``runs/`` and what ``study.json`` says is run.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    ConfigurationError
        If the folder holds no study or no finished replicate, or a file is damaged; the message
        names the file and the line.
    """
    from eea.report.figures import is_a_picture, save_study_figures

    path = Path(folder)
    findings = read_study(path)
    summary = summarize_study(findings)
    write_bytes(path / CSV, results_table(findings).encode())
    write_json(path / SUMMARY, summary)
    (path / FIGURES).mkdir(exist_ok=True)
    figures = save_study_figures(findings, summary, path / FIGURES)
    for old in (path / FIGURES).glob("*.png"):
        if old not in figures and is_a_picture(old.stem):
            old.unlink()  # of arms that an earlier report showed so
    names = [f"{FIGURES}/{figure.name}" for figure in figures]
    write_bytes(path / TEXT, markdown(summary, names).encode())
    return [path / CSV, path / SUMMARY, path / TEXT, *figures]


def read_study(folder: str | os.PathLike[str]) -> Findings:
    """Return a study's finished replicates, their checksums verified.

    Raises
    ------
    ConfigurationError
        As ``report``.
    """
    path = Path(folder)
    header = _read_header(path)
    rounds: int = header["rounds"]
    replicates: dict[str, dict[int, dict[int, Records]]] = {}
    unfinished: dict[str, dict[int, int]] = {}
    plan = read_plan(header)
    for arm in sorted(plan, key=_place):
        for steps, seeds in sorted(plan[arm].items()):
            for seed in seeds:
                file = path / RUNS / arm / str(steps) / f"{seed}.jsonl"
                if not file.exists():
                    continue
                records = _read_replicate(file, rounds, header["arms"][arm].get("accurate"))
                if records is None:
                    counts = unfinished.setdefault(arm, {})
                    counts[steps] = counts.get(steps, 0) + 1
                else:
                    replicates.setdefault(arm, {}).setdefault(steps, {})[seed] = records
    if not replicates:
        begun = sum(sum(counts.values()) for counts in unfinished.values())
        raise ConfigurationError(
            f"the study in {path} has no finished replicate yet ({begun} begun); "
            "the command that began it goes on with it"
        )
    planned = sum(len(seeds) for durations in plan.values() for seeds in durations.values())
    labels = {arm: arm_label(arm, _models(header["arms"][arm])) for arm in plan}
    layout = model_layout((d.name, d.maximum, d.bits) for d in DIMENSIONS)
    conditions = {arm: str(header["arms"][arm].get("condition")) for arm in plan}
    morphology, damage = _target(path, header)
    return Findings(
        rounds,
        damage.apply(morphology).to_array(),
        layout,
        replicates,
        unfinished,
        planned,
        labels,
        conditions,
        _run(header, plan, morphology, damage),
    )


def _run(
    header: dict[str, Any], plan: Plan, morphology: Morphology, damage: Damage
) -> dict[str, Any]:
    """Return what a reader must know of a study's settings; None and [] where it does not say."""
    arms = sorted(plan, key=_place)
    source = header.get("source")
    return {
        "target_changes": {
            dimension.name: size
            for dimension, size in zip(DIMENSIONS, morphology.to_array().tolist(), strict=True)
            if size != dimension.nominal
        },
        "target_damage": str(damage),
        "target_orientation": header.get("target_orientation", "upright"),
        "steps": {arm: sorted(plan[arm]) for arm in arms},
        "signals": {arm: _signal(header["arms"][arm]) for arm in arms},
        "source": [str(stamp) for stamp in source] if isinstance(source, list) else [],
    }


def _signal(settings: dict[str, Any]) -> str | None:
    """Return what an arm's behaviours are made of, None if it does not say."""
    behavior = settings.get("behavior")
    signal = behavior.get("signal") if isinstance(behavior, dict) else None
    return signal if isinstance(signal, str) else None


def _models(settings: dict[str, Any]) -> int | None:
    """Return how many models an arm has, None if it does not say."""
    estimation = settings.get("estimation")
    models = estimation.get("population") if isinstance(estimation, dict) else None
    return models if isinstance(models, int) else None


def _read_header(path: Path) -> dict[str, Any]:
    source = path / STUDY
    try:
        header: Any = json.loads(source.read_bytes())
        schema = header["schema"]
    except FileNotFoundError:
        raise ConfigurationError(
            f"{path} must hold a study, which python -m eea study --out {path} begins; "
            f"it has no {STUDY}"
        ) from None
    except OSError as error:
        raise ConfigurationError(f"{source} cannot be read: {error.strerror}") from None
    except (ValueError, KeyError, TypeError):
        raise ConfigurationError(f"{source} is damaged: it does not say what is run") from None
    if schema != STUDY_SCHEMA:
        raise ConfigurationError(f"{source} must be of schema {STUDY_SCHEMA}; it is of {schema}")
    try:
        if type(header.get("rounds")) is not int or header["rounds"] < 1:
            raise ValueError("rounds")
        for arm, durations in read_plan(header).items():
            if not durations:
                raise ValueError(f"replicates.{arm}")
            if not isinstance(header["arms"][arm].get("accurate"), int | float | None):
                raise ValueError(f"arms.{arm}.accurate")
    except ValueError as name:
        raise ConfigurationError(f"{source} is damaged: it does not say the {name}") from None
    return dict(header)


def _target(path: Path, header: dict[str, Any]) -> tuple[Morphology, Damage]:
    """Return the target's body before its damage, and the damage, which fits it."""
    try:
        damage = Damage.from_json(json.dumps(header["target_damage"]))
        morphology = Morphology.coerce(header["target_morphology"])
        damage.apply(morphology)
        return morphology, damage
    except (InvalidArgumentError, KeyError) as error:
        raise ConfigurationError(
            f"{path / STUDY} does not say what the target is: {error}"
        ) from None


def _read_replicate(file: Path, rounds: int, accurate: float | None) -> Records | None:
    """Return the records of a finished replicate, or None of one that is not."""
    try:
        records: Records = read_records(file)
    except DamagedFileError as error:
        content = file.read_bytes()
        # A command that is killed, or at work, leaves the line that it was writing.
        if content.count(b"\n") == error.line - 1 and error.line <= rounds:
            return None
        raise ConfigurationError(
            f"{error}; delete this file and go on with the study to compute the replicate anew"
        ) from None
    for number, record in enumerate(records, start=1):
        if record.get("round") != number or number > rounds:
            raise ConfigurationError(
                f"{file}, line {number}: it must be round {number} of {rounds}; "
                f"it is round {record.get('round')}"
            )
    reached = bool(records) and accurate is not None and records[-1]["model_fitness"] >= accurate
    return records if reached or len(records) == rounds else None


def _place(arm: str) -> tuple[bool, int, str]:
    """Return a sort key: baselines first, then the paper's order, then names."""
    order, name = list(ARMS), arm.removeprefix(f"{BASELINE}-")
    return (not is_baseline(arm), order.index(name) if name in order else len(order), arm)


def baseline_of(arm: str, arms: Iterable[str]) -> str | None:
    """Return which of the arms an ablation is held against, None if it is no ablation.

    ``clamp-degrees-ideal`` is held against ``baseline-ideal``, and any arm against ``baseline``.
    """
    if is_baseline(arm):
        return None
    baselines = [other for other in arms if is_baseline(other)]
    fitting = [other for other in baselines if condition_of(other, arm)]
    return max(fitting, key=len, default=BASELINE if BASELINE in baselines else None)


def comparisons(arms: Sequence[str]) -> list[tuple[str, str]]:
    """Return which arms are compared, first less second.

    Besides the conditions these are variants: an arm whose name goes on after another's.
    """
    pairs = [(first, second) for first, second in COMPARISONS if {first, second} <= set(arms)]
    for arm in arms:
        if arm in dict(pairs) or is_baseline(arm) or baseline_of(arm, arms):
            continue
        plain = [other for other in arms if arm.startswith(f"{other}-")]
        if plain:
            pairs.append((arm, max(plain, key=len)))
    return pairs


def results_table(findings: Findings) -> str:
    """Return every finished round as CSV, numbers to 5 significant digits, angles in rad."""
    names = findings.layout.names
    columns = ["arm", "steps", "seed", "round", "obj_fit", "mod_fit", "act_fit", "trials"]
    columns += [f"angle_error.{fin}" for fin in FINS]
    columns += [f"{kind}.{name}" for kind in ("dimension_error", "spread") for name in names]
    lines = [",".join(columns)]
    for arm, durations in findings.replicates.items():
        for steps, seeds in durations.items():
            for seed, records in seeds.items():
                for r in records:
                    numbers = [r["objective_fitness"], r["model_fitness"], r["action_fitness"]]
                    more = [*r["angle_error"], *r["dimension_error"], *r["spread"]]
                    cells = [arm, str(steps), str(seed), str(r["round"])]
                    cells += [*map(_cell, numbers), str(r["trials"]), *map(_cell, more)]
                    lines.append(",".join(cells))
    return "\n".join(lines) + "\n"


def _cell(value: float | None) -> str:
    return "" if value is None else f"{value:.5g}"


def chance_errors(truth: Floats, layout: BitLayout) -> Floats:
    """Return the exact mean error of uniform random genomes, as shares of the ranges, (n,)."""
    pairs = zip(layout.variables, truth, strict=True)
    return np.array([np.abs(v.levels - true).mean() / (v.high - v.low) for v, true in pairs])


def summarize_study(findings: Findings) -> dict[str, Any]:
    """Return every number of the summary, ready for JSON."""
    arms = list(findings.replicates)
    return {
        "schema": SCHEMA,
        "run": findings.run,
        "rounds": findings.rounds,
        "rise_since_round": _earlier(findings),
        "truth": dict(zip(findings.layout.names, findings.truth.tolist(), strict=True)),
        "planned": findings.planned,
        "finished": sum(len(s) for arm in arms for s in findings.replicates[arm].values()),
        "chance": chance_level(findings.truth, findings.layout),
        "mid_range": mid_range_level(findings.truth, findings.layout),
        "nearest": quantisation_limit(findings.truth, findings.layout),
        "durations": findings.durations,
        "labels": findings.labels,
        "conditions": findings.conditions,
        "arms": {arm: _summarize_arm(findings, arm) for arm in arms},
        "unfinished": {
            arm: {str(steps): count for steps, count in counts.items()}
            for arm, counts in findings.unfinished.items()
        },
        "paired": [_compare(findings, first, second) for first, second in comparisons(arms)],
        "effects": [
            _compare(findings, arm, baseline)
            for baseline in filter(is_baseline, arms)
            for arm in arms
            if baseline_of(arm, arms) == baseline
        ],
        "dimensions": _summarize_dimensions(findings),
        "angle_error": {
            arm: {
                fin: summarize(
                    [curve[-1, i] for curve in findings.mean_curves(arm, "angle_error").values()]
                )
                for i, fin in enumerate(FINS)
            }
            for arm in arms
            if findings.mean_curves(arm, "angle_error")
        },
    }


def _earlier(findings: Findings) -> int:
    """Return the round that the last one is compared with: 15 of 25."""
    return max(1, round(0.6 * findings.rounds))


def _summarize_arm(findings: Findings, arm: str) -> dict[str, Any]:
    durations = {
        str(steps): _summarize_curves(
            findings,
            findings.curves(arm, steps, "objective_fitness"),
            findings.curves(arm, steps, "model_fitness"),
        )
        for steps in findings.replicates[arm]
    }
    objective = findings.mean_curves(arm, "objective_fitness")
    sds = [numbers["objective_fitness"]["sd"] for numbers in durations.values()]
    return {
        "durations": durations,
        "mean_of_sds": None if None in sds else float(np.mean(sds)),
        "mean_of_durations": _summarize_curves(
            findings, objective, findings.mean_curves(arm, "model_fitness")
        )
        if objective
        else None,
        "trials": _mean_trials(findings, arm),
    }


def _summarize_curves(
    findings: Findings, objective: dict[int, Floats], model: dict[int, Floats]
) -> dict[str, Any]:
    """Return the last round's numbers of one set of replicates."""
    since = _earlier(findings) - 1
    return {
        "objective_fitness": summarize([curve[-1] for curve in objective.values()]),
        "model_fitness": summarize([curve[-1] for curve in model.values()]),
        "rise": summarize([curve[-1] - curve[since] for curve in objective.values()]),
    }


def _mean_trials(findings: Findings, arm: str) -> float:
    """Return the mean number of trials that a replicate simulates."""
    totals = [
        sum(record["trials"] for record in records)
        for seeds in findings.replicates[arm].values()
        for records in seeds.values()
    ]
    return float(np.mean(totals))


def _compare(findings: Findings, first: str, second: str) -> dict[str, Any]:
    """Return paired differences of two arms, at the last round and of the mean over rounds."""
    common = [steps for steps in findings.replicates[first] if steps in findings.replicates[second]]
    sets = [[steps] for steps in common] + ([common] if len(common) > 1 else [])
    rows = []
    for durations in sets:
        both = [
            findings.mean_curves(arm, "objective_fitness", durations) for arm in (first, second)
        ]
        if not both[0].keys() & both[1].keys():
            continue
        last = [{seed: float(c[-1]) for seed, c in curves.items()} for curves in both]
        over = [{seed: float(c.mean()) for seed, c in curves.items()} for curves in both]
        rows.append(
            {
                "durations": durations,
                "last_round": paired_difference(*last),
                "mean_over_rounds": paired_difference(*over),
            }
        )
    ratio = _trials_ratio(findings, first, second)
    return {
        "first": first,
        "second": second,
        "rows": rows,
        "trials_ratio": ratio,
    }


def _trials_ratio(findings: Findings, first: str, second: str) -> float | None:
    """Return how many times the second's trials the first simulates, where both are finished."""
    ours, theirs = findings.replicates[first], findings.replicates[second]
    common = [
        (steps, seed)
        for steps in ours.keys() & theirs.keys()
        for seed in ours[steps].keys() & theirs[steps].keys()
    ]
    trials = [
        sum(record["trials"] for steps, seed in common for record in arm[steps][seed])
        for arm in (ours, theirs)
    ]
    return trials[0] / trials[1] if trials[1] else None


def _summarize_dimensions(findings: Findings) -> dict[str, Any]:
    """Return each dimension's final error and the models' spread, as shares of its range."""
    layout, truth = findings.layout, findings.truth
    span = layout.high - layout.low
    chance = chance_errors(truth, layout)
    middle = np.abs(0.5 * (layout.low + layout.high) - truth) / span
    arms: dict[str, Any] = {}
    for arm, durations in findings.replicates.items():
        errors = _last(findings.mean_curves(arm, "dimension_error"))
        spreads = _last(findings.mean_curves(arm, "spread"))
        if not len(errors):
            continue
        found = [_last(findings.curves(arm, steps, "morphology")) / span for steps in durations]
        several = [bodies.std(axis=0, ddof=1) for bodies in found if len(bodies) > 1]
        between = np.mean(several, axis=0).tolist() if several else [None] * len(layout.names)
        rows = {}
        for i, name in enumerate(layout.names):
            error = summarize(errors[:, i])
            interval = error["interval"]
            guess = min(chance[i], middle[i])
            rows[name] = {
                "error": error,
                "spread": summarize(spreads[:, i]),
                "between_replicates": between[i],
                "better_than_guessing": None if interval is None else bool(interval[1] < guess),
            }
        every = [
            (
                _last(findings.curves(arm, s, "dimension_error")),
                _last(findings.curves(arm, s, "spread")),
            )
            for s in durations
        ]
        arms[arm] = {
            "dimensions": rows,
            "rank_correlation": rank_correlation(
                np.concatenate([e.ravel() for e, _ in every]),
                np.concatenate([s.ravel() for _, s in every]),
            ),
        }
    return {
        "chance_error": dict(zip(layout.names, chance.tolist(), strict=True)),
        "mid_range_error": dict(zip(layout.names, middle.tolist(), strict=True)),
        "nearest_error": dict(
            zip(layout.names, quantisation_errors(truth, layout).tolist(), strict=True)
        ),
        "arms": arms,
    }


def _last(curves: dict[int, Floats]) -> Floats:
    """Return the last round's rows of all seeds, shape (seeds, k)."""
    return np.array([curve[-1] for curve in curves.values()])
