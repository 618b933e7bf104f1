"""The choices that the paper leaves open, as arms of a study that can settle them.

An *arm* is one answer to a question under one condition, all else as in that condition's baseline.
Arms share the baselines, and the angles that the target hides are the same in all of them, so
differences between an arm and its baseline are paired by seed.

Answers are listed whether or not they are the default, so that a default can change without this
table: the answer that equals a baseline makes no arm, for the baseline is its measurement.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from eea.core.checks import choice
from eea.core.config import EEAConfig
from eea.study.presets import FIGURES

Settings = Mapping[str, Mapping[str, Any]]  # part of EEAConfig -> field -> value

# Condition -> its baseline: the settings of one of the paper's figures.
BASELINES: dict[str, EEAConfig] = {
    "ideal": FIGURES["fig5"],
    "none": FIGURES["fig6"],
    "in-band": FIGURES["fig7"],
    "out-of-band": FIGURES["fig9"],
    "out-of-band-100": FIGURES["fig10"],
}
SEEN_OR_NOT = ("ideal", "out-of-band")  # one condition without hidden angles, one with


@dataclass(frozen=True)
class Ablation:
    """One question that the paper leaves open, and its possible answers.

    Attributes
    ----------
    row
        Where ``docs/paper_map.md`` asks it: the first cell of a row.
    conditions
        Under which it is measured, keys of ``BASELINES``: those that it matters for.
    answers
        Settings by a short name. All answers of a question set the same fields.
    """

    row: str
    conditions: tuple[str, ...]
    answers: Mapping[str, Settings]


def _one(row: str, conditions: tuple[str, ...], name: str, values: Mapping[str, Any]) -> Ablation:
    """Return an ablation whose answers are values of one field, ``name`` as ``part.field``."""
    part, _, field = name.partition(".")
    return Ablation(row, conditions, {key: {part: {field: value}} for key, value in values.items()})


def _clamp(clamp: bool, unit: str = "degrees", normalised: bool = False) -> Settings:
    return {"behavior": {"clamp": clamp, "unit": unit, "normalised": normalised}}


def _remedy(split: bool, extension: float) -> Settings:
    return {"in_band": {"dynamic_split": split, "extension": extension}}


# By the name that its arms' names begin with.
ABLATIONS: dict[str, Ablation] = {
    "summary": _one(
        "behaviour summary", SEEN_OR_NOT, "behavior.summary",
        {"dft": "dft", "mean": "mean_rate", "rms": "rms_rate"},
    ),
    "signal": _one(
        "signal in the DFT", SEEN_OR_NOT, "behavior.signal",
        {"rates": "body_rates", "attitude": "attitude"},
    ),
    "difference": _one(
        "difference of coefficients", SEEN_OR_NOT, "behavior.difference",
        {"complex": "complex", "magnitude": "magnitude"},
    ),
    "clamp": Ablation(
        "clamp of Eq. 2", SEEN_OR_NOT,
        {
            "none": _clamp(False),
            "degrees": _clamp(True),
            "radians": _clamp(True, "radians"),
            "normalised": _clamp(True, normalised=True),
        },
    ),
    "pose": _one(
        "models' fins while exploring", SEEN_OR_NOT, "exploration.pose",
        {"zero": "zero", "random": "common_random"},
    ),
    "disputants": _one(
        "M of Eq. 1", SEEN_OR_NOT, "exploration.best_models", {"all": None, "10": 10, "5": 5}
    ),
    "disputants-of-many": _one(
        "M of Eq. 1", ("out-of-band-100",), "exploration.best_models",
        {"all": None, "25": 25, "5": 5},
    ),
    "between-rounds": _one(
        "between rounds", SEEN_OR_NOT, "estimation.carry_over",
        {"continue": "continue", "reseed": "reseed"},
    ),
    "recombination": Ablation(
        "crossover, elites, coding", SEEN_OR_NOT,
        {
            f"{coding}-{kind.replace('_', '-')}": {"genetic": {"coding": coding, "crossover": kind}}
            for coding in ("gray", "binary")
            for kind in ("uniform", "two_point")
        },
    ),
    "elites": _one(
        "crossover, elites, coding", SEEN_OR_NOT, "genetic.elites",
        {"none": 0, "one": 1, "three": 3},
    ),
    # A gene is one bit, or a whole variable, which redrawn would change about 2.5 bits.
    "mutations": _one(
        "one gene per genome", SEEN_OR_NOT, "genetic.mutations",
        {"half": 0.5, "bit": 1.0, "variable": 2.5},
    ),
    "k-best-by": _one(
        "In-Band's K best", ("in-band",), "in_band.rank_by",
        {"newest": "newest", "overall": "overall"},
    ),
    "k": _one(
        "In-Band's K best", ("in-band",), "in_band.k", {"1": 1, "2": 2, "3": 3, "5": 5, "8": 8}
    ),
    "arcs": _one(
        "In-Band's ranges", ("in-band",), "in_band.inclusion",
        {"circular": "circular", "linear": "linear"},
    ),
    "remedies": Ablation(
        "In-Band's remedies", ("in-band",),
        {
            "neither": _remedy(False, 0.0),
            "split": _remedy(True, 0.0),
            "wider": _remedy(False, 0.2),
            "both": _remedy(True, 0.2),
        },
    ),
    "optang-effort": Ablation(
        "optAng", ("out-of-band",),
        {
            f"{poses}x{generations}": {
                "out_of_band": {"inner_population": poses, "inner_generations": generations}
            }
            for poses, generations in ((25, 25), (10, 25), (50, 25), (25, 10), (25, 50))
        },
    ),
    # Whether a round's second and third inference begin with the pose of the one before.
    "warm-start": _one(
        "optAng", ("out-of-band",), "out_of_band.warm_start", {"no": False, "yes": True}
    ),
    "judges": _one(
        "a pose's fitness", ("out-of-band",), "out_of_band.sampled_models",
        {"all": None, "5": 5, "1": 1},
    ),
    "verdict": _one(
        "a pose's fitness", ("out-of-band", "out-of-band-100"), "out_of_band.pose_fitness",
        {"mean": "mean", "best": "best"},
    ),
    "revisit": _one(
        "earlier trials' angles", ("out-of-band", "out-of-band-100"), "out_of_band.revisit",
        {"0": 0, "1": 1, "5": 5},
    ),
}  # fmt: skip


def with_settings(config: EEAConfig, settings: Settings) -> EEAConfig:
    """Return a configuration with some fields of its parts replaced."""
    parts = {part: replace(getattr(config, part), **dict(s)) for part, s in settings.items()}
    return replace(config, **parts)


def ablation_arms(names: Iterable[str] = ABLATIONS) -> dict[str, EEAConfig]:
    """Return the settings of every arm of some ablations, the baselines first and once each.

    Arms are called as ``"baseline-ideal"`` and ``"difference-magnitude-ideal"``.

    Raises
    ------
    ConfigurationError
        If a name is not one of ``ABLATIONS``.
    """
    found: dict[str, EEAConfig] = {}
    needed = set()
    for name in names:
        choice("ablation", name, ABLATIONS)
        for condition in ABLATIONS[name].conditions:
            needed.add(condition)
            for answer, settings in ABLATIONS[name].answers.items():
                config = with_settings(BASELINES[condition], settings)
                if config != BASELINES[condition]:
                    found[f"{name}-{answer}-{condition}"] = config
    return {f"baseline-{c}": BASELINES[c] for c in BASELINES if c in needed} | found
