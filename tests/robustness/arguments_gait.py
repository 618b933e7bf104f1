"""The public functions of gait, with arguments with which they work."""

from __future__ import annotations

from typing import Any

import numpy as np
from strange_values import (
    CALLABLE,
    NO_BODY,
    NO_DAMAGE,
    Call,
    options,
)

from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.world_config import WorldConfig
from gait import (
    Controller,
    EvolveConfig,
    damaged_at_random,
    distances,
    evaluate,
    evolve_gait,
    random_poses,
    scores,
    swim,
)
from gait.controllers.agents import ControllerAgent
from gait.controllers.export import export_c
from gait.controllers.export_model import export_model
from gait.controllers.network import Senses
from gait.learning.train import LearningConfig, dense_network, train
from gait.search.neat import genome_to_controller, load_config
from gait.swims.evaluation import interquartile_mean
from gait.swims.transfer import TransferConfig, swims_on, transfer

BODY = Morphology.nominal()
CONTROLLER = Controller(np.zeros((3, 14)), np.zeros(3), np.ones(3), 0.7, BODY, 0)
FINS = Controller(
    np.zeros((3, 20)), np.zeros(3), np.ones(3), 0.7, BODY, 0, senses=Senses(fins=True)
)
SMALL = EvolveConfig(generations=1, population=10, seconds=0.1, threads=1)
SWIM = {
    "seconds": 0.1,
    "world": WorldConfig(),
    "believed": np.zeros((1, 3)),
    "believed_gain": np.ones(3),
}
START = np.array([0.0] * 3 + [1.0] + [0.0] * 21)


def act(observations: Any) -> object:
    """Hold still."""
    return np.zeros((len(observations), 3))


def listen(_news: object) -> None:
    """Hear of a generation."""


def make_genome() -> Any:
    import random

    import neat

    config = load_config(10)
    config.genome_config.innovation_tracker = neat.InnovationTracker()
    genome, others = neat.DefaultGenome(1), random.getstate()
    genome.configure_new(config.genome_config)
    random.setstate(others)
    return genome


# "fraction" is a legal number, and a mapping without entries changes nothing in the nominal body.
SWUM = {
    "world": "none", "believed": "none", "believed_gain": "none", "seconds": "fraction",
}  # fmt: skip
ROWS = [
    Call(
        swim,
        {
            "controller": FINS, "morphology": BODY, "fin_angles": np.zeros(3), "engine": "numba",
            **SWIM, "believed": np.zeros(3), "interval": 5, "observe_fins": False,
            "damage": "none", "seed": 0,
        },
        options(
            controller=CALLABLE, morphology=NO_BODY, fin_angles="none", interval="none",
            damage=NO_DAMAGE, **SWUM,
        ),
    ),
    Call(
        scores,
        {
            "controllers": [FINS], "morphologies": BODY, "fin_angles": np.zeros((1, 3)), **SWIM,
            "task": "forward", "damage": "none", "seed": 0, "engine": "numba", "dtype": "float32",
            "threads": 1, "start": START, "penalize": True,
        },
        options(
            controllers="empty list", morphologies=NO_BODY, fin_angles="none", threads="none",
            start="none", damage=NO_DAMAGE, penalize="true", **SWUM,
        ),
    ),
    Call(
        distances,
        {
            "controllers": [CONTROLLER], "bodies": BODY, "poses": np.zeros((1, 3)), "seconds": 0.1,
            "threads": 1, "world": WorldConfig(),
        },
        options(
            controllers="empty list", bodies=NO_BODY, poses="none", threads="none", world="none",
            seconds="fraction",
        ),
    ),
    Call(
        evolve_gait,
        {
            "morphologies": BODY, "config": SMALL, "first": CONTROLLER, "start": START,
            "out": None, "world": WorldConfig(), "cpu_seconds": 1.0, "on_generation": listen,
        },
        options(
            morphologies=NO_BODY, config="none", first="none", start="none",
            out="none, text, empty text", world="none", cpu_seconds="none, fraction",
            on_generation="none, type, function",
        ),
    ),
    Call(
        evaluate,
        {"agent": act, "env": "AquaFish-v0", "episodes": 1, "seed": 0},
        options(agent=CALLABLE, episodes="none"),
    ),
    Call(interquartile_mean, {"runs": [[1.0, 2.0]], "seed": 0}),
    Call(random_poses, {"count": 1, "seed": 0, "plan": AQUAFISH}),
    Call(
        damaged_at_random,
        {"body": BODY, "count": 1, "seed": 0},
        options(body=NO_BODY),
    ),
    Call(
        transfer,
        {
            "controller": CONTROLLER, "target": BODY,
            "config": TransferConfig(poses=1, seconds=0.1, target_engine="numba"), "native": BODY,
            "world": WorldConfig(), "observe_fins": False, "native_world": WorldConfig(),
        },
        options(
            controller=CALLABLE, target=NO_BODY, config="none",
            native=NO_BODY, world="none", native_world="none",
        ),
    ),
    Call(
        swims_on,
        {
            "controller": FINS, "morphology": BODY, "poses": np.zeros((1, 3)), "engine": "numba",
            "seconds": 0.1, "world": WorldConfig(), "angle_error": np.zeros(3),
            "believed_gain": np.ones(3), "observe_fins": False,
        },
        options(
            controller=CALLABLE, morphology=NO_BODY, seconds="fraction", world="none",
            believed_gain="none",
        ),
    ),
    Call(
        TransferConfig,
        {
            "poses": 1, "seed": 0, "seconds": 0.1, "native_engine": "numba",
            "target_engine": "numba", "angle_error": (0.0,) * 3, "believed_gain": (1.0,) * 3,
        },
        options(seconds="fraction"),
    ),
    Call(
        EvolveConfig,
        {
            "seed": 0, "search": "cma", "paper": False, "controller": "mlp", "senses": ("clock",),
            "task": "forward", "plan": AQUAFISH, "interval": 5, "hidden": 3, "harmonics": 1,
            "restarts": 1,
            "generations": 1, "random_candidates": 9, "cma_generations": None, "population": 10,
            "poses": 1, "clock": 0.7, "seconds": 1.0, "threads": 1,
        },
        options(
            search="none", controller="none", hidden="none", harmonics="none", restarts="none",
            generations="none", random_candidates="none", cma_generations="none",
            population="none", clock="none, fraction", seconds="fraction", threads="none",
        ),
    ),
    Call(
        LearningConfig,
        {"steps": 1, "environments": 1, "interval": 20, "senses": ("imu",), "task": "forward",
         "plan": AQUAFISH, "reactive": False, "seed": 0},
        options(reactive="true"),
    ),
    Call(
        train,
        {
            "morphologies": BODY, "config": LearningConfig(steps=1, environments=1),
            "damage": "none", "out": None, "on_epoch": listen,
        },
        options(
            morphologies=NO_BODY, config="none",
            damage=NO_DAMAGE, out="none, text, empty text", on_epoch="none, type, function",
        ),
    ),
    Call(
        Controller,
        {
            "weights": np.zeros((3, 14)), "bias": np.zeros(3), "response": np.ones(3),
            "clock": 0.7, "morphology": BODY, "seed": 0, "sample": "2 bodies",
            "senses": Senses(), "layers": (3,), "output": "tanh", "interval": 5,
        },
        options(clock="fraction", sample="none, text, empty text", layers="none"),
    ),
    Call(Controller.from_dict, {"data": CONTROLLER.to_dict()}, words={"data": "controller"}),
    Call(Controller.load, {"path": "controller.json"}, words={"path": "controller"}),
    Call(CONTROLLER.save, {"path": "controller.json"}, options(path="text")),
    Call(
        CONTROLLER.policy,
        {"fin_angles": np.zeros(3), "servo_gain": np.ones(3)},
        options(fin_angles="none", servo_gain="none"),
    ),
    Call(
        ControllerAgent,
        {"controller": CONTROLLER, "believed_gain": np.ones(3)},
        options(believed_gain="none"),
    ),
    Call(export_c, {"controller": CONTROLLER, "path": "fish.c"}, words={"path": "c must"}),
    Call(
        export_model,
        {"bodies": BODY, "path": "fish.c", "reactive": False},
        options(bodies=NO_BODY, reactive="true"),
        {"path": "model must"},
    ),
    Call(
        genome_to_controller,
        {
            "genome": make_genome(), "clock": 0.7, "morphology": BODY, "seed": 0,
            "senses": Senses(), "interval": 5, "config": load_config(10),
        },
        options(clock="fraction", senses="none", config="none"),
    ),
    Call(
        dense_network,
        {
            "layers": [(np.zeros((4, 2)), np.zeros(4)), (np.zeros((3, 4)), np.zeros(3))],
            "mean": np.zeros(2), "scale": np.ones(2), "plan": AQUAFISH,
        },
    ),
]  # fmt: skip
