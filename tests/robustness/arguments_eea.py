"""The algorithms for any robot, with arguments with which they work."""

from __future__ import annotations

from typing import Any

import numpy as np
from strange_values import CALLABLE, Call, options

from eea import (
    EEA,
    FIGURES,
    BitLayout,
    FitConfig,
    Hypothesis,
    JointConfig,
    JointInference,
    Number,
    PaperConfig,
    Problem,
    RecordedLog,
    Robot,
    Simulator,
    Trial,
    Trials,
    Variable,
    action_layout,
    config_for,
    figure_config,
    model_layout,
    one_by_one,
    recovery_config,
    streams,
)
from eea.core.config import (
    EstimationConfig,
    ExplorationConfig,
    GeneticConfig,
    InBandConfig,
    OutOfBandConfig,
)
from eea.fish.simulator_error import Calibration, Discrepancy
from eea.infer.fit import fit
from eea.infer.statement import Part, Prior
from eea.infer.trials import Observed

LENGTH = Variable("length", 2, 0.0, 3.0)
LAYOUT = BitLayout([LENGTH])
PENDULUM = Problem(LAYOUT, action_layout([("torque", -1.0, 1.0)]), ("angle",), 1)


def swing(values: Any, commands: Any) -> Any:
    """Simulate a pendulum."""
    phase = commands[:, :1] * 0.01 * np.arange(1, 65) + values["angle"][:, None]
    return (values[LENGTH.name][:, None] * np.sin(phase))[:, :, None]


def stretch(values: Any, pull: Any) -> Any:
    """Simulate a spring."""
    return (values["stiffness"][:, None] * pull)[:, :, None]


def listen(*_news: object) -> None:
    """Hear of progress."""


class Pendulum(Simulator):
    """A pendulum, as target and as simulator."""

    def perform(self, command: Any) -> RecordedLog:
        """Perform a command."""
        values = {LENGTH.name: np.ones(1), "angle": np.zeros(1)}
        return RecordedLog(swing(values, command[None]))

    def simulate(self, trials: Trials) -> RecordedLog:
        """Run trials."""
        values = {LENGTH.name: trials.models[:, 0], "angle": trials.angles[:, 0]}
        return RecordedLog(swing(values, trials.commands))


SWINGING = Robot(
    swing,
    {LENGTH.name: Number(0.0, 3.0), "bias": Number(0.0, sd=0.05), "angle": Number.angle()},
    {"gyro": "rad/s"},
)
RECORDED = Trial(np.zeros((64, 1)), [1.0])
SETTINGS = {
    "nuisances": ("lag",), "noise": 0.01, "alternatives": "never", "bodies": 3,
    "poses": 3, "descents": 2, "polished": 1, "restarts": 0, "evaluations": 9, "seconds": 60.0,
}  # fmt: skip
#: A robot that is answered, learned and followed: a number with hidden names and a hypothesis.
SPRING = Robot(stretch, {"stiffness": Number(1.0, 9.0, healthy=4.0)}, {"force": "N"})
SOFT = Robot(stretch, {"stiffness": Number(1.0, 9.0)}, {"force": "N"}, hypotheses=())
PULL = np.sin(np.arange(40.0))
PULLED = [
    Trial((4.0 * PULL + np.random.default_rng(i).normal(0.0, 0.1, 40))[:, None], PULL)
    for i in range(2)
]
EFFORT = FitConfig(alternatives="always", bodies=2, poses=1, descents=1, polished=1, restarts=0)
BELIEF = SPRING.infer(PULLED, config=EFFORT)
REFERENCE = SOFT.learn(PULLED, config=EFFORT)
FOLLOWER = SOFT.follow({"force": 0.1})
QUICK = PaperConfig(condition="none", steps=64, rounds=1)
NAMES = "empty list, list of text"
NOISE = {"nuisances": "none", "noise": "none, fraction, big", "evaluations": "none"}
NOISE |= {"seconds": "none, fraction, big"}
ROWS = [
    Call(
        Variable,
        {"name": "length", "bits": 2, "low": 0.0, "high": 3.0, "periodic": False},
        options(
            name="text", low="fraction, minus one", high="fraction, big", periodic="true",
        ),
        {"low": "length"},
    ),
    Call(BitLayout, {"variables": [LENGTH]}),
    Call(LAYOUT.decode, {"genomes": [[0, 1]]}),
    Call(LAYOUT.encode, {"values": [[1.0]]}),
    Call(LAYOUT.random, {"count": 1, "rng": np.random.default_rng(0)}),
    Call(model_layout, {"table": [("length", 2.0, 6)]}),
    Call(action_layout, {"table": [("torque", -1.0, 1.0)]}),
    Call(
        Problem,
        {"models": LAYOUT, "actions": LAYOUT, "hidden": ("angle",), "axes": 1, "fastest": 9.0},
        options(fastest="fraction, infinity, big"),
    ),
    Call(ExplorationConfig, {"population": 2, "generations": 1, "initial_angles": "zero"}),
    Call(EstimationConfig, {"population": 2, "generations": 1}),
    Call(
        GeneticConfig,
        {
            "coding": "gray", "crossover": "uniform", "crossover_rate": 0.5, "mutations": 1.0,
            "elites": 1,
        },
        options(crossover_rate="fraction", mutations="fraction, big"),
    ),
    Call(
        InBandConfig,
        {"best": 1, "confidence": 0.5, "dynamic_split": False, "extension": 0.0},
        options(confidence="fraction", dynamic_split="true", extension="fraction"),
    ),
    Call(
        OutOfBandConfig,
        {
            "period": 1, "inner_population": 2, "inner_generations": 1, "sampled_models": 1,
            "revisit": 0,
        },
        options(sampled_models="none"),
    ),
    Call(
        PaperConfig,
        {
            "condition": "ideal", "steps": 64, "rounds": 1, "exploration": ExplorationConfig(),
            "estimation": EstimationConfig(), "genetic": GeneticConfig(),
            "in_band": InBandConfig(), "out_of_band": OutOfBandConfig(),
        },
    ),
    Call(FitConfig, SETTINGS, options(**NOISE), {"bodies": "bodies"}),
    Call(
        JointConfig,
        {**SETTINGS, "steps": 64, "rounds": 1, "max_interval_width": 0.1},
        options(**NOISE, max_interval_width="none, fraction"),
        {"bodies": "bodies"},
    ),
    Call(config_for, {"condition": "joint", "rounds": 3}),
    Call(recovery_config, {"steps": 64, "rounds": 1}),
    Call(
        figure_config,
        {"name": next(iter(FIGURES)), "steps": 64, "rounds": 1},
        words={"name": "figure"},
    ),
    Call(streams, {"seed": 0}),
    Call(
        EEA,
        {
            "target": Pendulum(), "simulator": Pendulum(), "problem": PENDULUM,
            "config": PaperConfig(condition="none", steps=64), "seed": 0, "truth": [1.0],
        },
        options(truth="none"),
        {"target": "target"},
    ),
    Call(
        EEA(Pendulum(), Pendulum(), PENDULUM, QUICK).run,
        {"progress": listen},
        options(progress=f"none, {CALLABLE}"),
    ),
    Call(
        JointInference,
        {
            "target": Pendulum(), "robot": SWINGING, "problem": PENDULUM,
            "config": JointConfig(steps=64), "seed": 0,
            "truth": [1.0],
        },
        options(truth="none"),
        {"target": "target"},
    ),
    Call(one_by_one, {"simulate": listen}, options(simulate=CALLABLE)),
    Call(
        Hypothesis,
        {
            "name": "the servo is dead", "fixed": {"servo": 0.0},
            "moves": {"length": Number(0.0, sd=1.0), "angle": Number.angle(varies=False)},
            "part": "tail", "changes": 1, "odds": 1.0, "hint": "swim",
        },
        options(
            name="text", fixed="mapping, empty mapping", part="text, empty text",
            odds="fraction, big", moves="empty mapping", hint="text, empty text",
        ),
    ),
    Call(
        Part,
        {"sizes": {"length": "length"}, "area": ("length", "width"), "hint": "swim"},
        options(sizes="empty mapping", area=NAMES, hint="text, empty text"),
    ),
    Call(
        Prior,
        {"names": ("length",), "mean": np.zeros(1), "covariance": np.eye(1)},
        options(names=NAMES),
    ),
    Call(
        Discrepancy,
        {
            "share": 0.01, "duration": 20.0, "shapes": None, "calibration": None, "assumed": (),
            "assumed_shapes": None,
        },
        options(
            share="fraction", duration="fraction, big", shapes=f"none, {CALLABLE}",
            calibration="none", assumed="empty list", assumed_shapes="none",
        ),
    ),
    Call(Calibration, {"levels": (0.01, 0.1), "rows": ((0.8, 0.9), (1.0, 0.7))}),
    Call(
        Number,
        {
            "low": -3.0, "high": 3.0, "mean": 0.0, "sd": 1.0, "unit": "m", "healthy": None,
            "varies": False, "circular": False, "group": "", "switch": False, "valleys": 0,
        },
        options(
            mean="minus one, fraction, big, none", sd="fraction, infinity, big",
            low="minus one, fraction", high="minus one, fraction, big, infinity",
            unit="text, empty text", healthy="none, minus one, fraction", group="text, empty text",
            varies="true", switch="true",
        ),
    ),
    Call(
        Trial,
        {"signal": np.zeros((4, 1)), "inputs": np.zeros(2), "remarks": ()},
        options(
            inputs="none, minus one, fraction, big, empty list, cube",
            remarks="empty list, list of text",
        ),
    ),
    Call(
        Robot,
        {
            "simulate": swing, "numbers": {"length": Number(0.0, 3.0), "angle": Number.angle()},
            "channels": {"gyro": "rad/s"}, "hypotheses": (), "at_once": 1, "parts": {},
            "nominal": Hypothesis("all is well"), "prior": None, "discrepancy": None, "stride": 1,
            "loudest": 1.0, "plan": None,
        },
        options(
            simulate=CALLABLE, hypotheses="none, empty list", parts="empty mapping", prior="none",
            discrepancy="none", loudest="fraction, big, infinity",
            plan="none, text, empty text, mapping, empty mapping",
        ),
    ),
    Call(
        SPRING.infer,
        {"trials": PULLED, "seed": 0, "config": EFFORT, "noise": None, "progress": listen},
        options(config="none", noise="none", progress=f"none, {CALLABLE}"),
    ),
    Call(
        SOFT.learn,
        {
            "known_good": PULLED, "sessions": None, "seed": 0, "config": EFFORT, "ongoing": None,
        },
        options(sessions="none, list of text, words", config="none", ongoing="none"),
    ),
    Call(
        SOFT.follow,
        {"noise": {"force": 0.1}, "alarm": 0.01, "drift": None, "seed": 0},
        options(alarm="fraction", drift="none, empty mapping"),
    ),
    Call(FOLLOWER.update, {"window": PULLED[0]}),
    Call(FOLLOWER.table, {"mass": 0.9}, options(mass="fraction")),
    Call(
        REFERENCE.infer,
        {"trials": PULLED, "seed": 0, "config": EFFORT, "progress": listen},
        options(config="none", progress=f"none, {CALLABLE}"),
    ),
    Call(
        REFERENCE.test,
        {"log": PULLED[0], "seed": 0, "alarm": 0.01},
        options(alarm="fraction"),
    ),
    Call(BELIEF.sample, {"count": 1, "rng": np.random.default_rng(0)}),
    Call(BELIEF.interval, {"mass": 0.9}, options(mass="fraction")),
    Call(BELIEF.probability, {"hypothesis": "nothing is broken"}),
    Call(BELIEF.broken, {"name": "stiffness", "mass": 0.9}, options(mass="fraction")),
    Call(
        BELIEF.table,
        {"mass": 0.9, "hypothesis": None},
        options(mass="fraction", hypothesis="none"),
    ),
    Call(BELIEF.prospects, {"trials": {"pull": PULLED[0]}}),
    Call(BELIEF.angles, {"trial": 0, "mass": 0.9}, options(mass="fraction")),
    Call(
        fit,
        {
            "observed": Observed(np.zeros((1, 1)), np.zeros((1, 64, 1))), "robot": SWINGING,
            "config": FitConfig(bodies=2, descents=1, polished=1, restarts=0),
            "rng": np.random.default_rng(0), "earlier": None, "progress": listen, "doubt": None,
            "usual": None, "samples": 0,
        },
        options(
            earlier="none", progress=f"none, {CALLABLE}", doubt=f"none, {CALLABLE}",
            usual="none", samples="big, huge",
        ),
    ),
]  # fmt: skip
