"""The agent that models itself, with arguments with which its functions work."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np
from strange_values import Call, options

from aquafish.online import AgentConfig, SelfModelAgent
from aquafish.online.belief import SurpriseMonitor
from aquafish.online.calibration import ErrorCalibration
from aquafish.online.gaits import imagine, load_library
from aquafish.online.self_model import SelfModel, predict
from aquafish.online.teacher import Teacher, shapes_of
from aquafish_gym import Damage, Morphology
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.scenario import Scenario
from gait.film import filmed
from gait.swims.swim import swim

ROBOT = Scenario.create()
LIBRARY = load_library()[:1]
AGENT = SelfModelAgent(LIBRARY)
AGENT.begin(np.zeros(3))
MODEL = SelfModel(ROBOT, np.zeros(3))
STATE = MODEL.state
BODY = Morphology.nominal()


def add_to_calibration(action: Any, observed: Any) -> bool:
    """Add an action and an observation to a calibration that has just begun."""
    return ErrorCalibration(ROBOT, np.zeros(3), 20).add(action, observed)


ROWS = [
    Call(
        SelfModelAgent,
        {"library": LIBRARY, "config": AgentConfig(), "robot": ROBOT, "hold": 20, "teachers": ()},
        options(library="none", config="none", robot="none", teachers="none, empty list"),
    ),
    Call(AGENT.begin, {"fin_angles": np.zeros(3)}, options(fin_angles="none")),
    Call(AGENT.act, {"observation": np.zeros(9)}),
    Call(AGENT.reset, {"info": {"fin_angles": np.zeros(3)}}),
    Call(
        AgentConfig,
        {
            "seconds": 60.0, "gyro_noise": 0.0, "gyro_only": False, "inferences": (3,),
            "refinements": 1, "generations": 1, "teacher_generations": 1, "quick_generations": 1,
            "quick_teacher_generations": 1, "inference_seconds": 0.4, "refinement_seconds": 1.2,
            "both_seconds": 1.4, "quick_seconds": 0.4, "seed": 0,
        },
        options(
            seconds="fraction, big", gyro_noise="fraction, big", gyro_only="true",
            inferences="empty list", refinements="big, huge", generations="big, huge",
            teacher_generations="big, huge", quick_generations="big, huge",
            quick_teacher_generations="big, huge", both_seconds="fraction, big",
            quick_seconds="fraction, big",
            inference_seconds="fraction, big", refinement_seconds="fraction, big",
            seed="big, huge",
        ),
    ),
    Call(
        Teacher,
        {
            "weights": {name: np.zeros(shape) for name, shape in shapes_of(AQUAFISH).items()},
            "offline": {"steps": 0, "seconds": 0.0}, "curve": [(1, 0.5)], "plan": AQUAFISH,
        },
        options(curve="empty list"),
    ),
    Call(Teacher.load, {"path": "teacher.json"}, options(path="none"), {"path": "teacher"}),
    Call(load_library, {"library": "library.json"}, words={"library": "plan"}),
    Call(
        imagine,
        {"controllers": LIBRARY, "robot": ROBOT, "state": STATE, "seconds": 0.2},
        options(seconds="fraction", controllers="empty list"),
    ),
    Call(
        SelfModel,
        {
            "robot": ROBOT, "fin_angles": np.zeros(3), "hold": 20,
            "model_error": np.full(4, 1e-5), "start_error": np.full(4, 1e-4),
        },
    ),
    Call(MODEL.step, {"action": np.zeros(3)}),
    Call(
        predict,
        {"robots": ROBOT, "states": STATE[:, None], "actions": np.zeros((1, 3)), "hold": 20},
    ),
    Call(SurpriseMonitor, {"margin": 1.5}, options(margin="fraction, big")),
    Call(
        ErrorCalibration,
        {"robot": ROBOT, "fin_angles": np.zeros(3), "hold": 20},
        options(fin_angles="none"),
    ),
    Call(add_to_calibration, {"action": np.zeros(3), "observed": np.full(9, np.nan)}),
    Call(
        filmed,
        {
            "label": "rest", "swim": swim(LIBRARY[0], BODY, engine="numba", seconds=0.2),
            "body": BODY, "damage": Damage(), "hold": 5,
        },
        options(label="text, empty text"),
        {"body": "body"},
    ),
]  # fmt: skip
if find_spec("stable_baselines3") is not None:
    from gait.learning.sb3_env import SB3VecEnv

    _batch = AquaFishVectorEnv(2, autoreset_mode="Disabled")
    ROWS += [
        Call(
            SB3VecEnv,
            {"envs": _batch, "observation_space": None},
            options(observation_space="none"),
        ),
        Call(
            SB3VecEnv(AquaFishVectorEnv(2, autoreset_mode="Disabled")).set_options,
            {"options": {}},
            options(options="none, empty mapping, mapping"),
        ),
    ]
