"""Adapters from functions, policies, agents and learned models to one interface, :class:`Pilot`.

So ``gait.swim`` and ``gait.evaluate`` take any of them.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from numbers import Real
from typing import Any, NamedTuple, Protocol, TypeAlias, TypeGuard, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.scenario import TIMESTEP
from aquafish_gym.utils.array_types import Floats, Observations
from aquafish_gym.utils.validation import InvalidArgumentError, brief, integer
from gait.controllers.agent import ControllerAgent
from gait.controllers.controller import Controller
from gait.controllers.inputs import reckoned
from gait.controllers.policy import (
    ControllerLike,
    HasPolicy,
    Policy,
    TimeArgument,
    new_policy,
    time_argument,
)

KINDS = (
    "a function of observations (E, k), or of an observation and the time; an object with "
    "act(observations), with predict(observations), as a model of stable-baselines3, or with "
    "policy(); or a Controller"
)


@runtime_checkable
class Agent(Protocol):
    """An agent that acts in E episodes at once; it may also have ``reset(info)``.

    ``reset`` is called when the episodes begin, with the ``info`` of the vector environment. An
    agent of one robot has ``begin(fin_angles)`` instead, with (3,) angles in rad, and ``act`` of a
    single observation (k,); each robot then has a copy of the agent.
    """

    def act(self, observations: Observations) -> ArrayLike:
        """Return actions (E, 3) in [-1, 1] for observations (E, k)."""


@runtime_checkable
class Model(Protocol):
    """A model or policy of stable-baselines3, or an object with the same ``predict``."""

    def predict(
        self,
        observation: Observations,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[ArrayLike, Any]:
        """Return actions (E, 3) for observations (E, k), and the next state of its memory."""


AgentLike: TypeAlias = Agent | Model | ControllerLike | Callable[[Observations], ArrayLike]


class Pilot(Protocol):
    """The controller of E robots at once; :func:`make_pilot` makes it."""

    def reset(self, info: dict[str, Any], /) -> None:
        """Begin new episodes, given the ``info`` that the environment's reset returned."""

    def act(self, observations: Observations, /) -> ArrayLike:
        """Return actions (E, 3) for observations (E, k)."""


def own_interval(controller: object) -> int | None:
    """Return for how many steps of 0.01 s a controller holds its actions; None if unspecified."""
    for name in ("interval", "hold"):
        if isinstance(steps := getattr(controller, name, None), Real):
            return integer(f"{name} of the controller", steps, 1)
    return None


def takes_time(controller: object) -> TypeGuard[ControllerLike]:
    """Return whether a controller is a policy of one robot: of an observation and the time.

    So is every function that can take the time; see :func:`gait.controllers.policy.time_argument`.
    """
    if isinstance(controller, Agent | Model):
        return False
    if isinstance(controller, HasPolicy):
        return True
    return callable(controller) and time_argument(controller) is not TimeArgument.NONE


class Beliefs(NamedTuple):
    """Whether a controller uses the initial fin angles and the servo gains that it is given."""

    angles: bool  #: Initial fin angles.
    gains: bool  #: Servo gains.

    @classmethod
    def of(cls, controller: object) -> Beliefs:
        """Return which of them the controller of one robot uses."""
        if isinstance(controller, Controller):
            return cls(controller.senses.fins, controller.senses.fins)
        shape = getattr(getattr(controller, "observation_space", None), "shape", None)
        # Nine numbers, and the sines and cosines of three fin angles, which it is given reckoned.
        reckons = shape == (15,)
        begins = any(callable(getattr(controller, name, None)) for name in ("reset", "begin"))
        return cls(reckons or (isinstance(controller, Agent) and begins), reckons)


def refuse_unused(is_used: bool, name: str, belief: object) -> None:
    """Raise InvalidArgumentError for a belief that a controller does not use; None is not given."""
    if belief is not None and not is_used:
        raise InvalidArgumentError(
            f"{name} must not be given to a controller that does not sense its fins or has "
            f"beliefs of its own; got {brief(belief)}"
        )


def make_pilot(
    controller: object, frame_skip: int | None, dt: float | None, argument: str = "agent"
) -> Pilot:
    """Return a pilot that acts by a controller of any of the ``KINDS``.

    Parameters
    ----------
    controller
        The controller of one robot, or of E robots.
    frame_skip
        For how many steps of 0.01 s the environment holds an action; None if unknown.
    dt
        The same in s, for a function of the time; None if unknown.
    argument
        The controller's name in errors.

    Raises
    ------
    InvalidArgumentError
        If the controller is of no such kind, holds its actions for another number of steps, or
        takes the time where ``dt`` is unknown.
    """
    own = own_interval(controller)
    if own is not None and own != frame_skip:
        raise InvalidArgumentError(
            f"frame_skip must be {own}, the controller's interval; got {frame_skip}"
        )
    if isinstance(controller, Controller):
        return ControllerAgent(controller)
    if isinstance(controller, Agent):
        return (
            _Each(controller) if callable(getattr(controller, "begin", None)) else _All(controller)
        )
    if isinstance(controller, Model):
        return _Predicting(controller)
    if callable(controller) and not takes_time(controller):
        return _Reflex(controller)
    if not callable(controller) and not isinstance(controller, HasPolicy):
        raise InvalidArgumentError(f"{argument} must be {KINDS}; got {brief(controller)}")
    if dt is None:
        raise InvalidArgumentError(
            f"{argument} must be a function of the observations alone: env has no time step, dt"
        )
    return _Policies(controller, dt)


def reckoning(
    pilot: Pilot,
    controller: object,
    fins: Floats,
    gain: Floats,
    hold: int,
) -> Policy:
    """Return a policy of one robot that acts as its pilot would in an environment.

    A model that observes 15 numbers is given fin angles by dead reckoning, as with
    ``observe_fins="reckoned"``. They are integrated from the initial angles ``fins`` (3,) in rad,
    with the model's commands and the servo gains ``gain`` (3,). ``hold`` is for how many steps of
    0.01 s an action is held. ``controller`` is the pilot's controller.
    """
    sees_fins = Beliefs.of(controller).gains
    angles = fins[None]
    pilot.reset({"fin_angles": angles})

    def policy(observation: Floats, time: float) -> Floats:  # noqa: ARG001
        nonlocal angles
        seen = observation[None]
        if sees_fins:
            seen = np.hstack([seen, np.sin(angles), np.cos(angles)])
        actions = np.asarray(pilot.act(seen.astype(np.float32)), np.float64).reshape(1, 3)
        angles = reckoned(angles, actions, hold * TIMESTEP, gain)
        return np.asarray(actions[0])

    return policy


class _All:
    """The pilot of an agent that acts for all robots, with or without ``reset``."""

    def __init__(self, agent: Agent) -> None:
        self.act = agent.act
        self._reset = getattr(agent, "reset", None)

    def reset(self, info: dict[str, Any]) -> None:
        if callable(self._reset):
            self._reset(info)


class _Each:
    """The pilot of an agent of one robot: the first robot has the agent, the others copies."""

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
    """The pilot of a stable-baselines3 model.

    The model's ``VecNormalize``, if it has one, scales the observations.
    """

    def __init__(self, model: Any) -> None:
        self._model = model
        normal = getattr(model, "get_vec_normalize_env", lambda: None)()
        self._scaled = normal.normalize_obs if normal is not None else lambda seen: seen

    def reset(self, info: dict[str, Any]) -> None:  # noqa: ARG002
        self._state = None
        self._begins = True

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
    """The pilot of a function of observations."""

    def __init__(self, function: Callable[[Observations], ArrayLike]) -> None:
        self.act = function

    def reset(self, info: dict[str, Any]) -> None:
        """Do nothing: the function has no memory."""


class _Policies:
    """The pilot of policies, a new one for each robot, which are called with the time."""

    def __init__(self, controller: Any, dt: float) -> None:
        self._controller = controller
        self._dt = dt

    def reset(self, info: dict[str, Any]) -> None:  # noqa: ARG002
        self._policies: list[Policy] = []
        self._steps = 0

    def act(self, observations: Observations) -> ArrayLike:
        if not self._policies:
            self._policies = [new_policy(self._controller) for _ in observations]
        time = self._steps * self._dt
        self._steps += 1
        pairs = zip(self._policies, observations.astype(float), strict=True)
        return np.array([policy(observation, time) for policy, observation in pairs], np.float64)
