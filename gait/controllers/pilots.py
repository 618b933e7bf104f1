"""Whatever steers robots, as one kind of agent: functions, policies, agents and learned models.

``gait.swim`` and ``gait.evaluate`` take them alike.
"""

from __future__ import annotations

import copy
import inspect
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, TypeAlias, TypeGuard, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.command import reckon, servo_speeds
from aquafish_gym.physics.arithmetic import TAU, Vector
from aquafish_gym.scenario import TIMESTEP
from aquafish_gym.utils.array_types import Observations
from aquafish_gym.utils.validation import InvalidArgumentError, brief
from gait.controllers.agent import ControllerAgent
from gait.controllers.controller import Controller
from gait.controllers.policy import ControllerLike, HasPolicy, Policy, new_policy

_OBSERVED, _FIN_WAVES = 9, 6  # numbers of an observation, and of fin angles as sines and cosines
KINDS = (
    "a function of observations (E, k), or of an observation and the time; an object with "
    "act(observations), with predict(observations), as a model of stable-baselines3, or with "
    "policy(); or a Controller"
)


@runtime_checkable
class Agent(Protocol):
    """An agent that acts in E episodes at once; it may also have ``reset(info)``.

    ``reset`` is called when the episodes begin, with the ``info`` of the vector environment. An
    agent of one robot has ``begin(fin_angles)`` instead, and each robot a copy of it.
    """

    def act(self, observations: Observations) -> ArrayLike:
        """Return actions (E, 3) in [-1, 1] for observations (E, k)."""


@runtime_checkable
class Model(Protocol):
    """A model or policy of stable-baselines3, or what predicts as these do."""

    def predict(
        self,
        observation: Observations,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[ArrayLike, Any]:
        """Return actions (E, 3) and the next state, of observations (E, k)."""


AgentLike: TypeAlias = Agent | Model | ControllerLike | Callable[[Observations], ArrayLike]


class Pilot(Protocol):
    """What steers E robots; see :func:`make_pilot`."""

    def reset(self, info: dict[str, Any], /) -> None:
        """Begin the episodes that begin with ``info``."""

    def act(self, observations: Observations, /) -> ArrayLike:
        """Return actions (E, 3) for observations (E, k)."""


def own_interval(steers: object) -> int | None:
    """Return for how many steps of 0.01 s something holds its actions, if it says so."""
    for name in ("interval", "hold"):
        if isinstance(steps := getattr(steers, name, None), int):
            return steps
    return None


def takes_time(steers: object, *, optional: bool = False) -> TypeGuard[ControllerLike]:
    """Return whether it is a policy of one robot, a function of an observation and the time.

    With ``optional`` also if it need not be given the time, or does not tell what it takes.
    """
    if isinstance(steers, Agent | Model):
        return False
    if isinstance(steers, HasPolicy):
        return True
    if not callable(steers):
        return False
    try:
        given = inspect.signature(steers).parameters.values()
    except (TypeError, ValueError):
        return optional
    by_place = [p for p in given if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    if optional:
        return len(by_place) != 1 or any(p.kind is p.VAR_POSITIONAL for p in given)
    return sum(p.default is p.empty for p in by_place) > 1


class Beliefs(NamedTuple):
    """Whether a controller uses what it is given of its fins."""

    angles: bool  #: Initial fin angles.
    gains: bool  #: Servo gains.

    @classmethod
    def of(cls, steers: object) -> Beliefs:
        """Return those of whatever steers one robot."""
        if isinstance(steers, Controller):
            return cls(steers.senses.fins, steers.senses.fins)
        shape = getattr(getattr(steers, "observation_space", None), "shape", None)
        reckons = shape == (_OBSERVED + _FIN_WAVES,)
        begins = any(callable(getattr(steers, name, None)) for name in ("reset", "begin"))
        return cls(reckons or (isinstance(steers, Agent) and begins), reckons)

    def check(self, **given: tuple[str, object, bool]) -> None:
        """Refuse what was given without effect: field -> the argument's name, value, whether."""
        for field, (name, value, is_given) in given.items():
            if is_given and not getattr(self, field):
                raise InvalidArgumentError(
                    f"{name} must not be given to a controller that does not sense its fins or has "
                    f"beliefs of its own; got {brief(value)}"
                )


def make_pilot(
    steers: object, frame_skip: int | None, dt: float | None, argument: str = "agent"
) -> Pilot:
    """Return a pilot from any of ``KINDS``.

    Parameters
    ----------
    steers
        Which steers one robot or E of them.
    frame_skip
        For how many steps of 0.01 s its actions will be held; None if that is not known.
    dt
        How long an action is held, in s, for a function of the time; None if that is not known.
    argument
        Its name in errors.

    Raises
    ------
    InvalidArgumentError
        If it is none of these, or holds its actions for another time.
    """
    own = own_interval(steers)
    if own is not None and own != frame_skip:
        raise InvalidArgumentError(
            f"frame_skip must be {own}, the controller's interval; got {frame_skip}"
        )
    if isinstance(steers, Controller):
        return ControllerAgent(steers)
    if isinstance(steers, Agent):
        return _Each(steers) if callable(getattr(steers, "begin", None)) else _All(steers)
    if isinstance(steers, Model):
        return _Predicting(steers)
    if callable(steers) and not takes_time(steers):
        return _Reflex(steers)
    if not callable(steers) and not isinstance(steers, HasPolicy):
        raise InvalidArgumentError(f"{argument} must be {KINDS}; got {brief(steers)}")
    if dt is None:
        raise InvalidArgumentError(
            f"{argument} must be a function of the observations alone: env has no time step, dt"
        )
    return _Policies(steers, dt)


def reckoning(
    pilot: Pilot, steers: object, fins: NDArray[np.float64], gain: NDArray[np.float64], hold: int
) -> Policy:
    """Return the policy of one robot that a pilot steers in an environment.

    A model that observes 15 numbers sees its fins as ``observe_fins="reckoned"`` shows them: from
    the angles ``fins`` (3,) in rad, its commands and the servo gains (3,). ``hold`` is for how
    many steps of 0.01 s an action is held.
    """
    sees_fins = Beliefs.of(steers).gains
    turns = TAU * TIMESTEP * hold
    angles: Vector = (float(fins[0]), float(fins[1]), float(fins[2]))
    pilot.reset({"fin_angles": fins[None]})

    def policy(observation: NDArray[np.float64], time: float) -> ArrayLike:  # noqa: ARG001
        nonlocal angles
        seen = observation
        if sees_fins:
            seen = np.concatenate([observation, np.sin(angles), np.cos(angles)])
        (action,) = np.asarray(pilot.act(seen[None].astype(np.float32)), np.float64).reshape(-1, 3)
        left, right, caudal = np.clip(action, -1.0, 1.0)
        speeds = servo_speeds((left, right, caudal))
        angles = reckon(angles, tuple(g * s for g, s in zip(gain, speeds, strict=True)), turns)
        return action

    return policy


class _All:
    """An agent of all robots, with or without ``reset``."""

    def __init__(self, agent: Agent) -> None:
        self.act = agent.act
        self._reset = getattr(agent, "reset", None)

    def reset(self, info: dict[str, Any]) -> None:
        if callable(self._reset):
            self._reset(info)


class _Each:
    """An agent of one robot, which one robot has itself, and several each a copy of."""

    def __init__(self, agent: Any) -> None:
        self._agent = agent

    def reset(self, info: dict[str, Any]) -> None:
        fins = np.asarray(info["fin_angles"], float).reshape(-1, 3)
        more = [copy.deepcopy(self._agent) for _ in fins[1:]]
        self._agents = [self._agent, *more]
        for agent, angles in zip(self._agents, fins, strict=True):
            agent.begin(angles)

    def act(self, observations: Observations) -> ArrayLike:
        pairs = zip(self._agents, observations, strict=True)
        return np.array([agent.act(observation) for agent, observation in pairs], np.float64)


class _Predicting:
    """A model of stable-baselines3; its ``VecNormalize``, if it has one, scales observations."""

    def __init__(self, model: Any) -> None:
        self._model = model
        normal = getattr(model, "get_vec_normalize_env", lambda: None)()
        self._scaled = normal.normalize_obs if normal is not None else lambda seen: seen

    def reset(self, info: dict[str, Any]) -> None:  # noqa: ARG002
        self._state, self._begins = None, True

    def act(self, observations: Observations) -> ArrayLike:
        space = getattr(self._model, "observation_space", None)
        wanted = getattr(space, "shape", None)
        if wanted not in (None, observations.shape[1:]):
            raise InvalidArgumentError(
                f"agent must observe {observations.shape[1:]} numbers as env has them; got a model "
                f"of {wanted}: observe_fins and the task set how many"
            )
        begins = np.full(len(observations), self._begins)
        scaled = self._scaled(observations)
        actions, self._state = self._model.predict(scaled, self._state, begins, deterministic=True)
        self._begins = False
        return actions  # type: ignore[no-any-return]


class _Reflex:
    """A function of observations."""

    def __init__(self, function: Callable[[Observations], ArrayLike]) -> None:
        self.act = function

    def reset(self, info: dict[str, Any]) -> None:
        """Do nothing: it has no memory."""


class _Policies:
    """A policy of its own for each robot, and the time."""

    def __init__(self, controller: Any, dt: float) -> None:
        self._controller, self._dt = controller, dt

    def reset(self, info: dict[str, Any]) -> None:
        self._policies, self._steps = [new_policy(self._controller) for _ in info["fin_angles"]], 0

    def act(self, observations: Observations) -> ArrayLike:
        time = self._steps * self._dt
        self._steps += 1
        pairs = zip(self._policies, observations.astype(float), strict=True)
        return np.array([policy(observation, time) for policy, observation in pairs], np.float64)
