"""Robots that swim in real time, and the water's forces on their parts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from aquafish.online import AgentConfig, SelfModelAgent
from aquafish.online.self_model import error_size, moved, predict
from aquafish_gym.command import scale_action
from aquafish_gym.damage import Damage, Fault, edit_each
from aquafish_gym.damage.words import parts_of
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.envs.robots import Robots
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.dynamics import Water, Wrench, forces, on_body
from aquafish_gym.physics.kinematics import rotation, to_world
from aquafish_gym.physics.layout import layout, robot_of
from aquafish_gym.plans import AQUAFISH, BodyPlan, PlanLike, check_plan
from aquafish_gym.scenario import TIMESTEP, Scenario, check_field, check_row
from aquafish_gym.sense import limits, observe
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array, integer
from gait.controllers.agents import Agent, held_steps, make_agent
from gait.controllers.controller import Controller

MAXIMUM_VIEWED_ROBOTS = 64
MAXIMUM_VIEWED_FAULTS = 30  # of a robot
UPDATE_STEPS = 5  # steps of 0.01 s in an update
LONGEST_STRIKE = 2.0  # s of delay for which what was before a strike is kept
GAIT_HORIZON_SECONDS = 20.0  # for which the self-model agent chooses a gait
BELIEF_SAMPLES = 12  # of what the self-model may be
_NOTHING: Wrench = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


class ViewerPilot(NamedTuple):
    """An agent, and for how many steps of 0.01 s its actions are held."""

    agent: Agent
    interval: int


def pilot_of(steers: object) -> ViewerPilot:
    """Return a pilot of whatever steers robots; see ``gait.controllers.agents.KINDS``."""
    interval = held_steps(steers)
    return ViewerPilot(make_agent(steers, interval, argument="policy"), interval)


def random_pilot(seed: int, plan: BodyPlan = AQUAFISH) -> ViewerPilot:
    """Return a pilot whose actions are uniformly random."""
    rng = np.random.default_rng(seed)
    fins = len(plan.fins)
    return pilot_of(lambda observations: rng.uniform(-1.0, 1.0, (len(observations), fins)))


def gait_pilot(gait: Controller) -> ViewerPilot:
    """Return a pilot that swims a gait."""
    if gait.senses.goal:
        raise InvalidArgumentError("the gait must have no goal: the viewer's water has none")
    return pilot_of(gait)


class LiveSwim:
    """Robots that swim on while faults strike, sizes are set and the water flows.

    ``count`` robots of a ``plan``, at most 64, begin with random fin angles. ``damage`` is of all
    of them, with onsets from the start on; ``gyro_noise`` is a standard deviation in rad/s, and
    ``reactive`` water has added mass.

    Attributes
    ----------
    states
        (R, B) in the order of ``aquafish_gym.physics.layout``.
    observed
        (B, 9) the last observations.
    actions, held
        (B, F) the present actions, and for how many steps of 0.01 s they have been held.
    """

    def __init__(
        self,
        pilot: ViewerPilot,
        count: int = 1,
        damage: str = "none",
        gyro_noise: float = 0.0,
        seed: int = 0,
        plan: PlanLike = AQUAFISH,
        reactive: bool = False,
    ) -> None:
        self.plan = check_plan(plan)
        self.count = integer("robots", count, 1, MAXIMUM_VIEWED_ROBOTS)
        self._reactive = reactive
        self._damage, self._rng = Damage.parse(damage), np.random.default_rng(seed)
        self._sizes, self._current = self.plan.nominal.copy(), np.zeros(3)
        self._noise = check_row("gyro_noise", gyro_noise)
        self._everyone = np.arange(self.count)
        self.pilot = pilot
        self.reset()

    def reset(self, pilot: ViewerPilot | None = None) -> None:
        """Begin again at the start line, at rest, with the damage of the start."""
        self.pilot = pilot or self.pilot
        self.steps, self.held = 0, 0
        shape = (self.count, len(self.plan.fins))
        self._damages = [self._drawn(self._damage) for _ in self._everyone]
        self._angles = self._rng.uniform(-math.pi, math.pi, shape)
        self._stride = math.gcd(self.pilot.interval, UPDATE_STEPS)
        begun = self._scenario().draw_angles([self._rng] * self.count)
        self._angles = begun.fin_angles
        # A fault that strikes in mid-swim finds what was said and asked before.
        self._robots = Robots(begun, self._stride, history=LONGEST_STRIKE)
        self._robots.start(self._everyone, begun)
        self._is_edited = False
        self._lanes = LaneBatch(begun, np.float64)
        self.states = self._lanes.states.astype(np.float64)
        self.pilot.agent.reset({"fin_angles": self._angles.copy()})
        self.actions = np.zeros(shape)
        self._observe()

    def _drawn(self, damage: Damage) -> Damage:
        """Return damage of one robot, with what is random drawn."""
        return damage.sample(self._rng, parts_of(self.plan))

    @property
    def robots(self) -> Scenario:
        """The robots as they are at present (B robots)."""
        return self._robots.now

    @property
    def seconds(self) -> float:
        """The time since the start, s."""
        return self.steps * TIMESTEP

    def faults(self, robot: int) -> tuple[Fault, ...]:
        """Return the faults of a robot that are active."""
        now = self.seconds + 1e-9
        return tuple(f for f in self._damages[robot] if f.span[0] <= now < f.span[1])

    def damage_now(self, robot: int) -> Damage:
        """Return a robot's active faults, as if they lasted throughout."""
        return Damage(tuple(replace(one, onset=0.0, duration=None) for one in self.faults(robot)))

    def broken(self, robot: int) -> tuple[str, ...]:
        """Return the names of a robot's broken fins."""
        parts = {fault.part for fault in self.faults(robot)}
        return tuple(fin for fin in self.plan.names if fin in parts)

    def strike(self, damage: str, robots: Sequence[int] | None = None) -> None:
        """Break robots, or all, in mid-swim; onsets count from now.

        InvalidArgumentError if the damage does not fit a robot: then no robot changes.
        """
        wanted, damages = Damage.parse(damage), list(self._damages)
        for robot in self._everyone.tolist() if robots is None else robots:
            drawn = self._drawn(wanted)
            later = [replace(f, onset=f.span[0] + self.seconds) for f in drawn]
            damages[robot] = Damage((*damages[robot].faults, *later))
            if len(damages[robot].faults) > MAXIMUM_VIEWED_FAULTS:
                raise InvalidArgumentError(
                    f"a robot may have at most {MAXIMUM_VIEWED_FAULTS} faults; repair it first"
                )
            # It raises if it does not fit.
            damages[robot].body(Morphology.from_array(self._sizes, self.plan))
            damages[robot].check_steps(TIMESTEP * self._stride)
        self._damages = damages
        self._is_edited = True

    def repair(self, robots: Sequence[int] | None = None) -> None:
        """Remove all faults of robots, or of all, in mid-swim."""
        for robot in self._everyone.tolist() if robots is None else robots:
            self._damages[robot] = Damage()
        self._is_edited = True

    def set_sizes(self, sizes: ArrayLike) -> None:
        """Set the sizes (S,) of all robots before damage, in units of 5 cm."""
        self._sizes = check_field("body", np.array([sizes], float), self.plan)[0]
        self._is_edited = True

    def set_current(self, current: ArrayLike) -> None:
        """Set the velocity (3,) of the water, units/s."""
        self._current = check_row("current", current)
        self._is_edited = True

    def advance(self, updates: int = 1) -> None:
        """Apply what was changed and swim on for some updates of 0.05 s.

        All begin again if one diverges.
        """
        interval, stride = self.pilot.interval, self._stride
        self._become()
        for _ in range(updates * UPDATE_STEPS // stride):
            if self.steps % interval == 0:
                self._steer()
            followed = np.stack(self._robots.follow(tuple(self.actions.T)), axis=1)
            self._lanes.advance(scale_action(self.plan, followed), stride)
            self.steps += stride
            self.held += stride
            if self._lanes.diverged.any():
                self.reset()
            self.states = self._lanes.states.astype(np.float64)
            self._become()
            self._observe()

    def _steer(self) -> None:
        agent = self.pilot.agent
        if isinstance(agent, SelfModelAgent):
            agent.swim_until(self.seconds + GAIT_HORIZON_SECONDS)
        actions = np.asarray(agent.act(self.observed), float).reshape(self.count, -1)
        self.actions = np.clip(finite_array("actions", actions, self.actions.shape), -1.0, 1.0)
        self.held = 0

    def _become(self) -> None:
        """Let the robots be what they are from now on: by a fault's onset or end, or as edited."""
        if self._is_edited:
            self._robots.rewrite(self._scenario(), self.steps)
        else:
            changing = np.flatnonzero(self._robots.next_change == self.steps)
            if not len(changing):
                return
            self._robots.change(changing)
        self._is_edited = False
        self._lanes.update(self.robots)

    def _scenario(self) -> Scenario:
        """Return the robots with all of their damage."""
        rows = (self.count, 1)
        intact = Scenario.create(
            np.tile(self._sizes, rows),
            fin_angles=self._angles,
            current=self._current,
            gyro_noise=self._noise,
            reactive=self._reactive,
            plan=self.plan,
        )
        return edit_each(intact, self._damages, self._stride)

    def _observe(self) -> None:
        truth = observe(layout(self.plan).state(self.states))
        most = limits()
        self.observed = self._robots.sensors.observe(truth, -most, most, self._rng, self._everyone)


def part_forces(robot: Scenario, state: Floats) -> Floats:
    """Return the water's force on each fin and the hull, (F + 1, 3), in world axes.

    By the drag law in a state (R,) of a scenario of one robot. The unit is that of water of
    density 1: 6.25 mN.
    """
    plan = robot.plan
    body = robot_of(layout(plan).robots(robot.body, robot.drag)[:, 0].tolist())
    now, (x, y, z) = layout(plan).state(state), robot.current[0].tolist()
    water, turn = forces(plan, body, now, (x, y, z)), rotation(now.orientation)
    parts = (*water.fins, water.body)
    apart = []
    for k in range(len(parts)):
        *fins, hull = (one if i == k else _NOTHING for i, one in enumerate(parts))
        apart.append(Water(tuple(fins), hull))
    return np.array([to_world(turn, on_body(plan, now, part)[0]) for part in apart])


def imagine_ghost(agent: SelfModelAgent, actions: Floats, held: int) -> tuple[Floats, Floats]:
    """Return bodies (1 + SAMPLES, S) and states (R, 1 + SAMPLES) of an agent's self-model now.

    The first is its own estimate, after its actions (1, F) were held for some steps of 0.01 s. The
    others are samples of what it may be: states of the filter's covariance, and robots of the
    alternatives that its last inference found, in proportion to their weights.
    """
    model = agent.model
    size = error_size(model.robot.plan)
    draws = np.random.default_rng(0).standard_normal((BELIEF_SAMPLES, size))
    spread = draws @ np.linalg.cholesky(model.covariance).T
    errors = np.concatenate([np.zeros((1, size)), spread])
    states = moved(model.robot.plan, model.state, errors)
    robots = [model.robot] * (1 + BELIEF_SAMPLES)
    if agent.recognised is not None:
        several = agent.recognised.alternatives
        shares = np.cumsum([one.weight for one in several])
        at = np.searchsorted(
            shares, shares[-1] * (np.arange(BELIEF_SAMPLES) + 0.5) / BELIEF_SAMPLES
        )
        robots[1:] = [several[i].robot for i in at.tolist()]
    together = Scenario.concatenate([replace(one, reactive=model.robot.reactive) for one in robots])
    if held:
        _, states = predict(together, states, actions, held)
    return together.body, states


def self_model_pilot(
    gyro_noise: float = 0.0,
    gyro_only: bool = False,
    seed: int = 0,
    robot: Scenario | None = None,
    library: Sequence[Controller] | None = None,
) -> ViewerPilot:
    """Return a pilot that models itself; see ``SelfModelAgent`` for its robot and its library."""
    settings = AgentConfig(
        GAIT_HORIZON_SECONDS, gyro_noise=gyro_noise, gyro_only=gyro_only, seed=seed
    )
    agent = SelfModelAgent(library, settings, robot)
    return ViewerPilot(agent, agent.hold)
