"""The simulator's public functions, with arguments with which they work."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from strange_values import (
    CALLABLE,
    NO_BODY,
    NO_DAMAGE,
    STRANGE,
    Call,
    options,
)

from aquafish_gym import (
    AQUAFISH,
    AquaFishEnv,
    AquaFishVectorEnv,
    BodyPlan,
    Damage,
    FaultWrapper,
    FinPlan,
    Hull,
    Morphology,
    VectorFaultWrapper,
    WorldConfig,
    held_out,
    simulate,
)
from aquafish_gym.bodies import read_bodies, write_bodies
from aquafish_gym.damage import Fault
from aquafish_gym.envs.tasks import (
    HoldStation,
    ReachWaypoints,
    Recover,
    ReturnToBuoys,
    SwimForward,
)
from aquafish_gym.rendering import render_pose
from aquafish_gym.rendering.course import FilmedSwim
from aquafish_gym.rendering.films import film
from aquafish_gym.rendering.replay import write_replay
from aquafish_gym.rollout import rollout
from aquafish_gym.scenario import Scenario

BODY = Morphology.nominal()
TAIL = AQUAFISH.fins[-1]
WHOLE = Damage()
SCENARIO = Scenario.create()
STILL = FilmedSwim(
    "rest", np.array([0.0, 1.0]), np.ones((2, 9)), np.zeros((2, 3), bool), np.zeros((2, 3)),
    np.tile((0.0, 0.0, 0.0, 1.0), (2, 1)), np.zeros((2, 3)),
)  # fmt: skip
ENV = {
    "morphology": BODY, "damage": "none", "engine": "numba", "current": np.zeros(3),
    "fin_angles": np.zeros(3), "observe_fins": False, "frame_skip": 20, "render_mode": None,
    "task": "forward", "reactive": False, "plan": AQUAFISH,
}  # fmt: skip
#: Gymnasium itself looks at ``render_mode``.
MADE = {name: value for name, value in ENV.items() if name != "render_mode"}
BATCH = {
    "num_envs": 2, "dtype": "float32", "threads": 1, "autoreset_mode": "NextStep",
    "max_episode_steps": 10,
}  # fmt: skip
LEGAL = {
    "morphology": NO_BODY, "damage": NO_DAMAGE, "render_mode": "none", "threads": "none",
    "dtype": "none",
    "max_episode_steps": "none", "observe_fins": "true", "reactive": "true",
}  # fmt: skip


def legal(arguments: dict[str, Any], **more: str) -> dict[str, frozenset[str]]:
    """Return the legal values of an environment's arguments."""
    return options(**{name: LEGAL[name] for name in arguments if name in LEGAL} | more)


def begun(env: Any) -> Any:
    """Return an environment in its first episode."""
    env.reset(seed=0)
    return env


ONE, MANY = begun(AquaFishEnv(engine="numba")), begun(AquaFishVectorEnv(2))
PENDULUM = begun(FaultWrapper(gym.make("Pendulum-v1"), "action_0:weak=0.5", dt=0.05))
PENDULUMS = begun(
    VectorFaultWrapper(
        gym.make_vec("Pendulum-v1", 2, vectorization_mode="sync"), "action_0:weak=0.5", dt=0.05
    )
)
RESET = {"seed": 0, "options": None}
SEEDED = options(seed="none, big, huge", options="none, empty mapping")
OF_ANOTHER = options(seed="none, big, huge", options="none, empty mapping, mapping")


def make(**options: Any) -> Any:
    """Make an environment by Gymnasium."""
    return gym.make("AquaFish-v0", **options)


def make_vec(num_envs: int, **options: Any) -> Any:
    """Make a batch by Gymnasium."""
    return gym.make_vec("AquaFish-v0", num_envs, **options)


def hold(_observation: Any, _time: float) -> Any:
    """Hold still."""
    return np.zeros(3)


def task_row(task: Any) -> Call:
    """Return the row of a task, all of whose fields are numbers."""
    legal = {
        name: "fraction, minus one" if name in ("forward_weight", "reached_weight") else "fraction"
        for name in vars(task())
    }
    return Call(task, vars(task()), options(**legal))


ROWS = [
    Call(AquaFishEnv, ENV, legal(ENV)),
    Call(AquaFishVectorEnv, ENV | BATCH, legal(ENV | BATCH)),
    Call(make, MADE, legal(MADE)),
    Call(make_vec, MADE | {"num_envs": 2}, legal(MADE)),
    Call(ONE.reset, RESET, SEEDED),
    Call(ONE.step, {"action": np.zeros(3)}),
    Call(MANY.reset, RESET, SEEDED),
    Call(MANY.step, {"actions": np.zeros((2, 3))}),
    Call(
        FaultWrapper,
        {
            "env": ONE, "damage": "action_0:dead@1", "dt": 0.2, "neutral": np.zeros(3),
        },
        options(damage=NO_DAMAGE, dt="none, fraction", neutral="none, minus one, fraction"),
    ),
    Call(PENDULUM.reset, RESET, OF_ANOTHER),
    Call(PENDULUM.step, {"action": np.zeros(1)}),
    Call(
        VectorFaultWrapper,
        {
            "env": gym.make_vec("Pendulum-v1", 2, vectorization_mode="sync"),
            "damage": "action_0:dead@1", "dt": 0.2, "neutral": np.zeros(1),
        },
        options(damage=NO_DAMAGE, dt="none, fraction", neutral="none, minus one, fraction"),
    ),
    Call(PENDULUMS.reset, RESET, OF_ANOTHER),
    Call(PENDULUMS.step, {"actions": np.zeros((2, 1))}),
    Call(
        simulate,
        {
            "morphologies": BODY, "commands": [(0.1, 0.1, 0.1)], "fin_angles": np.zeros(3),
            "steps": 4, "engine": "numba", "dtype": "float64", "current": np.zeros(3),
            "substeps": 1, "threads": 1, "record": "attitude", "reactive": False,
            "drag": np.ones(2), "servo_gain": np.ones(3), "lag": np.zeros(1), "interval": 1,
            "begun": 0, "velocity": np.zeros(3), "spin": np.zeros(3), "plan": AQUAFISH,
        },
        options(
            morphologies=NO_BODY, threads="none", reactive="true", servo_gain="fraction, minus one",
            lag="fraction, empty list", dtype="none", fin_angles="none", plan="none",
        ),
    ),
    Call(
        rollout,
        {
            "policy": [hold], "scenario": SCENARIO, "task": SwimForward(seconds=1.0),
            "engine": "numba", "seconds": 1.0, "interval": 20, "believed": None,
            "believed_gain": None, "memory": None, "rngs": (), "dtype": np.float64,
            "threads": None, "substeps": 1, "start": None,
        },
        options(
            task="none", seconds="none, fraction", interval="none", believed="none",
            believed_gain="none", memory="none", rngs="empty list", threads="none", start="none",
        ),
    ),
    Call(
        WorldConfig,
        {
            "current": np.zeros(3), "drag": (1.0, 1.0), "servo_gain": np.ones(3), "lag": 0.0,
            "reactive": False, "substeps": 1,
        },
        options(reactive="true", lag="fraction", servo_gain="fraction, minus one"),
    ),
    Call(WorldConfig().edit, {"scenario": SCENARIO}),
    Call(WorldConfig.of, {"robot": SCENARIO}),
    Call(Morphology, {"sizes": BODY.sizes, "plan": AQUAFISH}, words={"sizes": "morphology"}),
    Call(Morphology.nominal, {"plan": AQUAFISH}),
    Call(
        Morphology.from_array, {"sizes": BODY.to_array(), "plan": AQUAFISH},
        words={"sizes": "morphology"},
    ),
    Call(
        Morphology.coerce, {"value": BODY, "plan": AQUAFISH},
        options(value=NO_BODY, plan="none"), {"value": "morphology"},
    ),
    Call(
        Morphology.from_json, {"text": BODY.to_json(), "plan": AQUAFISH},
        words={"text": "morphology"},
    ),
    Call(
        BodyPlan, {"name": "fish", "hull": AQUAFISH.hull, "fins": AQUAFISH.fins},
        options(name="text"),
    ),
    Call(BodyPlan.from_json, {"text": AQUAFISH.to_json()}, words={"text": "plan"}),
    Call(
        FinPlan, {name: getattr(TAIL, name) for name in TAIL.__dataclass_fields__},
        options(speed="fraction", sweep="fraction", word="text, empty text", name="text"),
    ),
    Call(Hull, {"length": 4.0, "radius": 0.5}, options(length="big", radius="fraction")),
    Call(
        Fault,
        {
            "part": "left_pectoral", "word": "length", "number": 0.5, "onset": 0.0,
            "duration": None, "growth": None,
        },
        options(
            number="none, fraction", onset="fraction", duration="none, fraction",
            growth="none, fraction",
        ),
        {"word": "damage", "number": "length"},
    ),
    Call(Damage, {"faults": ()}, options(faults="empty list")),
    Call(Damage.parse, {"text": "caudal:missing"}, options(text="empty text"), {"text": "damage"}),
    Call(Damage.coerce, {"value": WHOLE}, options(value=NO_DAMAGE), {"value": "damage"}),
    Call(
        held_out,
        {"name": "recovery", "numbers": [0]},
        options(numbers="none, empty list"),
    ),
    Call(Damage.random, {"rng": np.random.default_rng(0), "plan": AQUAFISH}),
    Call(
        WHOLE.sample, {"rng": np.random.default_rng(0), "parts": {}},
        options(parts="empty mapping, mapping"),
    ),
    Call(WHOLE.edit, {"scenario": SCENARIO, "hold": 1}),
    Call(WHOLE.check_onsets, {"seconds": 1.0}, options(seconds="fraction, big")),
    Call(WHOLE.check_steps, {"dt": 0.1}, options(dt="fraction, big")),
    Call(WHOLE.body, {"morphology": BODY}),
    Call(WHOLE.apply, {"morphology": BODY}),
    *map(task_row, (SwimForward, Recover, HoldStation, ReachWaypoints, ReturnToBuoys)),
    Call(
        write_bodies,
        {"path": "bodies.json", "bodies": BODY, "plan": AQUAFISH},
        options(path="text", bodies=NO_BODY),
    ),
    Call(
        read_bodies,
        {"path": "bodies.json", "argument": "file", "plan": AQUAFISH},
        {"argument": frozenset(STRANGE), **options(plan="none")},  # the name of the other one
        {"path": "file"},
    ),
    Call(
        render_pose,
        {
            "morphology": BODY, "pose": ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)),
            "fin_angles": np.zeros(3), "width": 64, "height": 64, "camera": None, "broken": (),
        },
        options(camera="none", broken="empty list"),
    ),
    Call(
        write_replay,
        {"swims": [STILL], "path": "rest.html", "title": "rest"},
        options(path="text", title="text, empty text"),
    ),
    Call(
        Scenario.create,
        {"body": BODY, "reactive": False, "plan": AQUAFISH},
        options(body=f"{NO_BODY}, mapping", reactive="true", plan="none"),
        {"body": "body"},
    ),
    Call(
        film,
        {
            "swims": [STILL], "path": "rest.webp", "width": 64, "height": 64, "fps": 4.0,
            "speed": 1.0, "title": "rest", "progress": print,
        },
        options(
            title="text, empty text", fps="fraction", speed="fraction",
            progress=f"none, {CALLABLE}",
        ),
    ),
]  # fmt: skip
