"""Agents: a controller's own, and what ``swim`` and ``evaluate`` take as one."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import gymnasium as gym
import numba as nb
import numpy as np
import pytest
from gymnasium.spaces import Box

from aquafish.online import SelfModelAgent
from aquafish.viewer.live import LiveSwim, gait_pilot, pilot_of
from aquafish_gym import Damage, Morphology
from aquafish_gym.command import lane_servo_speeds, reckon
from aquafish_gym.envs.tasks import SwimForward
from aquafish_gym.physics.arithmetic import TAU
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.rollout.programs import ProgramAgent
from aquafish_gym.utils.validation import InvalidArgumentError
from gait import Controller, damaged_at_random, evaluate, scores, swim
from gait.controllers.agents import ControllerAgent, held_steps, takes_time
from gait.controllers.controller import program_of
from gait.controllers.inputs import NetworkInputs, reckoned
from gait.controllers.network import Senses, forward, responder
from gait.film import Film
from gait.search.templates import Template
from gait.swims.evaluation import FIRST_SEED, interquartile_mean
from gait.swims.transfer import TransferConfig, swims_on, transfer

ACTION = (0.2, -0.4, 1.0)


def steady(observation: Any, time: float) -> Any:  # noqa: ARG001
    return ACTION


class Acting:
    def act(self, observations: Any) -> Any:
        return np.tile(ACTION, (len(observations), 1))


class Starting(Acting):
    started = 0

    def reset(self, info: Any) -> None:
        self.started = len(info["fin_angles"])


class Predicting:
    """As a model of stable-baselines3, which also has a policy and may have a memory."""

    policy = None
    starts: tuple[Any, ...] = ()

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: Any = 0
    ) -> Any:
        assert deterministic
        assert (state is None) == bool(np.all(episode_start))
        self.starts += (state,)
        return np.tile(ACTION, (len(observation), 1)), (state or 0) + 1


class OfOneRobot:
    """Each robot has a memory of its own."""

    def begin(self, fin_angles: Any) -> None:
        assert np.shape(fin_angles) == (3,)
        self.seen: list[Any] = []

    def act(self, observation: Any) -> Any:
        self.seen.append(observation)
        assert np.shape(observation)[-1] == 9
        return ACTION


class WithPolicy:
    def policy(self) -> Any:
        return steady


KINDS: dict[str, Any] = {
    "function of observations": Acting().act,
    "function of observation and time": steady,
    "object with policy()": WithPolicy(),
    "agent": Acting(),
    "agent of one robot": OfOneRobot(),
    "model": Predicting(),
}


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_swims_and_is_evaluated_alike(kind: str) -> None:
    found = swim(KINDS[kind], None, engine="numba", seconds=2.0)
    plain = swim(steady, None, engine="numba", seconds=2.0)
    assert found.distance == plain.distance
    scored = evaluate(KINDS[kind], episodes=3)
    np.testing.assert_array_equal(scored.returns, evaluate(Acting(), episodes=3).returns)
    config = TransferConfig(poses=1, seconds=1, target_engine="numba", native_engine="numba")
    there = transfer(KINDS[kind], None, config, Morphology.nominal()).target
    assert there.distance == swim(steady, None, engine="numba", seconds=1.0).distance


def test_a_model_observes_its_fins_and_its_normal_observations() -> None:
    sb3: Any = pytest.importorskip("stable_baselines3")
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    def make() -> Any:
        return gym.make("AquaFish-v0", engine="numba", observe_fins=True)

    normal = VecNormalize(DummyVecEnv([make]))
    normal.obs_rms.mean += 0.3
    model = sb3.PPO("MlpPolicy", normal, n_steps=64, device="cpu", seed=0)
    for parameter in model.policy.action_net.parameters():
        parameter.data += 0.3
    angles = (0.5, 1.0, -0.5)
    swum: Any = {"engine": "numba", "seconds": 2.0, "observe_fins": "reckoned"}
    far = swim(model, None, angles, **swum).distance

    env = make()
    seen, _ = env.reset(options={"fin_angles": angles})
    for _ in range(10):
        action = model.predict(normal.normalize_obs(seen), deterministic=True)[0]
        seen, *_, info = env.step(action)
    assert far == pytest.approx(info["y_position"], abs=1e-5)
    assert far != pytest.approx(swim(model.policy, None, angles, **swum).distance, abs=1e-5)
    scored = evaluate(model, episodes=2, observe_fins=True)
    assert np.isfinite(scored.returns).all()
    reckons: Any = {"engine": "numba", "seconds": 1.0, "observe_fins": "reckoned"}
    config = TransferConfig(poses=1, seconds=1.0, target_engine="numba")
    both = transfer(model, None, config, Morphology.nominal(), observe_fins="reckoned")
    assert both.target.distance == swim(model, None, **reckons).distance
    for door in (
        lambda: evaluate(model, episodes=2),
        lambda: swim(model, None, engine="numba"),
        lambda: evaluate(model, "AquaFishWaypoint-v0", episodes=2, observe_fins=True),
    ):
        with pytest.raises(InvalidArgumentError, match=re.escape("a model of (15,): choose the")):
            door()
    with pytest.raises(InvalidArgumentError, match='observe_fins must be False or "reckoned"'):
        swim(model, None, **reckons | {"observe_fins": True})
    with pytest.raises(InvalidArgumentError, match="observe_fins must be False for a Controller"):
        swim(blind(), None, **reckons)


def test_an_agent_of_one_robot_swims_in_every_episode() -> None:
    agent = SelfModelAgent()
    assert evaluate(agent, episodes=2, max_episode_steps=5).returns.shape == (2,)
    assert agent.events is not None
    assert swim(SelfModelAgent(), None, engine="numba", seconds=1.0).distance > 0


class Model:
    """A model of stable-baselines3 that observes so many numbers."""

    def __init__(self, numbers: int) -> None:
        self.observation_space = Box(-1.0, 1.0, (numbers,))

    def predict(self, observation: Any, *_: Any, **__: Any) -> tuple[Any, None]:
        return observation[:, -3:], None


def blind() -> Controller:
    return Controller(np.zeros((3, 14)), np.zeros(3), np.ones(3), 0.7, Morphology.nominal(), 0)


@pytest.mark.parametrize(
    "controller",
    [steady, blind(), Acting(), Model(9), lambda observations: np.zeros((len(observations), 3))],
)
@pytest.mark.parametrize("name", ["believed", "believed_gain"])
def test_beliefs_are_not_ignored(controller: Any, name: str) -> None:
    with pytest.raises(InvalidArgumentError, match=f"{name} must not be given"):
        swim(controller, None, engine="numba", seconds=0.1, **{name: np.ones(3)})
    config = {"believed": {"angle_error": (0.1, 0.0, 0.0)}, "believed_gain": {name: (1, 1, 0.5)}}
    ((argument, value),) = config[name].items()
    options = TransferConfig(**{argument: value}, seconds=0.1, target_engine="numba", poses=1)
    with pytest.raises(InvalidArgumentError, match=f"{argument} must not be given"):
        transfer(controller, None, options, Morphology.nominal())
    if isinstance(controller, Controller):
        with pytest.raises(InvalidArgumentError, match=f"{name} must not be given"):
            scores([controller], None, seconds=0.1, **{name: np.ones((1, 3))})
    plain = TransferConfig(seconds=0.1, target_engine="numba", poses=1)
    transfer(controller, None, plain, Morphology.nominal())


def test_beliefs_are_taken_by_those_that_use_them() -> None:
    knowing = {"believed": (1.0, 0.0, 0.0), "believed_gain": (1.0, 0.5, 1.0)}
    senses = Senses(fins=True)
    feeling = Controller(
        np.full((3, len(senses.names()) + 3), 0.1) * ([1.0] * len(senses.names()) + [0.0] * 3),
        np.zeros(3), np.ones(3), 0.7, Morphology.nominal(), 0, senses=senses,
    )  # fmt: skip
    for controller, observe_fins in ((feeling, False), (Model(15), "reckoned")):
        options: Any = {"engine": "numba", "seconds": 1.0, "observe_fins": observe_fins}
        plain = swim(controller, None, **options).position
        for name, value in knowing.items():
            assert (swim(controller, None, **options, **{name: value}).position != plain).any()


def test_as_many_episodes_as_a_batch_has_robots() -> None:
    envs = gym.make_vec("AquaFish-v0", 2, max_episode_steps=3)
    acting = Starting()
    assert evaluate(acting, envs, episodes=2).returns.shape == (2,)
    assert acting.started == 2
    with pytest.raises(InvalidArgumentError, match="episodes must be the 2 robots of env"):
        evaluate(Acting(), envs, episodes=100)
    with pytest.raises(InvalidArgumentError, match="env must be of type VectorEnv"):
        evaluate(Acting(), gym.make("AquaFish-v0", engine="numba"))  # type: ignore[arg-type]


@pytest.mark.parametrize("mode", ["SameStep", "Disabled"])
def test_a_batch_that_begins_again_within_a_step_is_refused(mode: str) -> None:
    """The end of its episodes would be read from the next ones."""
    with pytest.raises(InvalidArgumentError, match=f'must be "NextStep"; got {mode!r}'):
        evaluate(Acting(), episodes=2, autoreset_mode=mode, max_episode_steps=3)
    envs = gym.make_vec("AquaFish-v0", 2, max_episode_steps=3)
    envs.unwrapped.metadata = envs.metadata | {"autoreset_mode": "NextStep"}  # as others name it
    assert evaluate(Acting(), envs).returns.shape == (2,)


@pytest.mark.parametrize("kind", ["sync", "async"])
def test_a_batch_of_gymnasium_is_played_as_our_own(kind: str) -> None:
    options: Any = {"max_episode_steps": 6, "frame_skip": 20}
    controller = random_controller(20)
    envs = gym.make_vec("AquaFish-v0", 2, vectorization_mode=kind, engine="numba", **options)
    try:
        found = evaluate(controller, envs)
        timed = evaluate(lambda _, time: (0.2, -0.4, min(time, 1.0)), envs)
    finally:
        envs.close()
    own = evaluate(controller, episodes=2, dtype="float64", **options)
    np.testing.assert_allclose(found.y_position, own.y_position, atol=1e-6)
    assert timed.returns.shape == (2,)


@pytest.mark.parametrize("observe_fins", [False, True, "reckoned"])
def test_a_controller_that_senses_a_goal_is_refused_where_there_is_none(
    observe_fins: bool | str,
) -> None:
    senses = Senses(goal=True)
    weights = np.hstack([np.full((3, len(senses.names())), 0.1), np.zeros((3, 3))])
    body = Morphology.nominal()
    seeking = Controller(weights, np.zeros(3), np.ones(3), 0.7, body, 0, senses=senses)
    options: Any = {
        "max_episode_steps": 3, "observe_fins": observe_fins, "episodes": 2, "frame_skip": 5
    }  # fmt: skip
    said = r"the way to the goal|must have shape \(2, 12 or more\)"
    with pytest.raises(InvalidArgumentError, match=said):
        evaluate(seeking, **options)
    assert evaluate(seeking, "AquaFishWaypoint-v0", **options).returns.shape == (2,)


def random_controller(interval: int) -> Controller:
    """Return a random linear controller that also senses its fins."""
    senses = Senses(fins=True)
    rng = np.random.default_rng(interval)
    weights = np.hstack([rng.normal(size=(3, len(senses.names()))), np.zeros((3, 3))])
    body = Morphology.nominal()
    return Controller(
        weights, rng.normal(size=3), np.ones(3), 0.7, body, 0, senses=senses, interval=interval
    )


#: The shortest and the longest interval, and two of which 4.2 s are no whole number.
QUICK_INTERVALS = (1, 8, 11, 20)


def nightly(interval: int, *more: Any) -> Any:
    """Return a test's parameters, which are nightly unless the interval is a quick one."""
    return pytest.param(
        interval, *more, marks=() if interval in QUICK_INTERVALS else pytest.mark.slow
    )


@pytest.mark.pybullet
@pytest.mark.parametrize("interval", [nightly(interval) for interval in range(1, 21)])
def test_an_action_is_held_for_the_controllers_interval_everywhere(interval: int) -> None:
    """4.2 s are no whole number of most intervals."""
    controller = random_controller(interval)
    (expected,) = scores([controller], None, seconds=4.2, dtype="float64")[0]
    for engine in ("numba", "pybullet"):
        found = swim(controller, None, engine=engine, seconds=4.2)
        assert found.distance == pytest.approx(expected, abs=1e-6)
        assert found.time[-1] == pytest.approx(4.2)
    agent = ControllerAgent(controller)
    assert swim(agent, None, engine="numba", seconds=4.2).distance == pytest.approx(
        expected, abs=1e-4
    )
    film = Film((), engine="numba", seconds=4.2)._swim(0, controller, None, Damage(), "")
    assert film.position[-1, 1] == pytest.approx(expected, abs=1e-6)
    scored = swims_on(controller, None, [(0.0, 0.0, 0.0)], "pybullet", 4.2)
    assert scored.random_distances[0] == pytest.approx(expected, abs=1e-6)
    viewed = LiveSwim(gait_pilot(controller))
    viewed.advance(interval)
    assert viewed.held <= interval
    if 2000 % interval:
        with pytest.raises(InvalidArgumentError, match="frame_skip must divide"):
            evaluate(controller, episodes=1, frame_skip=interval)
    with pytest.raises(InvalidArgumentError, match=f"frame_skip must be {interval}, the"):
        evaluate(controller, episodes=1, frame_skip=40)
    with pytest.raises(InvalidArgumentError, match=f"interval must be {interval}"):
        swim(agent, None, engine="numba", interval=40)


WORLDS_OF_SWIMS = [
    "none",
    "caudal:dead",
    "left_pectoral:dead@1; right_pectoral:weak=0.5",
    "gyro:noise=0.2; up_z:dropped@0.5",
    "random:severe@1-2",
    "random:moderate",
]


@pytest.mark.pybullet
@pytest.mark.parametrize("damage", WORLDS_OF_SWIMS)
@pytest.mark.parametrize("interval", [nightly(interval) for interval in range(1, 21)])
def test_swim_scores_and_evaluate_are_the_same_swim(interval: int, damage: str) -> None:
    """Of random controllers with a memory, a clock and fins that they reckon, on both engines."""
    seconds = 0.01 * interval * (300 // interval)
    rng = np.random.default_rng([interval, WORLDS_OF_SWIMS.index(damage)])
    template = Template.of_class("recurrent", Senses(clock=2, fins=True), 4, interval)
    body = damaged_at_random(Morphology.nominal(), 1, interval)[0]
    vector = 0.4 * rng.standard_normal(template.size)
    controller = template.controller(vector, 0.3 + rng.random(), body, 0)
    pose = rng.uniform(-np.pi, np.pi, 3)
    seed = int(rng.integers(1000))
    task = SwimForward(seconds=seconds, ctrl_weight=0.0)
    played = evaluate(
        controller, episodes=1, seed=seed, task=task, frame_skip=interval, damage=damage,
        morphology=body, fin_angles=pose, dtype="float64", engine="numba",
    )  # fmt: skip
    expected = played.y_position[-1, 0]
    for engine in ("numba", "pybullet"):
        path = swim(controller, body, pose, engine, seconds, damage=damage, seed=seed)
        assert path.distance == pytest.approx(expected, abs=1e-4)
        np.testing.assert_allclose(
            np.interp(0.01 * interval * np.arange(len(played.y_position)), path.time,
                      path.position[:, 1]),
            played.y_position[:, 0], atol=1e-4,
        )  # fmt: skip
        (far,) = scores(
            [controller], body, [pose], task=task, damage=damage, seed=seed, engine=engine,
            dtype="float64",
        )[0]  # fmt: skip
        assert far == pytest.approx(expected, abs=1e-4)
    if damage == "none":
        (far,) = scores([controller], body, [pose], seconds, dtype="float64")[0]
        assert far == pytest.approx(expected, abs=1e-4)
    assert np.abs(played.y_position).max() > 1e-3


def test_a_policy_follows_the_clock_in_whole_intervals() -> None:
    """A loop on a robot is late by some milliseconds, and now and then by more."""
    controller = random_controller(7)
    seen = np.random.default_rng(0).uniform(-1.0, 1.0, (12, 9))
    plain, late = controller.policy(), controller.policy()
    jitter = np.random.default_rng(1).uniform(-0.004, 0.06, 12)
    jitter[0] = 0.0
    for k, observation in enumerate(seen):
        expected = plain(observation, 0.07 * k)
        np.testing.assert_array_equal(late(observation, 0.07 * k + jitter[k]), expected)
        held = late(np.ones(9), 0.07 * k + 0.06)
        np.testing.assert_array_equal(held, expected)
    with pytest.raises(InvalidArgumentError, match="make another policy for another swim"):
        late(np.zeros(9), 0.0)


def test_intervals_that_a_policy_missed_are_of_the_action_in_force() -> None:
    """Its clock and its fins go on by them; a network without a memory then acts the same."""
    senses = Senses(imu=False, clock=1, fins=True)
    rng = np.random.default_rng(4)
    weights = np.hstack([rng.normal(size=(3, len(senses.names()))), np.zeros((3, 3))])
    plain = Controller(weights, np.zeros(3), np.ones(3), 0.7, Morphology.nominal(), 0,
                       senses=senses, interval=10)  # fmt: skip
    gain = np.array([1.0, 0.5, -1.0])
    fins = np.array([0.3, -1.0, 2.0])
    policy = plain.policy(fins, gain)
    first = policy(np.zeros(9), 5.0)
    found = policy(np.zeros(9), 5.44)
    fins = reckoned(fins[None], first[None], 0.4, gain)[0]
    again = ControllerAgent(plain, gain)
    again.reset({"fin_angles": fins})
    np.testing.assert_allclose(found, again._act(np.zeros((1, 9)), 5.4)[0], atol=1e-12)
    assert np.abs(found - first).max() > 1e-3
    np.testing.assert_array_equal(policy(np.ones(9), 5.49), found)
    assert (policy(np.zeros(9), 5.5) != found).any()


@pytest.mark.parametrize("kind", [np.int64, np.int32])
def test_an_interval_of_numpy_is_an_interval(kind: Any) -> None:
    controller = replace(random_controller(7), interval=kind(7))
    assert type(controller.interval) is int
    agent = Acting()
    agent.interval = kind(7)  # type: ignore[attr-defined]
    for one in (controller, agent):
        with pytest.raises(InvalidArgumentError, match="frame_skip must be 7"):
            evaluate(one, episodes=1)
    agent.interval = 0.07  # type: ignore[attr-defined]
    with pytest.raises(InvalidArgumentError, match="interval of the controller must be a whole"):
        evaluate(agent, episodes=1)


class Timed:
    """Functions of all kinds that take the time, and note it."""

    def __init__(self) -> None:
        self.times: list[Any] = []

    def note(self, observation: Any, time: Any) -> Any:
        assert np.shape(observation) == (9,)
        self.times.append(time)
        return ACTION

    def __call__(self, observation: Any, time: Any = 7.0) -> Any:
        return self.note(observation, time)

    def policy_like(self, observation: Any, clock: Any = 7.0) -> Any:
        return self.note(observation, clock)

    def named(self, observation: Any, *, time: Any = 7.0) -> Any:
        return self.note(observation, time)

    def needed(self, observation: Any, *, time: Any) -> Any:
        return self.note(observation, time)

    def more(self, scale: Any, observation: Any, time: Any = 7.0) -> Any:
        assert scale == 2.0
        return self.note(observation, time)


@nb.njit  # type: ignore[untyped-decorator]
def compiled_policy(observation: Any, time: Any = 7.0) -> Any:  # noqa: ARG001
    return np.array([0.2, -0.4, min(time, 1.0)])


TIMED: dict[str, Callable[[Timed], Any]] = {
    "function": lambda timed: lambda observation, time: timed.note(observation, time),
    "default": lambda timed: lambda observation, time=7.0: timed.note(observation, time),
    "another name": lambda timed: timed.policy_like,
    "three arguments": lambda timed: lambda o, t=7.0, scale=1.0: timed.note(o, t * scale),
    "arguments": lambda timed: lambda *given: timed.note(*given),
    "keyword": lambda timed: timed.named,
    "needed keyword": lambda timed: timed.needed,
    "keywords": lambda timed: lambda observation, **given: timed.note(observation, **given),
    "object": lambda timed: timed,
    "partial": lambda timed: functools.partial(timed.more, 2.0),
    "partial by name": lambda timed: functools.partial(timed.named),
    "policy()": lambda timed: SimpleNamespace(policy=lambda: timed.named),
}


@pytest.mark.parametrize("kind", TIMED)
def test_a_function_that_can_take_the_time_is_given_it_everywhere(kind: str) -> None:
    timed = Timed()
    steer = TIMED[kind](timed)
    swim(steer, None, engine="numba", seconds=0.6, interval=20)
    np.testing.assert_allclose(timed.times, [0.0, 0.2, 0.4])
    timed.times.clear()
    evaluate(steer, episodes=1, max_episode_steps=3)
    np.testing.assert_allclose(timed.times, [0.0, 0.2, 0.4])
    timed.times.clear()
    swim(steer, None, engine="numba", seconds=0.1)
    np.testing.assert_allclose(timed.times, [0.0, 0.05])
    timed.times.clear()
    LiveSwim(pilot_of(steer)).advance(3)
    np.testing.assert_allclose(timed.times, [0.0, 0.05, 0.1])
    assert held_steps(steer) == 5


def test_functions_in_machine_code_are_given_the_time() -> None:
    plain = swim(lambda _, time: (0.2, -0.4, min(time, 1.0)), None, engine="numba", seconds=2.0)
    assert swim(compiled_policy, None, engine="numba", seconds=2.0).distance == plain.distance
    one = evaluate(compiled_policy, episodes=2).returns
    two = evaluate(lambda _, time: (0.2, -0.4, min(time, 1.0)), episodes=2).returns
    np.testing.assert_array_equal(one, two)
    assert takes_time(max)  # it has no signature


@pytest.mark.parametrize(
    "steer",
    [
        lambda observations: np.tile(ACTION, (len(observations), 1)),
        lambda observations, *, scale=1.0: scale * np.tile(ACTION, (len(observations), 1)),
        functools.partial(
            lambda o, time: np.tile(ACTION, (int(time // 7.0) * len(o), 1)), time=7.0
        ),
    ],
)
def test_other_functions_are_of_the_observations_alone(steer: Any) -> None:
    assert not takes_time(steer)
    assert held_steps(steer) == 20
    plain = evaluate(Acting(), episodes=2).returns
    np.testing.assert_array_equal(evaluate(steer, episodes=2).returns, plain)
    assert swim(steer, None, engine="numba", seconds=1.0).distance == pytest.approx(
        swim(Acting(), None, engine="numba", seconds=1.0).distance
    )


@pytest.mark.parametrize("wrong", [lambda: ACTION, lambda o, t, more: ACTION])  # noqa: ARG005
def test_a_function_of_other_arguments_is_refused(wrong: Any) -> None:
    for door in (lambda: swim(wrong, None, engine="numba"), lambda: evaluate(wrong, episodes=1)):
        with pytest.raises(InvalidArgumentError, match="called with observations alone, or with"):
            door()


# A controller's agent: the network on plain floats, and copies of it.

ANGLES = np.array([[1.0, 2.0, 3.0], [0.5, -1.0, 4.0]])
GAIN = (1.0, 0.5, -1.0)


def recurrent(seed: int = 3, goal: bool = False) -> Controller:
    """Return a random network with a memory that senses its fins."""
    template = Template.of_class("recurrent", Senses(fins=True, goal=goal), 5, 20)
    vector = 0.5 * np.random.default_rng(seed).standard_normal(template.size)
    return template.controller(vector, 0.7, Morphology.nominal(), seed)


def drawn(steps: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (steps, 2, 12))


def test_the_agent_is_the_network_on_plain_floats_to_the_last_bit() -> None:
    controllers = [recurrent(seed, goal=True) for seed in (3, 4)]
    together = ProgramAgent(program_of(controllers), ANGLES, GAIN)
    alone = []
    for controller, angles in zip(controllers, ANGLES, strict=True):
        genes, layout = controller.genes().tolist(), controller.layout().tolist()
        alone.append((genes, layout, [0.0] * 100, (angles / TAU).tolist()))
    respond = responder(AQUAFISH)
    for k, observations in enumerate(drawn(30)):
        actions = together.act(observations, 0.2 * k)
        for i, (genes, layout, memory, fins) in enumerate(alone):
            o = observations[i].tolist()
            action = respond(
                genes, layout, memory, 0, 1, 0.2 * k, o[:3], o[3:6], o[6:9], fins, o[9:]
            )
            assert actions[i].tolist() == list(action)
            speeds = [g * s for g, s in zip(GAIN, lane_servo_speeds(AQUAFISH, action), strict=True)]
            fins[:] = reckon(fins, speeds, 0.2)
    np.testing.assert_allclose(together.fin_angles, [TAU * np.array(one[3]) for one in alone])


def test_a_copy_goes_on_by_itself() -> None:
    agent = ControllerAgent(recurrent(), GAIN)
    agent.reset({"fin_angles": ANGLES})
    seen = drawn(12)[:, :, :9]
    for observations in seen[:4]:
        agent.act(observations)
    ahead = agent.copy()
    imagined = [ahead.act(observations) for observations in seen[4:]]
    np.testing.assert_array_equal([agent.act(observations) for observations in seen[4:]], imagined)
    np.testing.assert_array_equal(agent.fin_angles, ahead.fin_angles)
    ahead.fin_angles = ANGLES
    assert (agent.fin_angles != ANGLES).any()
    assert (agent.act(seen[0]) != ahead.act(seen[0])).any()


def test_one_robot_needs_no_batch() -> None:
    controller = recurrent()
    batch, alone = ControllerAgent(controller), ControllerAgent(controller)
    batch.reset({"fin_angles": ANGLES})
    alone.reset({"fin_angles": ANGLES[1]})
    for observations in drawn(5):
        np.testing.assert_array_equal(batch.act(observations)[1], alone.act(observations[1]))
    with pytest.raises(InvalidArgumentError, match=r"observations must have shape \(2, 9 or more"):
        batch.act(np.zeros(9))


def test_the_inputs_of_learners_are_those_of_the_agent() -> None:
    controller = recurrent()
    agent = ControllerAgent(controller)
    agent.reset({"fin_angles": ANGLES})
    inputs = NetworkInputs(controller.senses, controller.clock, 20, np.zeros((2, 3)))
    inputs.begin([0, 1], ANGLES)
    genes, layout = controller.genes().tolist(), controller.layout().tolist()
    count = len(controller.senses.names())
    values = [[0.0] * (count + 2 * controller.nodes) for _ in ANGLES]
    for observations in drawn(10)[:, :, :9]:
        actions = agent.act(observations)
        for row, seen, action in zip(values, inputs.observe(observations), actions, strict=True):
            row[:count] = seen.tolist()
            forward(genes, layout, row, 0, 1, 0.0)
            last = count + controller.nodes
            assert row[last - 3 : last] == pytest.approx(action, abs=1e-6)
        inputs.follow(actions)
        np.testing.assert_allclose(inputs.fin_angles, agent.fin_angles, atol=1e-5)


# Scores.


def test_returns_are_those_of_single_environments() -> None:
    action = np.array(ACTION, np.float32)
    options: Any = {"damage": "random:severe", "dtype": "float64"}
    found = evaluate(lambda seen: np.tile(action, (len(seen), 1)), episodes=2, **options)
    for i in range(2):
        env = gym.make("AquaFish-v0", engine="numba", damage="random:severe", fin_angles="random")
        env.reset(seed=FIRST_SEED + i)
        rewards, over, info = [], False, {}
        while not over:
            _, reward, terminated, truncated, info = env.step(action)
            rewards.append(reward)
            over = terminated or truncated
        assert found.returns[i] == pytest.approx(sum(rewards), abs=1e-9)
        assert found.y_position[-1, i] == pytest.approx(info["y_position"], abs=1e-9)


def test_the_distance_after_the_onset_is_counted_from_there() -> None:
    found = evaluate(Acting(), "AquaFishRecovery-v0", episodes=3)
    assert (found.onset > 0).all()
    way = [found.y_position[-1, i] - found.y_position[s, i] for i, s in enumerate(found.onset)]
    np.testing.assert_allclose(found.way_since(found.onset), way)


def test_the_interval_of_the_interquartile_mean_covers_it() -> None:
    runs = np.random.default_rng(1).normal(3.0, 1.0, (5, 100))
    middle, low, high = interquartile_mean(runs)
    assert low < middle < high
    assert middle == pytest.approx(3.0, abs=0.2)
    assert interquartile_mean([[5.0] * 4]) == (5.0, 5.0, 5.0)
