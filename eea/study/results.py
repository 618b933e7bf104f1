"""The finished replicates of a study as one table, equal to ``results.csv`` in every digit.

The table is read from ``runs/`` where a folder has them, otherwise from ``results.csv``.
"""

from __future__ import annotations

import io
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import AQUAFISH, BodyPlan
from aquafish_gym.runs.jobs import read_result
from aquafish_gym.utils.storage import DamagedFileError, read_bytes
from eea.core.angles import Floats
from eea.core.checks import ConfigurationError
from eea.core.genome import BitLayout
from eea.fish import RealityGap, fish_problem
from eea.study.arms import Arm, spoken, study_arms
from eea.study.replicate import RUNS_FOLDER, ReplicateKey
from eea.study.study import read_description, replicate_keys, targets_of

RESULTS_FILE = "results.csv"
MAXIMUM_RESULTS_BYTES = 2**30  # of results.csv, two million rounds

REPLICATE_KEYS = ["arm", "steps", "seed"]
# A record's fields, in the order of their columns.
_NUMBERS = ("round", "objective_fitness", "model_fitness", "action_fitness", "trials")


def angle_columns(plan: BodyPlan) -> dict[str, str]:
    """Return the column of the error of each fin's angle, rad."""
    return {fin: f"angle_error.{fin}" for fin in plan.names}


def dimension_columns(plan: BodyPlan) -> dict[str, str]:
    """Return the column of the error of each dimension, a share of its range."""
    return {d.name: f"dimension_error.{d.name}" for d in plan.dimensions}


def spread_columns(plan: BodyPlan) -> list[str]:
    """Return the columns of the population's SDs, shares of the ranges."""
    return [f"spread.{d.name}" for d in plan.dimensions]


def result_columns(plan: BodyPlan) -> list[str]:
    """Return the columns of ``results.csv``."""
    return [
        *REPLICATE_KEYS, "round", "obj_fit", "mod_fit", "act_fit", "trials",
        *angle_columns(plan).values(), *dimension_columns(plan).values(), *spread_columns(plan),
    ]  # fmt: skip


@dataclass(frozen=True)
class StudyResults:
    """The finished replicates of a study, and the plan of the study."""

    #: A row for each round of each finished replicate, with ``result_columns``; arms in the paper's
    #: order, then steps, seeds and rounds ascending; numbers to 5 significant digits. ``act_fit``
    #: is NaN in the first round, whose action is random.
    table: pd.DataFrame
    rounds: int
    planned: int  #: Number of replicates in the plan of study.json.
    truths: Floats  #: The dimensions of the targets, shape (D, n), one of them a replicate.
    target: str  #: Description of the target.
    body_plan: BodyPlan  #: Of the targets.
    plan: dict[str, Arm]  #: Every arm by name, in the order of the table.

    @cached_property
    def replicates(self) -> pd.DataFrame:
        """A row for each finished replicate, (arm, steps, seed): its last round."""
        return self.table.groupby(REPLICATE_KEYS, sort=False).tail(1).set_index(REPLICATE_KEYS)

    @property
    def layout(self) -> BitLayout:
        """The dimensions and their ranges."""
        return fish_problem(self.body_plan).models

    @property
    def labels(self) -> dict[str, str]:
        """Return the names of the arms for readers."""
        return {name: arm.label for name, arm in self.plan.items()}

    @property
    def arms(self) -> list[str]:
        """The arms that have a finished replicate."""
        return list(self.table["arm"].unique())

    def durations(self, *arms: str) -> list[int]:
        """Return the lengths of trials with finished replicates, of the given or of all arms."""
        rows = self.table[self.table["arm"].isin(arms)] if arms else self.table
        return sorted(int(steps) for steps in rows["steps"].unique())

    def curves(self, arm: str, column: str, durations: Sequence[int] | None = None) -> pd.DataFrame:
        """Return one column against the rounds 1, 2, ..., a row for each seed.

        A replicate that stopped early keeps its last round's value. For several durations
        (``None``: all of the arm) values are means, over seeds that are finished in all of them.
        """
        rows = self._rows_of[arm].pivot(index=REPLICATE_KEYS[1:], columns="round", values=column)
        every = rows.reindex(columns=range(1, self.rounds + 1)).ffill(axis=1)
        return _mean_over(every, durations or self.durations(arm))

    def last_rounds(self, arm: str) -> pd.DataFrame:
        """Return all columns of the last round, means over durations as in ``curves``."""
        return _mean_over(self.replicates.loc[arm], self.durations(arm))

    def to_csv(self) -> str:
        """Return the table as ``results.csv`` holds it."""
        return str(self.table.to_csv(index=False, float_format="%.5g", lineterminator="\n"))

    @cached_property
    def _rows_of(self) -> dict[str, pd.DataFrame]:
        return dict(iter(self.table.groupby("arm", sort=False)))


def _mean_over(rows: pd.DataFrame, durations: Sequence[int]) -> pd.DataFrame:
    """Return means over durations of rows (steps, seed), for seeds that all durations have."""
    seeds = rows[rows.index.get_level_values("steps").isin(durations)].groupby("seed")
    return seeds.mean()[seeds.size() == len(durations)]


def read_study(folder: str | os.PathLike[str]) -> StudyResults:
    """Return a study's finished replicates, from ``study.json`` and ``runs/`` or ``results.csv``.

    Raises
    ------
    ConfigurationError
        If the folder holds no study or no finished replicate.
    DamagedFileError
        If a file is damaged; the message names it.
    """
    path = Path(folder)
    study = read_description(path)
    plan = study_arms(study["arms"], study["rounds"])
    keys = replicate_keys(study)
    body, damages = targets_of(study)
    return StudyResults(
        table=_table(path, keys, plan, body.plan),
        rounds=study["rounds"],
        planned=len(keys),
        truths=np.array([damage.body(body).to_array() for damage in damages]),
        target=_in_words(body, damages, RealityGap(**study.get("gap", {}))),
        plan=plan,
        body_plan=body.plan,
    )


def _in_words(body: Morphology, damages: Sequence[Damage], gap: RealityGap) -> str:
    """Return a sentence about the target."""
    changed = [
        f"{spoken(dimension.name)} {size:g}"
        for dimension, size in zip(body.plan.dimensions, body.sizes, strict=True)
        if size != dimension.nominal
    ]
    text = "The target has the nominal body"
    if body.plan != AQUAFISH:
        text += f" of the plan {body.plan.name}"
    if changed:
        text += f" with {', '.join(changed)} (in units of 5 cm)"
    if len(damages) > 1:
        text += f" and, seed by seed, the damages {', '.join(f'`{each}`' for each in damages)}"
    else:
        text += f" and the damage `{damages[0]}`" if damages[0] else " without damage"
    if gap.changes:
        text += f"; its world differs from its models' in {gap}"
    return f"{text}."


def _table(
    folder: Path, keys: Sequence[ReplicateKey], plan: Mapping[str, Arm], body_plan: BodyPlan
) -> pd.DataFrame:
    """Return the table of ``StudyResults``; raises as ``read_study``."""
    source = folder / RESULTS_FILE
    columns = result_columns(body_plan)
    empty = ["mod_fit", *angle_columns(body_plan).values(), *spread_columns(body_plan)]
    if source.exists() and not (folder / RUNS_FOLDER).exists():
        content = read_bytes(source, "results", MAXIMUM_RESULTS_BYTES).decode(errors="replace")
    else:
        order = list(plan)
        ordered = sorted(keys, key=lambda k: (order.index(k.arm), k.steps, k.seed))
        rows = [row for key in ordered for row in _rows(folder, key, body_plan)]
        if not rows:
            raise ConfigurationError(
                f"the study in {folder} has no finished replicate yet; the command that began it "
                "resumes it"
            )
        # A report uses no more digits than results.csv has.
        content = pd.DataFrame(rows, columns=columns).to_csv(index=False, float_format="%.5g")
    try:
        table = pd.read_csv(io.StringIO(content), dtype={"arm": str})
        numbers = table[columns[1:]].drop(columns="act_fit").astype(np.float64)
        own = [name for name, arm in plan.items() if arm.is_method]
        numbers.loc[table["arm"].isin(own), empty] = 0.0
        finite = np.isfinite(numbers.to_numpy())
        sound = list(table.columns) == columns and bool(finite.all())
    except (ValueError, KeyError):  # pandas' own errors are ValueErrors
        sound = False
    if not sound or table.empty:
        raise DamagedFileError(f"{source} is damaged: it is no table of rounds")
    return table


def _rows(folder: Path, key: ReplicateKey, plan: BodyPlan) -> list[list[Any]]:
    """Return a row of the table for each round of a replicate, none if it is not finished."""
    sizes = len(plan.dimensions)
    lists = {"angle_error": len(plan.fins), "dimension_error": sizes, "spread": sizes}
    return [
        [
            *key,
            *(record[name] for name in _NUMBERS),
            *(number for name, width in lists.items() for number in record[name] or width * [None]),
        ]
        for record in (read_result(folder, key) or {"rounds": []})["rounds"]
    ]
