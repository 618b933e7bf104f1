"""The swim of one robot, by whatever steers it, on any engine."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.engines.api import TIMESTEP, check_engine
from aquafish_gym.envs.episode import begin_episodes, check_episode
from aquafish_gym.envs.tasks import SwimForward
from aquafish_gym.morphology import Morphology, MorphologyLike
from aquafish_gym.plans import plan_of
from aquafish_gym.rollout import rollout
from aquafish_gym.utils.array_types import Floats, Triple
from aquafish_gym.utils.validation import finite_array, instance, integer
from aquafish_gym.world_config import WorldConfig
from gait.controllers.agents import beliefs_of, held_steps, make_policy, refuse_unused
from gait.controllers.controller import INTERVAL, MAXIMUM_SEED, Controller
from gait.swims.poses import zero_pose

SECONDS = 20.0  # Sec. 5: "as far forward as possible in 20 seconds"
_MODEL_WORLD = WorldConfig()  # made once: its checks take as long as a short swim


@dataclass(frozen=True)
class Swim:
    """One swim, sampled at its start and after each command.

    The swim of a :class:`gait.Controller` without damage is sampled every 0.05 s, or more often if
    its interval is no multiple of that.

    Examples
    --------
    >>> still = swim(lambda observation, time: (0.0, 0.0, 0.0), None, engine="numba", seconds=1)
    >>> len(still.time)
    21
    """

    time: Floats  #: (T,) in s.
    position: Floats  #: (T, 3) of the capsule's centre in the world, from the origin, in units.
    quaternion: Floats  #: (T, 4) from body to world, (x, y, z, w).
    fin_angles: Floats  #: (T, F) each fin's angle, or its phase if it sweeps, in rad.
    #: Velocity of the water in the world, in units/s.
    current: Triple = field(default=(0.0, 0.0, 0.0), kw_only=True)
    #: (N, 3) gyroscope at the end of each 0.01 s, rad/s about the body's axes, and the commands
    #: (N, F) until then, rev/s or Hz; None for a swim read from a file.
    gyro: Floats | None = field(default=None, kw_only=True)
    commands: Floats | None = field(default=None, kw_only=True)

    @property
    def distance(self) -> float:
        """Distance along the world's +y relative to the water, in units; NaN if it diverged.

        A gait gains nothing from a current that carries it. ``position`` is over ground.
        """
        return float(self.position[-1, 1] - self.current[1] * self.time[-1])

    def __repr__(self) -> str:
        return f"Swim(distance {self.distance:z.2f} units in {self.time[-1]:g} s)"


def swim(
    controller: object,
    morphology: MorphologyLike,
    fin_angles: ArrayLike | None = None,
    engine: str = "auto",
    seconds: float = SECONDS,
    world: WorldConfig | None = None,
    believed: ArrayLike | None = None,
    believed_gain: ArrayLike | None = None,
    interval: int | None = None,
    observe_fins: str | bool = False,
    damage: object = None,
    seed: int = 0,
) -> Swim:
    """Return the path of one robot.

    Parameters
    ----------
    controller
        A :class:`gait.Controller`; a function of an observation and the time (one that can take the
        time is given it, even if it has a default), or an object with a method ``policy`` that
        returns one. Or what acts in an environment: a function of observations, an object with
        ``act``, or with ``predict``, as a model of stable-baselines3 (see :func:`gait.evaluate`).
        An object's ``morphology`` is its native body; see :func:`gait.swims.transfer.transfer`.
    morphology
        A body as ``Morphology.coerce`` takes it; None is the nominal one. Its plan is the
        controller's; of one without a plan, such as a function, it is the ``Morphology``'s.
    fin_angles
        (F,) each fin's initial angle, or its phase if it sweeps, rad; None is 0 for each.
    seconds
        Length of the swim.
    world
        The water and the servos; None is ``WorldConfig()``.
    believed, believed_gain
        What a controller that reckons its fins assumes: initial angles (F,) in rad, and servo gains
        (F,). None for the true ones. Refused if it does not, or has beliefs of its own, as an agent
        has of its gains.
    interval
        Steps of 0.01 s for which an action is held. None: a controller's or agent's own; else 5
        for a policy, and 20, the environments' ``frame_skip``, for what acts in one.
    engine
        ``"pybullet"``, ``"numba"`` (compiled, float64), or ``"auto"``: PyBullet if installed.
    observe_fins
        ``"reckoned"`` appends the sines and cosines of the fin angles, by dead reckoning, to the
        nine numbers of an observation, as the environments' option does. A model that was trained
        on them needs it.
    damage
        As of the environments, with onsets from the start of the swim on. A controller does not
        know of it, except for the initial angle of a dead servo's fin, which is random.
    seed
        Of random damage, of the angles of dead servos, and of the noise of sensors, as of an
        environment with the same initial fin angles that was seeded so.

    Raises
    ------
    InvalidArgumentError
        If an argument does not fit, or the controller returns no action.
    EngineUnavailableError
        If the engine's package is missing.
    """
    plan = plan_of(controller, morphology)
    fins = len(plan.fins)
    pose = zero_pose(plan)[0] if fin_angles is None else fin_angles
    angles = finite_array("fin_angles", pose, (fins,), unit="rad")
    body = Morphology.coerce(morphology, plan)
    time = step_count(seconds) * TIMESTEP
    water = check_world(world)
    gain = water.gains(plan) if believed_gain is None else believed_gain
    gain = finite_array("believed_gain", gain, (fins,))
    beliefs = beliefs_of(controller, observe_fins)
    refuse_unused(beliefs.angles, "believed", believed)
    refuse_unused(beliefs.gains, "believed_gain", believed_gain)
    steps = held_steps(controller, interval)
    task = SwimForward(seconds=time)
    config = check_episode(task, body, damage, fin_angles=angles, hold=steps, plan=plan)
    rng = np.random.default_rng(integer("seed", seed, 0, MAXIMUM_SEED))
    robot, _ = begin_episodes([config], [rng], steps)
    assumed = robot.fin_angles[0]
    if believed is not None:
        assumed = finite_array("believed", believed, (fins,), unit="rad")
    policy = make_policy(controller, steps, assumed, gain, observe_fins, plan)
    sampled = steps
    if isinstance(controller, Controller) and not config.damage:  # which counts the actions
        sampled = sampling_steps(controller)
    (path,) = rollout(
        [policy],
        water.edit(robot),
        engine=check_engine(engine),
        seconds=time,
        interval=sampled,
        rngs=[rng],
        substeps=water.substeps,
    ).paths
    return Swim(**vars(path), current=water.current)


def sampling_steps(controller: Controller) -> int:
    """Return from how many to how many steps of 0.01 s the path of a controller is sampled.

    At most the 5 of an action by default, of which its own interval must be a multiple.
    """
    return math.gcd(INTERVAL, controller.interval)


def check_world(world: WorldConfig | None, argument: str = "world") -> WorldConfig:
    """Return a world; None is the default."""
    return _MODEL_WORLD if world is None else instance(argument, world, WorldConfig)


def step_count(seconds: float) -> int:
    """Return the physics steps in a time, which is at most an hour."""
    time = float(finite_array("seconds", seconds, (), TIMESTEP, 3600.0, "s"))
    return round(time / TIMESTEP)
