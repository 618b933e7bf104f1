"""The functions of the fish's inference, with arguments with which they work."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from strange_values import (
    CALLABLE,
    NO_BODY,
    NO_DAMAGE,
    Call,
    options,
)

import eea
from aquafish_gym import Morphology, simulate
from aquafish_gym.plans import AQUAFISH
from eea import (
    EngineSimulator,
    EngineTarget,
    JointConfig,
    RealityGap,
    SwimLog,
    Trials,
    check_log,
    estimate_morphology,
    estimate_morphology_of,
    fins_after,
    fish_eea,
    infer_changes,
    infer_log,
    known_body,
    load_posterior,
    read_log,
    read_trials,
    save_posterior,
    watch_swim,
    write_log,
)
from eea.core.config import FitConfig
from eea.fish.estimate import MorphologyEstimate

COMMANDS = [(0.5, -0.5, 1.0), (-0.5, 0.4, 0.7)]
LOG = SwimLog.of_trials(COMMANDS, [simulate(None, u, steps=64) for u in COMMANDS])
BODY = Morphology.nominal()
SWIM = Path(__file__).parents[2] / "examples" / "logs" / "swim.csv"
BELIEF = known_body(BODY, 0.01)
TARGET = EngineTarget(steps=64, engine="numba")
SIMULATOR = EngineSimulator(steps=64)
CONFIG = JointConfig(steps=64, rounds=1)
WORLD = {
    "engine": "numba", "dtype": "float32", "current": np.zeros(3), "substeps": 1, "threads": 1,
    "reactive": False,
}  # fmt: skip
SETTINGS = {"config": CONFIG, "seed": 0}


def listen(*_news: object) -> None:
    """Hear of progress."""


FIT: dict[str, Any] = {
    "nuisances": ("lag",), "noise": 0.01, "alternatives": "never", "bodies": 3,
    "poses": 3, "descents": 2, "polished": 1, "restarts": 0,
}  # fmt: skip
ESTIMATE = MorphologyEstimate(CONFIG, 0, eea.fish_problem().models, belief=BELIEF)


def read_rate(
    path: Any, channels: Any, step: Any, between: Any, split_gap: Any, longest_hold: Any,
    interpolate: Any, rate: Any,
) -> object:  # fmt: skip
    """Read trials, whose columns are any keywords."""
    return read_trials(
        path, channels, step=step, between=between, split_gap=split_gap, longest_hold=longest_hold,
        interpolate=interpolate, rate=rate, trial="trial",
    )  # fmt: skip


read_rate.__qualname__ = "read_trials"
ROWS = [
    Call(
        EngineTarget,
        {
            "morphology": BODY, "damage": "none", "rng": np.random.default_rng(0), "steps": 64,
            "engine": "numba", "current": np.zeros(3), "substeps": 1, "gap": RealityGap(),
            "plan": AQUAFISH, "reactive": False,
        },
        options(
            morphology=NO_BODY, damage=NO_DAMAGE, rng="none", plan="none", reactive="true"
        ),
    ),
    Call(TARGET.perform, {"command": np.zeros(3)}),
    Call(
        EngineSimulator,
        {"steps": 64, **WORLD, "plan": AQUAFISH},
        options(threads="none", dtype="none", reactive="true"),
    ),
    Call(eea.fish_problem, {"plan": AQUAFISH}),
    Call(
        SIMULATOR.simulate,
        {"trials": Trials(np.full((1, 9), 0.3), np.full((1, 3), 0.4), np.zeros((1, 3)))},
    ),
    Call(SIMULATOR.comparer, {"steps": 64}, options(steps="big, huge")),
    Call(
        RealityGap,
        {
            "current": np.zeros(3), "drag": (1.0, 1.0), "servo_gain": np.ones(3), "lag": 0.0,
            "reactive": False, "substeps": 1, "gyro_noise": 0.0, "gyro_bias": np.zeros(3),
        },
        options(
            gyro_noise="fraction", reactive="true", lag="fraction", servo_gain="fraction, minus one"
        ),
    ),
    Call(
        SwimLog,
        {
            "time": LOG.time, "gyro": LOG.gyro, "commands": LOG.commands, "trial": LOG.trial,
            "remarks": (), "plan": AQUAFISH,
        },
        options(remarks="empty list, list of text, words"),
    ),
    Call(
        SwimLog.of_trials,
        {
            "commands": COMMANDS, "logs": [simulate(None, u, steps=64) for u in COMMANDS],
            "moving": False, "plan": AQUAFISH,
        },
        options(moving="true"),
    ),
    Call(LOG.name, {"index": 0}),
    Call(write_log, {"path": "swim.csv", "log": LOG}, options(path="text")),
    Call(
        read_log,
        {"path": SWIM, "columns": None, "between": None, "plan": AQUAFISH},
        options(columns="none, empty mapping", between="none"),
        words={"path": "log"},
    ),
    Call(
        read_rate,
        {
            "path": SWIM, "channels": {"rate": "rad/s"}, "step": 0.01, "between": None,
            "split_gap": 1.0, "longest_hold": 1.0, "interpolate": (),
            "rate": "gyro_z",
        },
        options(
            step="none, fraction, big", between="none", split_gap="fraction, infinity, big",
            longest_hold="none, fraction, infinity, big", interpolate="none, empty list",
        ),
        words={"path": "log"},
    ),
    Call(save_posterior, {"path": "posterior.npz", "belief": BELIEF}, options(path="text")),
    Call(load_posterior, {"path": "posterior.npz"}, words={"path": "posterior"}),
    Call(
        known_body,
        {"body": BODY, "noise": 0.01, "nuisances": ("lag",)},
        options(noise="fraction, big", nuisances="none, empty list"),
        {"body": "body"},
    ),
    Call(
        infer_log,
        {
            "log": LOG, "joint": FitConfig(**FIT), "seed": 0, "truth": BODY, "moving": False,
            "check": False, "progress": listen, **WORLD,
        },
        options(
            truth=NO_BODY, moving="true", check="true", progress=f"none, {CALLABLE}",
            joint="none", threads="none", dtype="none", reactive="true",
        ),
        {"truth": "morpholog"},
    ),
    Call(
        infer_changes,
        {
            "log": LOG, "belief": BELIEF, "joint": FitConfig(**{**FIT, "noise": None}), "seed": 0,
            "progress": listen, **WORLD,
        },
        options(
            progress=f"none, {CALLABLE}", joint="none", threads="none", dtype="none",
            reactive="true",
        ),
    ),
    Call(
        check_log,
        {
            "log": LOG, "joint": FitConfig(**FIT), "seed": 0, "moving": False, "unexplained": 0.5,
            "progress": listen, **WORLD,
        },
        options(
            joint="none", unexplained="none, fraction", moving="true",
            progress=f"none, {CALLABLE}", threads="none", dtype="none", reactive="true",
        ),
    ),
    Call(
        watch_swim,
        {
            "log": LOG, "belief": BELIEF, "alarm": 1e-6, "seed": 0, "until_noticed": True,
            "progress": listen, **WORLD,
        },
        options(
            alarm="fraction", until_noticed="true", progress=f"none, {CALLABLE}",
            threads="none", dtype="none", reactive="true",
        ),
    ),
    Call(
        fish_eea,
        {"target": TARGET, **SETTINGS, "truth": BODY, "plan": AQUAFISH, **WORLD},
        options(
            config="none", truth=NO_BODY, threads="none", dtype="none", reactive="true",
            plan="none",
        ),
        {"target": "target", "truth": "morpholog"},
    ),
    Call(
        estimate_morphology_of,
        {
            "target": TARGET, **SETTINGS, "progress": listen, "truth": BODY, "plan": AQUAFISH,
            **WORLD,
        },
        options(
            config="none", progress=f"none, {CALLABLE}", truth=NO_BODY, threads="none",
            dtype="none", reactive="true", plan="none",
        ),
        {"target": "target", "truth": "morpholog"},
    ),
    Call(
        estimate_morphology,
        {
            "target_morphology": BODY, "damage": "none", **SETTINGS, "progress": listen,
            "target_engine": "numba", "plan": AQUAFISH, **WORLD,
        },
        options(
            target_morphology=NO_BODY, damage=NO_DAMAGE, config="none",
            progress=f"none, {CALLABLE}", threads="none", dtype="none", reactive="true",
            plan="none",
        ),
        {"target_morphology": "morpholog", "target_engine": "engine"},
    ),
    Call(fins_after, {"result": ESTIMATE}),
    Call(ESTIMATE.interval, {"mass": 0.9}, options(mass="fraction")),
    Call(ESTIMATE.width, {"mass": 0.9}, options(mass="fraction")),
    Call(ESTIMATE.sample, {"count": 1, "seed": 0}, options(seed="big, huge")),
    Call(BELIEF.interval, {"mass": 0.9}, options(mass="fraction")),
    Call(
        BELIEF.table, {"mass": 0.9, "hypothesis": None},
        options(mass="fraction", hypothesis="none"),
    ),
    Call(BELIEF.sample, {"count": 1, "rng": np.random.default_rng(0)}),
]  # fmt: skip
