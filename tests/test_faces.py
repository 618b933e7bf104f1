"""Every engine and every face gives the same observations of the same scenario.

The single environment on both engines, the batched one, and a rollout swim the same robots, drawn
by hypothesis: what breaks and when, the water, the fins' angles, the task.
"""

from __future__ import annotations

import copy
import importlib.util
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aquafish_gym import Damage
from aquafish_gym.envs.env import AquaFishEnv
from aquafish_gym.envs.tasks import check_task
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.rollout import rollout
from aquafish_gym.scenario import Scenario

HOLD, STEPS = 20, 12
ENGINES = ["numba", "pybullet"] if importlib.util.find_spec("pybullet") else ["numba"]

fins = st.sampled_from(["left_pectoral", "right_pectoral", "caudal"])
channels = st.sampled_from(["up_x", "north_y", "gyro_x", "gyro_z"])
shares = st.sampled_from([0.3, 0.5, 0.8])
words = st.one_of(
    st.builds("{}:length={}".format, fins, shares),
    st.builds("{}:missing".format, fins),
    st.builds("{}:weak={}".format, fins, shares),
    st.builds("{}:seized".format, fins),
    st.builds("{}:delay=0.4".format, fins),
    st.builds("{}:hold=0.6".format, fins),
    st.builds("{}:bias={}".format, channels, shares),
    st.builds("{}:stuck".format, channels),
    st.builds("{}:dropped".format, channels),
    st.builds("{}:delay=0.2".format, channels),
    st.builds("{}:scale={}".format, channels, shares),
    st.just("gyro:noise=0.05"),
)
onsets = st.sampled_from(["", "@0.2", "@0.75", "@1.0+0.6"])
damages = st.lists(st.builds("{}{}".format, words, onsets), max_size=3).map("; ".join)
scenes = st.fixed_dictionaries(
    {
        "damage": damages,
        "current": st.sampled_from([(0.0, 0.0, 0.0), (0.1, -0.2, 0.05)]),
        "reactive": st.booleans(),
    }
)


def streams(scene: dict[str, Any], task: str, seed: int) -> dict[str, np.ndarray]:
    """Return the observations (STEPS, k) of each face."""
    actions = np.random.default_rng(seed).uniform(-1, 1, (STEPS, 3)).astype(np.float32)
    own = task == "station"  # this task has a current of its own
    current = (0.0, 0.0, 0.0) if own else scene["current"]
    options = {**scene, "current": current, "task": task, "fin_angles": "random"}
    found = {}
    for engine in ENGINES:
        env = AquaFishEnv(engine=engine, frame_skip=HOLD, **options)
        seen, info = env.reset(seed=seed)
        rng, memory = copy.deepcopy(env.np_random), env._memory
        rows = [seen] + [env.step(action)[0] for action in actions[:-1]]
        env.close()
        found[f"single, {engine}"] = np.array(rows)
        envs = AquaFishVectorEnv(1, engine=engine, dtype="float64", frame_skip=HOLD, **options)
        seen, _ = envs.reset(seed=seed)
        rows = [seen[0]] + [envs.step(action[None])[0][0] for action in actions[:-1]]
        envs.close()
        found[f"batched, {engine}"] = np.array(rows)
    # The first observation's noise is drawn after the reset; a copy of the generator comes later.
    if "noise" not in scene["damage"]:
        robot = Scenario.create(
            fin_angles=info["fin_angles"][None], current=[current], reactive=scene["reactive"]
        )
        rows = []

        def act(observation: np.ndarray, _: float) -> np.ndarray:
            rows.append(observation)
            return actions[len(rows) - 1]

        rollout(
            [act],
            Damage.coerce(scene["damage"] or None).edit(robot, HOLD),
            check_task(task),
            seconds=STEPS * HOLD / 100,
            interval=HOLD,
            memory=[memory],
            rngs=[rng],
        )
        found["rollout"] = np.array(rows)
    return found


@pytest.mark.parametrize("task", ["forward", "station", "waypoint"])
@settings(max_examples=12)
@given(scene=scenes, seed=st.integers(0, 1000))
def test_every_face_observes_the_same(task: str, scene: dict[str, Any], seed: int) -> None:
    found = streams(scene, task, seed)
    first = found.pop("single, numba")
    assert np.ptp(first, axis=0).max() > 0.01  # it swims
    for name, rows in found.items():
        np.testing.assert_allclose(rows, first, atol=2e-6, err_msg=name)
