"""The choices that the paper leaves open, as arms of a study that can settle them.

Each ``Ablation`` asks one question and lists every answer as settings, the default's among them.
An *arm* is one answer under one condition, all else as in that condition's baseline. Arms share
the baselines, and the angles that the target hides are the same in all of them, so differences
between an arm and its baseline are paired by seed.

Answers are listed whether or not they are the default, so that a default can change without this
table: the answer that equals a baseline makes no arm, for the baseline is its measurement.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

Settings = Mapping[str, Mapping[str, Any]]  # part of EEAConfig -> field -> value

STEPS = 256

# Condition -> the figure whose settings it has.
BASELINES: dict[str, str] = {
    "ideal": "fig5",
    "none": "fig6",
    "in-band": "fig7",
    "out-of-band": "fig9",
    "out-of-band-100": "fig10",
}


@dataclass(frozen=True)
class Ablation:
    """One question that the paper leaves open, and its possible answers.

    Attributes
    ----------
    name
        Begins the names of its arms.
    row
        Where ``docs/paper_map.md`` speaks of it: the first cell of a row.
    question
        In one sentence.
    conditions
        Under which it is measured, keys of ``BASELINES``: those that it matters for.
    answers
        Settings by a short name. All answers of a question set the same fields.
    """

    name: str
    row: str
    question: str
    conditions: tuple[str, ...]
    answers: Mapping[str, Settings]


@dataclass(frozen=True)
class Elsewhere:
    """A choice that no ``EEAConfig`` holds: where it is made, and why there is no arm for it."""

    row: str
    symbol: str
    reason: str


SEEN_OR_NOT = ("ideal", "out-of-band")  # one condition without hidden angles, one with


def _one(part: str, field: str, values: Mapping[str, Any]) -> dict[str, Settings]:
    """Return the answers that are one field's values."""
    return {name: {part: {field: value}} for name, value in values.items()}


_TABLE = (
    Ablation(
        "summary",
        "behaviour summary",
        "Do the mean or the RMS angular velocity tell as much as the DFT?",
        SEEN_OR_NOT,
        _one("behavior", "summary", {"dft": "dft", "mean": "mean_rate", "rms": "rms_rate"}),
    ),
    Ablation(
        "signal",
        "signal in the DFT",
        "Is the transform that of the attitude or that of the gyroscope's rates?",
        SEEN_OR_NOT,
        _one("behavior", "signal", {"rates": "body_rates", "attitude": "attitude"}),
    ),
    Ablation(
        "difference",
        "difference of coefficients",
        "Is |c - c'| of Eq. 2 that of complex numbers or that of their magnitudes?",
        SEEN_OR_NOT,
        _one("behavior", "difference", {"complex": "complex", "magnitude": "magnitude"}),
    ),
    Ablation(
        "clamp",
        "clamp of Eq. 2",
        "Is a coefficient's difference counted as MAX at most, and in which unit?",
        SEEN_OR_NOT,
        {
            name: {"behavior": {"clamp": clamp, "unit": unit, "normalised": normalised}}
            for name, clamp, unit, normalised in (
                ("none", False, "degrees", False),
                ("degrees", True, "degrees", False),
                ("radians", True, "radians", False),
                ("normalised", True, "degrees", True),
            )
        },
    ),
    Ablation(
        "pose",
        "models' fins while exploring",
        "Where do the models' fins begin while an action is sought?",
        SEEN_OR_NOT,
        _one("exploration", "pose", {"zero": "zero", "random": "common_random"}),
    ),
    Ablation(
        "disputants",
        "M of Eq. 1",
        "Do all 25 models enter the disagreement, or the fittest?",
        SEEN_OR_NOT,
        _one("exploration", "best_models", {"all": None, "10": 10, "5": 5}),
    ),
    Ablation(
        "disputants-of-many",
        "M of Eq. 1",
        "Do all 100 models enter the disagreement, or the fittest?",
        ("out-of-band-100",),
        _one("exploration", "best_models", {"all": None, "25": 25, "5": 5}),
    ),
    Ablation(
        "between-rounds",
        "between rounds",
        "Does the population of models live on in the next round?",
        SEEN_OR_NOT,
        _one("estimation", "carry_over", {"continue": "continue", "reseed": "reseed"}),
    ),
    Ablation(
        "recombination",
        "crossover, elites, coding",
        "Which crossover, and which coding?",
        SEEN_OR_NOT,
        {
            f"{coding}-{kind.replace('_', '-')}": {"genetic": {"coding": coding, "crossover": kind}}
            for coding in ("gray", "binary")
            for kind in ("uniform", "two_point")
        },
    ),
    Ablation(
        "elites",
        "crossover, elites, coding",
        "How many of the best pass on unchanged?",
        SEEN_OR_NOT,
        _one("genetic", "elites", {"none": 0, "one": 1, "three": 3}),
    ),
    Ablation(
        "mutations",
        "one gene per genome",
        "Is a gene one bit, or a whole variable, which redrawn would change about 2.5 bits?",
        SEEN_OR_NOT,
        _one("genetic", "mutations", {"half": 0.5, "bit": 1.0, "variable": 2.5}),
    ),
    Ablation(
        "k-best-by",
        "In-Band's K best",
        "Are the K best models those that fit the newest experiment or those that fit all?",
        ("in-band",),
        _one("in_band", "rank_by", {"newest": "newest", "overall": "overall"}),
    ),
    Ablation(
        "k",
        "In-Band's K best",
        "Is K = 3 the best here too?",
        ("in-band",),
        _one("in_band", "k", {"1": 1, "2": 2, "3": 3, "5": 5, "8": 8}),
    ),
    Ablation(
        "arcs",
        "In-Band's ranges",
        "Is the range of some angles an arc of the circle or an interval?",
        ("in-band",),
        _one("in_band", "inclusion", {"circular": "circular", "linear": "linear"}),
    ),
    Ablation(
        "remedies",
        "In-Band's remedies",
        "Do the dynamic split and the wider range help, alone or, as the text may mean, together?",
        ("in-band",),
        {
            name: {"in_band": {"dynamic_split": split, "extension": extension}}
            for name, split, extension in (
                ("neither", False, 0.0),
                ("split", True, 0.0),
                ("wider", False, 0.2),
                ("both", True, 0.2),
            )
        },
    ),
    Ablation(
        "optang-effort",
        "optAng",
        "How many poses does optAng evolve, and for how many generations?",
        ("out-of-band",),
        {
            f"{poses}x{generations}": {
                "out_of_band": {"inner_population": poses, "inner_generations": generations}
            }
            for poses, generations in ((25, 25), (10, 25), (50, 25), (25, 10), (25, 50))
        },
    ),
    Ablation(
        "warm-start",
        "optAng",
        "Does a round's second and third inference begin with the pose of the one before?",
        ("out-of-band",),
        _one("out_of_band", "warm_start", {"no": False, "yes": True}),
    ),
    Ablation(
        "judges",
        "a pose's fitness",
        "Do all models judge a pose, or some drawn at random?",
        ("out-of-band",),
        _one("out_of_band", "sampled_models", {"all": None, "5": 5, "1": 1}),
    ),
    Ablation(
        "verdict",
        "a pose's fitness",
        "Does a pose score the mean of its judges or the best of them?",
        ("out-of-band", "out-of-band-100"),
        _one("out_of_band", "pose_fitness", {"mean": "mean", "best": "best"}),
    ),
    Ablation(
        "revisit",
        "earlier trials' angles",
        "What would it bring to infer the angles of earlier experiments anew?",
        ("out-of-band", "out-of-band-100"),
        _one("out_of_band", "revisit", {"0": 0, "1": 1, "5": 5}),
    ),
)

ABLATIONS: dict[str, Ablation] = {ablation.name: ablation for ablation in _TABLE}

ELSEWHERE = (
    Elsewhere(
        "attitude past the vertical",
        "aquafish_gym.imu.continue_attitude",
        "Both triples are the same attitude; any rule but continuity puts jumps into the transform "
        "that depend on the axes' names and not on the body.",
    ),
    Elsewhere(
        "what is randomised before an action",
        "eea.aquafish.EngineTarget",
        "A setting of the target, `orientation`. Still water knows no direction, so the gyroscope "
        "feels the same; in a log of the world's attitude a heading adds a constant to yaw, which "
        "is one coefficient, and a full attitude changes all three signals.",
    ),
    Elsewhere(
        "the first action",
        "eea.core.exploration.Exploration.first",
        "One of 25 experiments. The models are random before it, so Eq. 1 could only ask which "
        "action tells random bodies apart.",
    ),
    Elsewhere(
        "generations 0, 35, 70",
        "eea.core.inference.OutOfBandConfig",
        "The text names the three generations; the pseudocode's count from 1 would never infer at "
        "the first, and would leave the fins of generations 1 to 34 unsaid.",
    ),
    Elsewhere(
        "decoding",
        "eea.core.bits.BitLayout.decode",
        "The text gives bits and ranges, and ranges are closed. What the other decoding could "
        "represent is a matter of arithmetic and needs no run.",
    ),
    Elsewhere(
        "models' precision",
        "eea.aquafish.EngineSimulator",
        "A setting of the simulator, `dtype`; the paper names no precision.",
    ),
    Elsewhere(
        "NEAT's inputs and outputs",
        "gait.evolve.EvolveConfig",
        "The gait's, after the EEA has ended.",
    ),
)
