"""Extreme bodies under the roughest commands stay finite; divergence ends only its own robot.

The bodies are all corners of the space of bodies (each dimension 0 or its maximum), some of which
have one fin, and bodies with fins thinner than paper.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from aquafish_gym.engines.api import simulate_scenario
from aquafish_gym.engines.compiled import lanes
from aquafish_gym.envs import robots
from aquafish_gym.envs.env import AquaFishEnv
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics import layout
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.scenario import Scenario
from gait.controllers.controller import Controller
from gait.controllers.network import Senses
from gait.swims.poses import random_poses
from gait.swims.scores import scores
from gait.swims.swim import swim
from gait.swims.transfer import swims_on
from instruments.verification.trials import one_world

CORNERS = np.array(list(itertools.product((0.0, 1.0), repeat=9))) * AQUAFISH.maxima
THICKNESS, WIDTH, LENGTH = [2, 5, 6], [0, 3, 8], [1, 4, 7]
GO = np.array([0.8, 0.6, 0.4], np.float32)
NAN = math.nan


def thin_bodies(count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return bodies (count, 9) with some sizes next to nothing."""
    bodies = rng.uniform(0.0, AQUAFISH.maxima, (count, 9))
    for axis in (THICKNESS, WIDTH, LENGTH):
        thin = rng.random((count, 3)) < 0.5
        bodies[:, axis] *= np.where(thin, 10.0 ** rng.uniform(-300, -1, (count, 3)), 1.0)
    return bodies


def bang_bang(steps: int, count: int, rng: np.random.Generator) -> NDArray[np.float32]:
    """Return actions (steps, count, 3) of -1 and 1 that switch at each servo's own pace."""
    pace = 10.0 ** rng.uniform(-2.5, 0.0, (count, 3))
    switches = rng.random((steps, count, 3)) < pace
    switches[0] = rng.random((count, 3)) < 0.5
    return np.where(np.cumsum(switches, axis=0) % 2, 1.0, -1.0).astype(np.float32)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("bodies", ["corners", "thin"])
def test_a_million_steps_of_extreme_robots_are_finite(bodies: str, dtype: str) -> None:
    """512 robots for a whole episode of 2000 physics steps: 1,024,000 steps each."""
    rng = np.random.default_rng(0)
    sizes = CORNERS if bodies == "corners" else thin_bodies(512, rng)
    env = AquaFishVectorEnv(
        512, sizes, dtype=dtype, frame_skip=5, observe_fins=True, current=(20, -20, 20)
    )
    env.reset(seed=0)
    for action in bang_bang(400, 512, rng):
        seen, reward, terminated, truncated, info = env.step(action)
        assert env.observation_space.contains(seen)
        assert np.isfinite(reward).all()
        assert not terminated.any()
        assert not info["diverged"].any()
    assert truncated.all()
    for name, value in info.items():
        assert value.dtype == object or np.isfinite(value).all(), name
    state = env._swimmers.state()
    assert np.isfinite(env._swimmers.states).all()
    np.testing.assert_allclose(np.linalg.norm(state.orientation, axis=0), 1.0, atol=1e-5)
    # No robot is faster than the water that carries it and what its fins can do.
    speeds = np.stack([info[f"{axis}_velocity"] for axis in "xyz"])
    assert np.abs(speeds).max() < 60


@pytest.mark.slow
def test_a_hundred_thousand_pybullet_steps_of_extreme_robots_are_finite() -> None:
    """50 episodes of 2000 physics steps."""
    rng = np.random.default_rng(1)
    one_fin = [CORNERS[-1] * np.repeat(np.arange(3) == fin, 3) for fin in range(3)]
    bodies = [
        *one_fin,
        CORNERS[0],
        CORNERS[-1],
        *CORNERS[rng.choice(512, 25, replace=False)],
        *thin_bodies(20, rng),
    ]
    env = AquaFishEnv(engine="pybullet", frame_skip=5, current=(20, -20, 20))
    for body, actions in zip(bodies, bang_bang(400, 50, rng).swapaxes(0, 1), strict=True):
        env.reset(seed=0, options={"morphology": body})
        for action in actions:
            seen, reward, terminated, truncated, info = env.step(action)
            assert env.observation_space.contains(seen)
            assert math.isfinite(reward)
            assert not terminated
            assert not info["diverged"]
        assert truncated
        assert all(np.isfinite(v).all() for v in info.values() if not isinstance(v, str))
    env.close()


# What makes a robot diverge: rows of the compiled engine's states, in the order of ``State``.
BLOWS = {
    "a spin of 1e200": (slice(10, 13), 1e200),
    "a velocity of 1e200": (slice(7, 10), -1e200),
    "an infinite position": (slice(4, 7), math.inf),
    "no attitude": (slice(0, 4), NAN),
    "a fin nowhere": (slice(13, 15), NAN),
}


def strike(env: Any, blow: str) -> None:
    """Spoil the state of the compiled robot."""
    rows, value = BLOWS[blow]
    world = env._robot.world
    world._numbers[world._state][rows] = value


def strike_bullet(env: Any, blow: str) -> None:
    """Spoil the state of the robot in PyBullet."""
    world, value = env._robot.world, BLOWS[blow][1]
    if blow.startswith("a fin"):
        world._joints[:2] = value
        return
    name = {"a spin": "world_spin", "a velo": "velocity", "an inf": "velocity"}.get(
        blow[:6], "orientation"
    )
    setattr(world, name, (value,) * (4 if name == "orientation" else 3))


@pytest.mark.parametrize(
    ("engine", "hit", "blow"),
    [("numba", strike, blow) for blow in BLOWS]
    + [("pybullet", strike_bullet, blow) for blow in BLOWS],
)
def test_divergence_ends_the_episode(
    engine: str, hit: Callable[[Any, str], None], blow: str
) -> None:
    env = AquaFishEnv(engine=engine, fin_angles="random")
    calm = AquaFishEnv(engine=engine, fin_angles="random")
    for e in (env, calm):
        e.reset(seed=0)
        good, *_ = e.step(GO)
    hit(env, blow)
    seen, reward, terminated, truncated, info = env.step(GO)
    assert (reward, terminated, truncated, info["diverged"]) == (0.0, True, False, True)
    assert (seen == good).all()  # the last good one
    assert all(np.isfinite(v).all() for v in info.values() if not isinstance(v, str))
    with pytest.raises(ResetNeeded):
        env.step(GO)
    # Nothing of it is left in the next episode.
    assert (env.reset(seed=5)[0] == calm.reset(seed=5)[0]).all()
    for _ in range(20):
        found, expected = env.step(GO), calm.step(GO)
        assert (found[0] == expected[0]).all()
        assert found[1] == expected[1]
        assert not found[4]["diverged"]
    env.close()
    calm.close()


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("speed", [1e9, 1e30, 1e200, math.inf, NAN])
def test_divergence_of_one_robot_spares_the_others(speed: float, dtype: str) -> None:
    """Its water flows at a speed that no door admits."""
    env, calm = (AquaFishVectorEnv(9, dtype=dtype, fin_angles="random") for _ in range(2))
    for e in (env, calm):
        e.reset(seed=0)
        good, *_ = e.step(np.tile(GO, (9, 1)))
    water = np.zeros((9, 3))
    water[4] = speed
    with np.errstate(over="ignore"):  # 1e200 is infinite in float32
        env._swimmers.set_current(water)
    others = np.arange(9) != 4
    for t in range(3):
        seen, reward, terminated, truncated, info = env.step(np.tile(GO, (9, 1)))
        expected = calm.step(np.tile(GO, (9, 1)))
        assert (seen[others] == expected[0][others]).all()
        assert (reward[others] == expected[1][others]).all()
        assert (
            terminated.tolist()
            == info["diverged"].tolist()
            == [t == 0 and i == 4 for i in range(9)]
        )
        assert not truncated.any()
        assert np.isfinite(seen).all()
        if t == 0:
            assert (seen[4] == good[4]).all()
            assert reward[4] == 0.0


@pytest.mark.parametrize("engine", ["numba", "pybullet"])
def test_a_log_is_nan_from_where_a_robot_diverged(engine: str) -> None:
    """A current of 1e200 units/s is more than any arithmetic holds, and no door admits it."""
    robot = Scenario.fill(
        {"body": AQUAFISH.maxima[None], "current": np.array([[1e200, 1e200, 0.0]])}
    )
    log = simulate_scenario(robot, np.array([[0.5, 0.5, 1.0]]), 40, engine, "float64")
    assert log.diverged.tolist() == [True]
    good = np.isfinite(log.rpy[0]).all(axis=1)
    assert not good[-1]
    assert (np.diff(good.astype(int)) <= 0).all()


def steady() -> Controller:
    """Return a controller that always acts alike."""
    return Controller(
        weights=np.zeros((3, len(Senses().names()) + 3)),
        bias=np.ones(3),
        response=np.ones(3),
        clock=0.7,
        morphology=Morphology.nominal(),
        seed=0,
    )


def test_a_swim_of_a_batch_that_diverged_has_no_distance(monkeypatch: pytest.MonkeyPatch) -> None:
    class SickBatch(lanes.LaneBatch):
        def run(self, *args: Any, **kwargs: Any) -> Any:
            if self.batch > 1:
                self.states[layout.FIELDS["spin"], 1] = NAN
            return super().run(*args, **kwargs)

    monkeypatch.setattr(lanes, "LaneBatch", SickBatch)
    poses = random_poses(3, 0)
    distances = scores([steady()], None, poses, seconds=1.0, penalize=False)
    assert np.isnan(distances).tolist() == [[False, True, False]]
    scored = swims_on(steady(), None, poses, engine="numba", seconds=1.0)
    assert math.isnan(scored.random_distance)
    assert math.isfinite(scored.distance)


@pytest.mark.parametrize("engine", ["numba", "pybullet"])
def test_a_single_swim_that_diverged_ends_in_nan(
    engine: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    class SickWorld:
        def __init__(self) -> None:
            self.world, self.steps = one_world(engine), 0

        def __getattr__(self, name: str) -> Any:
            return getattr(self.world, name)

        def advance(self, command: Any) -> None:
            self.steps += 1
            # From then on, a servo that turns that fast.
            self.world.advance(command if self.steps <= 20 else (1e250, 1e250, 0.0))

    monkeypatch.setattr(robots, "make_world", lambda *_: SickWorld())
    path = swim(steady(), None, engine=engine, seconds=1.0)
    assert math.isnan(path.distance)
    assert path.time[-1] == 1.0
    good = np.isfinite(path.position).all(axis=1)
    assert good[:5].all()
    assert not good[5:].any()
