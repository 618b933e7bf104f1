"""Agents: whatever steers robots, behind one protocol.

:func:`make_agent` adapts a function, a policy, a model or a controller to an environment, and
:func:`make_policy` adapts it to a swim of one robot.
"""

from __future__ import annotations

import copy
import functools
import inspect
from collections.abc import Callable, Sequence
from numbers import Real
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.plans import AQUAFISH, BodyPlan, check_same_plan, plan_of
from aquafish_gym.rollout.plan import Act
from aquafish_gym.scenario import CHANNELS, TIMESTEP
from aquafish_gym.utils.array_types import Floats, Observations
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    finite_array,
    instance,
    integer,
)
from gait.controllers.controller import INTERVAL, Controller, check_controllers, program_of
from gait.controllers.inputs import reckoned
from gait.controllers.network_agent import NetworkAgent, fin_angles_of

FRAME_SKIP = 20  # steps of 0.01 s for which the environments hold an action by default
MAXIMUM_INTERVAL = 2000
KINDS = (
    "a function of observations (E, k), or of an observation and the time; an object with "
    "act(observations), with predict(observations), as a model of stable-baselines3, or with "
    "policy(); or a Controller"
)


class Agent(Protocol):
    """What steers the E robots of an environment.

    ``gait.swim`` and ``gait.evaluate`` take it, and all that :func:`make_agent` adapts to it.
    """

    def reset(self, info: dict[str, Any], /) -> None:
        """Begin new episodes, given the ``info`` that the environment's reset returned."""

    def act(self, observations: Observations, /) -> ArrayLike:
        """Return actions (E, F) in [-1, 1] for observations (E, k)."""


class ControllerAgent(NetworkAgent):
    """An agent by a controller: for one robot, or for all robots of a batched environment.

    It keeps their clock, their network's memory and the fin angles by dead reckoning. A reading
    that is not finite, or outside of the observation space, is not observed: the controller senses
    the last one of that channel, or 0 before there is one.

    Parameters
    ----------
    controller
        One for all robots, or a list of controllers of one ``kind``, one for each robot. Its
        ``interval`` must be the environment's ``frame_skip``.
    believed_gain
        (F,) the servo gains by which it reckons its fins from its commands; None is 1 for each.

    Attributes
    ----------
    controller
        The first robot's.
    interval
        For how many steps of 0.01 s an action is held.
    plan
        The robots' body plan.

    Examples
    --------
    >>> from aquafish_gym import Morphology
    >>> body = Morphology.nominal()
    >>> silent = Controller(np.zeros((3, 14)), np.zeros(3), np.ones(3), 0.7, body, seed=0)
    >>> agent = ControllerAgent(silent)
    >>> agent.reset({"fin_angles": np.zeros(3)})
    >>> agent.act(np.zeros(9)).tolist()
    [0.0, 0.0, 0.0]
    """

    def __init__(
        self,
        controller: Controller | Sequence[Controller],
        believed_gain: ArrayLike | None = None,
    ) -> None:
        if isinstance(controller, list | tuple):
            controllers = check_controllers(controller)
        else:
            controllers = [instance("controller", controller, Controller)]
        super().__init__(program_of(controllers), believed_gain)
        self.controller = controllers[0]


def make_agent(
    controller: object,
    interval: int | None = None,
    dt: float | None = None,
    argument: str = "agent",
    plan: BodyPlan | None = None,
) -> Agent:
    """Return an agent that acts by a controller of any of the ``KINDS``.

    An object with ``act`` may lack ``reset``. One with ``begin(fin_angles)``, of angles (F,) in
    rad, is of one robot, and its ``act`` of an observation (k,): each robot has a copy of it.

    Parameters
    ----------
    controller
        The controller of one robot, or of E robots.
    interval
        For how many steps of 0.01 s the environment holds an action; None if unknown.
    dt
        The same in s, for a function of the time; None follows from ``interval``.
    argument
        The controller's name in errors.
    plan
        The body plan of the robots; None if unknown.

    Raises
    ------
    InvalidArgumentError
        If the controller is of no such kind, is of another plan, holds its actions for another
        number of steps, or takes the time where ``dt`` is unknown.
    """
    if plan is not None:
        check_same_plan(argument, plan_of(controller, default=plan), plan)
    own = own_interval(controller)
    if own is not None and own != interval:
        raise InvalidArgumentError(
            f"frame_skip must be {own}, the controller's interval; got {interval}"
        )
    if isinstance(controller, Controller):
        return ControllerAgent(controller)
    if _has(controller, "act"):
        if _has(controller, "begin"):
            return _EachRobot(functools.partial(_begin, controller), 1.0)
        if _has(controller, "reset"):
            found: Agent = controller  # type: ignore[assignment]
            return found
        return _Function(controller.act)  # type: ignore[attr-defined]
    if _has(controller, "predict"):
        return _Model(controller, argument)
    if not callable(controller) and not _has(controller, "policy"):
        raise InvalidArgumentError(f"{argument} must be {KINDS}; got {brief(controller)}")
    if not takes_time(controller):
        return _Function(controller)  # type: ignore[arg-type]
    if dt is None and interval is not None:
        dt = interval * TIMESTEP
    if dt is None:
        raise InvalidArgumentError(
            f"{argument} must be a function of the observations alone: env has no time step, dt"
        )
    return _EachRobot(lambda _, robots: [_policy_of(controller) for _ in range(robots)], dt)


def make_policy(
    controller: object,
    interval: int,
    fin_angles: Floats,
    servo_gain: Floats,
    observe_fins: str | bool = False,
    plan: BodyPlan = AQUAFISH,
) -> Act:
    """Return a policy of one robot that acts as its controller would in an environment.

    Parameters
    ----------
    controller
        Of any of the ``KINDS``.
    interval
        For how many steps of 0.01 s an action is held.
    fin_angles, servo_gain
        (F,) initial angles in rad, and servo gains, that a controller assumes which uses them.
    observe_fins
        ``"reckoned"`` appends the sines and cosines of the fin angles to the observation, as the
        environments do: they are integrated from ``fin_angles`` by the commands and
        ``servo_gain``. False does not.
    plan
        The robot's body plan.

    Raises
    ------
    InvalidArgumentError
        As :func:`make_agent`.
    """
    check_same_plan("controller", plan_of(controller, default=plan), plan)
    if isinstance(controller, Controller):
        return controller.policy(fin_angles, servo_gain)
    if takes_time(controller):
        act = _policy_of(controller)
    else:
        agent = make_agent(controller, interval, argument="controller")
        agent.reset({"fin_angles": fin_angles[None]})

        def act(observation: Floats, _time: float) -> Floats:
            actions = agent.act(observation[None].astype(np.float32))
            return np.asarray(actions, np.float64).reshape(len(plan.fins))

    if not observe_fins:
        return act
    angles = fin_angles[None]

    def act_with_fins(observation: Floats, time: float) -> Floats:
        nonlocal angles
        imu, goal = np.split(observation, [len(CHANNELS)])
        seen = np.concatenate([imu, *np.sin(angles), *np.cos(angles), goal])
        action = finite_array("action", act(seen, time), (len(plan.fins),))
        angles = reckoned(angles, action[None], interval * TIMESTEP, servo_gain, plan)
        return action

    return act_with_fins


class Beliefs(NamedTuple):
    """Whether a controller of one robot uses what it is given of its fins and servos."""

    angles: bool  #: Initial fin angles.
    gains: bool  #: Servo gains.


def beliefs_of(controller: object, observe_fins: str | bool = False) -> Beliefs:
    """Return what a controller uses; for the arguments see :func:`make_policy`.

    Raises
    ------
    InvalidArgumentError
        If ``observe_fins`` does not fit.
    """
    reckons = isinstance(observe_fins, str) and observe_fins == "reckoned"
    if not reckons and observe_fins is not False:
        raise InvalidArgumentError(
            'observe_fins must be False or "reckoned", as a swim has no sensors of fin angles; '
            f"got {brief(observe_fins)}"
        )
    if isinstance(controller, Controller):
        if reckons:
            raise InvalidArgumentError(
                "observe_fins must be False for a Controller, whose senses say whether it reckons "
                f"its fins; got {brief(observe_fins)}"
            )
        return Beliefs(controller.senses.fins, controller.senses.fins)
    begins = _has(controller, "act") and (_has(controller, "reset") or _has(controller, "begin"))
    return Beliefs(reckons or begins, reckons)


def refuse_unused(is_used: bool, name: str, belief: object) -> None:
    """Raise InvalidArgumentError for a belief that a controller does not use; None is not given."""
    if belief is not None and not is_used:
        raise InvalidArgumentError(
            f"{name} must not be given to a controller that does not sense its fins or has "
            f"beliefs of its own; got {brief(belief)}"
        )


def own_interval(controller: object) -> int | None:
    """Return for how many steps of 0.01 s a controller holds its actions; None if unspecified."""
    for name in ("interval", "hold"):
        if isinstance(steps := getattr(controller, name, None), Real):
            return integer(f"{name} of the controller", steps, 1)
    return None


def held_steps(controller: object, interval: int | None = None) -> int:
    """Return for how many steps of 0.01 s an action of a controller is held; see ``gait.swim``."""
    own = own_interval(controller)
    if interval is None:
        usual = INTERVAL if takes_time(controller) else FRAME_SKIP
        return usual if own is None else own
    steps = integer("interval", interval, 1, MAXIMUM_INTERVAL)
    if own not in (None, steps):
        raise InvalidArgumentError(f"interval must be {own}, the controller's; got {interval}")
    return steps


def takes_time(controller: object) -> bool:
    """Return whether a controller is a policy of one robot: of an observation and the time.

    So is an object with ``policy()``, which returns one, and every function that can take the time,
    as its second argument or as ``time``. A default does not matter.
    """
    if _has(controller, "act") or _has(controller, "predict"):
        return False
    if _has(controller, "policy"):
        return True
    return callable(controller) and _timed(controller) is not None


def _has(controller: object, method: str) -> bool:
    return callable(getattr(controller, method, None))


def _policy_of(controller: Any) -> Act:
    """Return a policy for one swim."""
    policy = controller.policy() if _has(controller, "policy") else controller
    timed = _timed(policy) if callable(policy) else None
    if timed is None:
        raise InvalidArgumentError(
            "controller must be a function (observation, time) -> action, or have a method "
            f"policy() that returns one; got {brief(controller)}"
        )
    return timed


def _timed(function: Callable[..., Any]) -> Act | None:
    """Return a function as one of an observation and the time; None if it cannot take the time.

    A time that a ``functools.partial`` gives already is not given again. A function without a
    signature, as some in C, takes the time second. InvalidArgumentError if it takes no observation.
    """
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        return function
    if _takes(signature, None, None):
        return function
    fixed = function.keywords if isinstance(function, functools.partial) else {}
    if "time" not in fixed and _takes(signature, None, time=None):
        return lambda observation, time: function(observation, time=time)
    if not _takes(signature, None):
        raise InvalidArgumentError(
            "a controller must be called with observations alone, or with an observation and the "
            f"time; got {brief(function)} of the arguments {signature}"
        )
    return None


def _takes(signature: inspect.Signature, *arguments: None, **named: None) -> bool:
    try:
        signature.bind(*arguments, **named)
    except TypeError:
        return False
    return True


class _Function:
    """An agent without memory: a function of observations."""

    def __init__(self, function: Callable[[Observations], ArrayLike]) -> None:
        self.act = function

    def reset(self, info: dict[str, Any]) -> None:
        """Do nothing."""


class _EachRobot:
    """An agent of robots that each have a policy of their own.

    ``begin`` returns the policies of B robots for the ``info`` of a reset and B; ``dt`` is the
    length of a step, s.
    """

    def __init__(self, begin: Callable[[dict[str, Any], int], list[Act]], dt: float) -> None:
        self._begin = begin
        self._dt = dt

    def reset(self, info: dict[str, Any]) -> None:
        self._info = info
        self._policies: list[Act] = []
        self._steps = 0

    def act(self, observations: Observations) -> ArrayLike:
        if not self._policies:
            self._policies = self._begin(self._info, len(observations))
        time = self._steps * self._dt
        self._steps += 1
        pairs = zip(self._policies, observations.astype(float), strict=True)
        return np.array([policy(observation, time) for policy, observation in pairs], np.float64)


def _begin(agent: Any, info: dict[str, Any], robots: int) -> list[Act]:
    """Return the policies of robots that have an agent each: the agent itself, and copies."""
    agents = [agent, *(copy.deepcopy(agent) for _ in range(robots - 1))]
    for one, angles in zip(agents, fin_angles_of(info), strict=True):
        one.begin(angles)
    return [functools.partial(_act_alone, one) for one in agents]


def _act_alone(agent: Any, observation: Floats, _time: float) -> ArrayLike:
    action: ArrayLike = agent.act(observation)
    return action


class _Model:
    """An agent by a model of stable-baselines3.

    The model's ``VecNormalize``, if it has one, scales the observations.
    """

    def __init__(self, model: Any, argument: str) -> None:
        self._model = model
        self._argument = argument
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
                f"{self._argument} must observe {observations.shape[1:]} numbers; got a model of "
                f"{wanted}: choose the task and observe_fins, of the environment or of swim, with "
                "which it was trained"
            )
        begins = np.full(len(observations), self._begins)
        scaled = self._scaled(observations)
        actions, self._state = self._model.predict(scaled, self._state, begins, deterministic=True)
        self._begins = False
        return actions  # type: ignore[no-any-return]
