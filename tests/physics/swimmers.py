"""Everything that can swim a robot, behind one interface, for the tests with known answers.

A new engine is a class of a few lines and one entry in ``SWIMMERS``. What one of them cannot do
stands in its ``cannot``, with the reason; ``python tests/physics/test_known_answers.py`` prints
which tests that leaves out.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.engines.compiled.single import CompiledWorld
from aquafish_gym.physics.kinematics import State, rotation, to_world
from aquafish_gym.physics.layout import JOINTS, layout, state_numbers
from aquafish_gym.plans import AQUAFISH, FOUR_FINS, TAIL_FISH, BodyPlan
from aquafish_gym.scenario import Scenario
from instruments.verification import harness
from instruments.verification.trials import lane_batch
from tests.plans import ODD

Array = NDArray[np.float64]
Vector = tuple[float, float, float]
STILL: Vector = (0.0, 0.0, 0.0)


class Swimmer:
    """What the tests ask of whatever swims: an engine, and the plan of its robots.

    ``rounding`` is what one rounding may do to a number of order one, and ``robots`` how many
    robots a test should take: fewer where they are slow. ``cannot`` has what it cannot do, with
    the reason.
    """

    rounding = 2e-16
    robots = 10
    cannot: ClassVar[dict[str, str]] = {}

    def __init__(self, name: str, plan: BodyPlan = AQUAFISH) -> None:
        self.name = name if plan == AQUAFISH else f"{name}, {plan.name}"
        self.plan = plan
        if plan == ODD:
            self.cannot = {**self.cannot, "mirror": "its fins have no mirror images"}  # type: ignore[misc]

    def march(
        self,
        bodies: Array,
        states: Array,
        commands: Array,
        h: float = TIMESTEP,
        steps: int = 1,
        current: Vector = STILL,
        push: Vector = STILL,
        wet: bool = True,
    ) -> Array:
        """Return the states (N, B) after some steps; see ``harness.march``."""
        return self._march(bodies, states, commands, h, steps, current, push, wet)

    def drag(self, fins: Array, motion: Array) -> Array:
        """Return the drag on fins (6, B); see ``harness.drag``."""
        raise NotImplementedError

    def _march(self, *_: Any) -> Array:
        raise NotImplementedError


class Backend(Swimmer):
    """The physics' own functions on one kind of number."""

    def __init__(
        self,
        backend: str,
        rounding: float = 2e-16,
        robots: int = 10,
        plan: BodyPlan = AQUAFISH,
    ) -> None:
        super().__init__(f"backend {backend}", plan)
        self.backend, self.rounding, self.robots = backend, rounding, robots

    def _march(self, bodies, states, commands, h, steps, current, push, wet):  # type: ignore[no-untyped-def]
        return harness.march(
            self.backend, bodies, states, commands, h, steps, current, push, wet, self.plan
        )  # fmt: skip

    def drag(self, fins: Array, motion: Array) -> Array:
        return harness.drag(self.backend, fins, motion)


_NO_DRAG = "it computes the drag within its steps; the backends show the law by itself"
_COMPILED: dict[str, str] = {
    "drag": _NO_DRAG,
    "push": "the loop is compiled with the water alone",
    "dry": "the loop is compiled with the water in it",
}


class Lanes(Swimmer):
    """The engine ``numba``."""

    cannot = _COMPILED

    def __init__(
        self,
        dtype: type[np.floating],
        rounding: float,
        reactive: bool = False,
        plan: BodyPlan = AQUAFISH,
    ) -> None:
        super().__init__(f"engine numba, {np.dtype(dtype)}" + ", reactive" * reactive, plan)
        self.dtype = dtype
        self.rounding = rounding
        self.reactive = reactive
        if reactive:
            self.cannot = {**self.cannot, "rigid": "it carries water along"}  # type: ignore[misc]

    def _march(self, bodies, states, commands, h, steps, current, *_):  # type: ignore[no-untyped-def]
        substeps = round(TIMESTEP / h)
        lanes = lane_batch(
            bodies, np.zeros(commands.shape), current, self.dtype, substeps,
            reactive=self.reactive, plan=self.plan,
        )  # fmt: skip
        lanes.states[: len(states)] = states
        samples, rest = divmod(steps, substeps)
        assert rest == 0, "a whole number of samples"
        lanes.advance(commands, samples)
        return lanes.states[: len(states)].astype(np.float64)


class Single(Swimmer):
    """The compiled engine's world of one robot, which environments step."""

    cannot: ClassVar[dict[str, str]] = {**_COMPILED, "short steps": "its steps are of 0.01 s"}

    def __init__(self, plan: BodyPlan = AQUAFISH) -> None:
        super().__init__("world numba", plan)

    def _march(self, bodies, states, commands, _h, steps, current, *_):  # type: ignore[no-untyped-def]
        ends, world = [], CompiledWorld()
        for body, row, command in zip(bodies, states.T, commands, strict=True):
            world.start(Scenario.create(body, current=current, plan=self.plan))
            world._numbers[world._state] = row[world._state]
            world.advance(tuple(command.tolist()), steps)
            ends.append(flatten(world.state()))
        return np.array(ends).T


class Bullet(Swimmer):
    """The engine ``pybullet``, its robot put into any state."""

    rounding = 2e-15  # its solver iterates
    robots = 4
    cannot: ClassVar[dict[str, str]] = {"drag": _NO_DRAG}

    def __init__(self, plan: BodyPlan = AQUAFISH) -> None:
        super().__init__("engine pybullet", plan)

    def _march(self, bodies, states, commands, h, steps, current, push, wet):  # type: ignore[no-untyped-def]
        from aquafish_gym.engines.bullet.world import BulletWorld

        world = BulletWorld()
        world.timestep = h
        try:
            ends = []
            for body, row, command in zip(bodies, states.T, commands, strict=True):
                angles = layout(self.plan).angles(row)
                world.start(
                    Scenario.create(body, fin_angles=angles, current=current, plan=self.plan)
                )
                place(world, row, self.plan)
                world._push = pushed(world._push, push, wet)  # which reset chooses
                world.advance(tuple(command.tolist()), steps)
                ends.append(flatten(world.state()))
        finally:
            world.close()
        return np.array(ends).T


def pushed(water: Any, push: Vector, wet: bool) -> Any:
    """Return what a world calls for its wrench, with a push in body axes, or without water."""

    def call(column, joints, base, *others):  # type: ignore[no-untyped-def]
        force, torque, sweep = water(column, joints, base, *others)
        if not wet:
            force = torque = STILL
        more = to_world(rotation(base[0]), push)
        return tuple(a + b for a, b in zip(force, more, strict=True)), torque, sweep

    return call


def place(world: Any, row: Array, plan: BodyPlan = AQUAFISH) -> None:
    """Put the robot of a world that was just reset into a state."""
    quaternion, position, velocity, spin = (
        tuple(row[part].tolist())
        for part in (harness.QUATERNION, harness.POSITION, harness.VELOCITY, harness.SPIN)
    )
    world_spin = to_world(rotation(quaternion), spin)
    bullet, robot, client = world._bullet, world._robot, world._client
    for joint, rate in enumerate(row[layout(plan).rates].tolist()):
        angle = bullet.getJointState(robot, joint, physicsClientId=client)[0]
        bullet.resetJointState(robot, joint, angle, rate, physicsClientId=client)
    bullet.resetBasePositionAndOrientation(robot, position, quaternion, physicsClientId=client)
    bullet.resetBaseVelocity(robot, velocity, world_spin, physicsClientId=client)
    world.position, world.orientation = position, quaternion
    world.velocity, world.world_spin = velocity, world_spin
    world._joints[:] = row[JOINTS : layout(plan).state_numbers]


def flatten(state: State) -> Array:
    """Return a state as a row; its roll, pitch and yaw are left out."""
    return np.array([*state_numbers(state), 0.0, 0.0, 0.0])


#: Their kernels take a minute to compile.
OF_OTHER_PLANS: tuple[Swimmer, ...] = tuple(
    swimmer
    for plan in (FOUR_FINS, TAIL_FISH, ODD)
    for swimmer in (
        Backend("numba", plan=plan),
        Lanes(np.float64, rounding=2e-16, plan=plan),
        Lanes(np.float64, rounding=1e-14, reactive=True, plan=plan),
        Single(plan),
        Bullet(plan),
    )
)
SWIMMERS: tuple[Swimmer, ...] = (
    Backend("floats", robots=3),
    Backend("numba"),
    Backend("float64"),
    Backend("float32", rounding=1e-7),
    Lanes(np.float64, rounding=2e-16),
    Lanes(np.float32, rounding=1e-7),
    Lanes(np.float64, rounding=1e-14, reactive=True),
    Single(),
    Bullet(),
    *OF_OTHER_PLANS,
)
