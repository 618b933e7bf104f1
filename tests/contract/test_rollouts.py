"""A rollout and ``simulate`` observe what the single environment does of the same scenario.

Hypothesis draws what breaks and when, the water, the fins' angles and the task. Both take
scenarios, and so servos with a lag, too, on each engine.
"""

from __future__ import annotations

import copy
import importlib.util
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aquafish_gym import Damage
from aquafish_gym.command import scale_action
from aquafish_gym.engines.api import simulate_scenario
from aquafish_gym.envs.env import AquaFishEnv
from aquafish_gym.envs.tasks import check_task
from aquafish_gym.plans import BodyPlan
from aquafish_gym.rollout import rollout
from aquafish_gym.scenario import Scenario
from tests.contract.scenes import damages
from tests.plans import COMPILED_PLANS

HOLD, STEPS = 20, 12
ENGINES = ["numba", "pybullet"] if importlib.util.find_spec("pybullet") else ["numba"]


def scenes(plan: BodyPlan) -> st.SearchStrategy[dict[str, Any]]:
    # Whatever is drawn at a reset, an environment draws.
    texts = damages(HOLD / 100, STEPS, plan).filter(lambda text: not re.search("random|dead", text))
    return st.fixed_dictionaries(
        {
            "damage": texts,
            "current": st.sampled_from([(0.0, 0.0, 0.0), (0.1, -0.2, 0.05)]),
            "reactive": st.booleans(),
            "plan": st.just(plan),
        }
    )


def late_scenario(scenario: Scenario, lag: float) -> Scenario:
    """Return a scenario whose servos have a lag in s throughout."""
    return replace(scenario, servo_lag=np.full_like(scenario.servo_lag, lag))


Streams = dict[str, np.ndarray]


def streams(scene: dict[str, Any], task: str, lag: float, seed: int) -> list[Streams]:
    """Return what each way observes (STEPS, k); then of a scenario whose servos are late.

    Then what those robots' gyroscopes would say, (STEPS x HOLD, 3), if they were whole.
    """
    plan = scene["plan"]
    actions = np.random.default_rng(seed).uniform(-1, 1, (STEPS, len(plan.fins)))
    actions = actions.astype(np.float32)
    own = task in ("station", "return")  # these tasks have a current of their own
    current = (0.0, 0.0, 0.0) if own else scene["current"]
    options = {**scene, "current": current, "task": task, "fin_angles": "random"}
    found: Streams = {}
    late: Streams = {}
    swum: Streams = {}
    env = AquaFishEnv(engine="numba", frame_skip=HOLD, **options)
    seen, info = env.reset(seed=seed)
    rng, memory = copy.deepcopy(env.np_random), env._memory
    rows = [seen] + [env.step(action)[0] for action in actions[:-1]]
    env.close()
    found["single"] = np.array(rows)
    # The first observation's noise is drawn after the reset; a copy of the generator comes later.
    if "noise" in scene["damage"]:
        return [found, late, swum]
    whole = Scenario.create(
        fin_angles=info["fin_angles"][None], current=[current], reactive=scene["reactive"],
        plan=plan,
    )  # fmt: skip
    robot = Damage.coerce(scene["damage"] or None).edit(whole, HOLD)

    def roll(robot: Scenario, engine: str) -> tuple[np.ndarray, np.ndarray]:
        rows = []

        def act(observation: np.ndarray, _: float) -> np.ndarray:
            rows.append(observation)
            return actions[len(rows) - 1]

        swims = rollout(
            [act],
            robot,
            check_task(task),
            engine=engine,
            seconds=STEPS * HOLD / 100,
            interval=HOLD,
            memory=[memory],
            rngs=[rng],
        )
        return np.array(rows), swims.paths[0].gyro

    found["rollout"], _ = roll(robot, "numba")
    slow = late_scenario(robot, lag)
    for engine in ENGINES:
        late[f"rollout, {engine}"], swum[f"rollout, {engine}"] = roll(slow, engine)
        if not own and not slow.is_late:
            series = scale_action(plan, actions)[None]
            log = simulate_scenario(
                slow, series, STEPS * HOLD, engine, "float64", record="gyro", interval=HOLD
            )
            swum[f"simulate, {engine}"] = log.gyro[0]  # type: ignore[index]
    return [found, late, swum]


@pytest.mark.parametrize("task", ["forward", "station", "waypoint", "return"])
@pytest.mark.parametrize("plan", COMPILED_PLANS[:3])
@settings(max_examples=6)
@given(data=st.data(), lag=st.floats(0.001, 0.3), seed=st.integers(0, 1000))
def test_a_rollout_observes_what_an_environment_does(
    plan: BodyPlan, task: str, data: st.DataObject, lag: float, seed: int
) -> None:
    scene = data.draw(scenes(plan))
    found, late, swum = streams(scene, task, lag, seed)
    assert np.ptp(found["single"], axis=0).max() > 0.01  # it swims
    for faces, atol in ((found, 2e-6), (late, 2e-6), (swum, 1e-8)):
        for name, rows in faces.items():
            first = next(iter(faces.values()))
            np.testing.assert_allclose(rows, first, rtol=0, atol=atol, err_msg=name)
