"""The swimming robot as a Gymnasium environment."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.damage import Effect
from aquafish_gym.engines.api import TIMESTEP, check_engine
from aquafish_gym.engines.worlds import World, make_world
from aquafish_gym.envs import conditions
from aquafish_gym.envs.course import Sensors
from aquafish_gym.envs.tasks import Memory, Step, check_task, check_water
from aquafish_gym.physics.arithmetic import Vector, subtract
from aquafish_gym.physics.kinematics import at_rest
from aquafish_gym.rendering import (
    RENDER_MODES,
    Window,
    check_render_mode,
    render_pose,
    usable_modes,
)
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.validation import flag, integer

Observation = NDArray[np.float32]
ONLY = np.zeros(1, np.intp)  # the one robot among all


class AquaFishEnv(gym.Env[Observation, NDArray[np.float32]]):
    r"""A damaged robot fish that feels its attitude and nothing else.

    ## Description

    A capsule-shaped robot hangs weightless in water, moved by two pectoral flippers, which turn
    right round, and a tail fin, which sweeps from side to side. It is to swim forward, or what
    else its `task` is. What makes it hard is what it does not know: where its fins stand, what is
    broken, and what will break.

    It is the robot of the Estimation-Exploration Algorithm's studies of damage recovery. Drag
    is quadratic and scale-free; the unit of length is 5 cm. Axes: x to the right, y forward, z
    up.

    ## Action Space

    The action space is a `Box(-1, 1, (3,), float32)`: the three servos' speeds. What lies
    outside is clipped; NaN is refused.

    | Num | Action | Control Min | Control Max | Unit at -1 and 1 |
    |-----|--------|-------------|-------------|------------------|
    | 0 | speed of the left pectoral flipper | -1 | 1 | -0.5 and 0.5 rev/s |
    | 1 | speed of the right pectoral flipper | -1 | 1 | -0.5 and 0.5 rev/s |
    | 2 | frequency of the tail's sweep of +-30 degrees | -1 | 1 | 0 and 1 Hz |

    ## Observation Space

    What an inertial measurement unit gives: which way is up, which way is north (the world's y,
    where the robot faces at the start), and its gyro, all in the robot's own axes. Up and north
    hold the same as roll, pitch and yaw without their jumps, as an accelerometer and a compass
    measure them. Velocity and damage are never observed, and where the robot is only where the
    task has a goal: then as what a beacon there would tell. The fins' angles are hidden; with
    `observe_fins=True` they are as a sensor would tell, with `"reckoned"` as who is told how they
    stood at first can reckon from the commands, and wrong once a servo does not as it is told.
    Broken sensors of the unit say something else.

    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 0-2 | the world's up (z) in body axes x, y, z | -1 | 1 | |
    | 3-5 | the world's north (y) in body axes x, y, z | -1 | 1 | |
    | 6-8 | angular velocity about body axes x, y, z; saturates | -34.9 | 34.9 | rad/s |
    | 9-11 | with `observe_fins`: sine of left, right flipper angle, tail phase | -1 | 1 | |
    | 12-14 | with `observe_fins`: cosine of the same | -1 | 1 | |
    | the last 3 | with a goal: the way to it, in body axes | -100 | 100 | units |

    ## Rewards

    The reward is the sum of its terms, all of them in `info` (0 at a reset, so that its keys are
    always the same). Of the task "forward" they are:

    - *reward_forward*: the mean speed along the world's y over the step, in units/s.
    - *reward_ctrl*: minus 1e-4 times the sum of the squares of the action.

    `task=SwimForward(forward_weight=1.0, ctrl_weight=1e-4)` has other weights.

    `info` also holds `x_position`, `y_position`, `z_position` (units), `x_velocity`,
    `y_velocity`, `z_velocity` (means over the step, units/s), `distance_from_origin`,
    `diverged`, and the truth that is hidden from the observation, in numbers: `fin_angles` (left,
    right angle and tail phase, rad), `faults` (how many things are broken now), `morphology` (the
    nine sizes of the body as it is), `servo_gain` (speed is gain times command), `sensor_noise`
    (of the gyro, rad/s), and of channels 0-8 `sensor_bias` and `sensor_lost` (stuck or dropped).

    ## Starting State

    At rest at the origin, upright, facing along y. `fin_angles` says how the fins stand:
    `"random"` (uniform on the circle, drawn anew at every reset, since nobody knows where the fins
    of a robot at sea are), `"zero"` (flippers straight back, tail straight and about to sweep) or
    three angles in rad.

    `reset(options=...)` takes `fin_angles`, `morphology` and `damage` for that episode alone.

    ## Episode End

    ### Termination

    Only if the simulation diverges, which was seen of bodies with each size at an end of its range
    in a current of 20 units/s along every axis, at one start in 2000, and else never. `info` then
    has `diverged` true, the reward is 0 and the observation is the last good one.

    ### Truncation

    After 20 s: 2000 physics steps, which is 100 steps at the default `frame_skip`. Another task
    may last longer.

    ## Arguments

    ```python
    import gymnasium as gym
    import aquafish_gym
    env = gym.make("AquaFish-v0", damage="left_pectoral:length=0.5")
    ```

    | Parameter | Type | Default | Description |
    |-----------|------|---------|-------------|
    | `morphology` | Morphology, dict, nine numbers | `None` | before damage; None: the prototype |
    | `damage` | Damage, text | `None` | e.g. `"caudal:missing@4"`, `"random:moderate@2-8"` |
    | `engine` | str | `"auto"` | `"pybullet"` or `"numba"`: the same robot to 1e-9 |
    | `current` | three numbers | `(0, 0, 0)` | the water's own velocity in the world, units/s |
    | `fin_angles` | str or three numbers | `"random"` | see Starting State |
    | `observe_fins` | bool, str | `False` | the fins' angles: hidden, seen, or `"reckoned"` |
    | `frame_skip` | int | `20` | physics steps of 0.01 s in each step; they divide an episode |
    | `render_mode` | str or None | `None` | `"rgb_array"`, or `"human"` where there is a display |
    | `task` | str or Task | `"forward"` | or `"station"`, `"waypoint"`, `"recovery"`, a Task |
    | `reactive` | bool | `False` | whether the water also has added mass; see `simulate` |

    An environment on the engine numba can be pickled and copied, also in mid-episode, and goes on
    as the original does. One on PyBullet belongs to its process: once reset, it cannot be pickled,
    and after a fork it refuses to work.

    ## Version History

    * v0: initial version.

    Examples
    --------
    >>> env = AquaFishEnv(damage="left_pectoral:length=0.5", engine="numba")
    >>> observation, info = env.reset(seed=0)
    >>> observation.shape, int(info["faults"])
    ((9,), 1)
    >>> env.close()
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 5}  # noqa: RUF012

    def __init__(
        self,
        morphology: object = None,
        damage: object = None,
        engine: str = "auto",
        current: ArrayLike = (0.0, 0.0, 0.0),
        fin_angles: object = "random",
        observe_fins: bool | str = False,
        frame_skip: int = 20,
        render_mode: str | None = None,
        task: object = "forward",
        reactive: bool = False,
    ) -> None:
        self.task = check_task(task)
        self._conditions = conditions.check_conditions(
            morphology, damage, current, fin_angles, self.task.seconds
        )
        check_water(self.task, self._conditions.current)
        self._engine = check_engine(engine)
        self._observe_fins, self._reckons = conditions.check_observe_fins(observe_fins)
        self._reactive = flag("reactive", reactive)
        self.frame_skip = conditions.check_frame_skip(frame_skip, self.task.seconds)
        self.render_mode = check_render_mode(render_mode)
        # The class says which modes there are, the environment which of them work here.
        fps = max(1, round(1 / self.dt))
        self.metadata = {"render_modes": usable_modes(), "render_fps": fps}
        self.action_space = conditions.action_space()
        space = conditions.observation_space(self._observe_fins, self.task.has_goal)
        self.observation_space = space
        self._world: World | None = None
        self._window: Window | None = None
        self._steps = self._last = 0
        self._sensors = Sensors(1)
        chance = np.random.default_rng(0)
        self._course, *_ = self._conditions.draw(chance, self.dt, self.task.begin)
        self._effect = self._course.effects[0]
        self._memory: Memory = ()
        # What is now, or was before the robot diverged.
        self._fin_angles: conditions.Triple = (0.0, 0.0, 0.0)
        self._reckoned: Vector = self._fin_angles
        self._state = at_rest(self._fin_angles)

    @property
    def dt(self) -> float:
        """Length of one step, s."""
        return TIMESTEP * self.frame_skip

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; the seed is for what is left to chance.

        ``options`` are ``fin_angles``, ``morphology`` and ``damage`` for this episode alone.
        """
        number = None if seed is None else integer("seed", seed, 0)
        episode = self._conditions.with_options(options)  # may refuse
        super().reset(seed=number)
        drawn = episode.draw(self.np_random, self.dt, self.task.begin)
        self._course, angles, self._memory = drawn
        start = Scenario.fill(
            {
                "body": self._course.effects[0].body.to_array()[None],
                "fin_angles": angles[None],
                "current": np.array([episode.current]),
            },
            self._reactive,
        )
        self._start = start
        if self._world is None:
            self._world = make_world(self._engine, start)
        else:
            self._world.reset(start)
        self._state, self._fin_angles = self._world.state(), self._world.fin_angles
        self._reckoned = self._fin_angles
        self._steps, self._last = 0, round(self.task.seconds / self.dt)
        self._sensors.reset([0])
        self._enter(self._course.effects[0])
        here = self._state.position
        if self.render_mode == "human":
            self.render()
        still = Step(here, here, self._state.orientation, (0.0, 0.0, 0.0), self._memory, self.dt)
        nothing = dict.fromkeys(self.task.reward_terms(still), 0.0)
        return self._observation(), self._info(here, here) | nothing

    def _enter(self, effect: Effect) -> None:
        """Have the robot be as damage makes it from now on."""
        self._effect = effect
        self._sensors.become([0], effect)

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Set the servos for ``frame_skip`` physics steps.

        Raises
        ------
        InvalidArgumentError, ResetNeeded
            If the action is not three finite numbers, or the episode is over.
        """
        checked = conditions.check_single_action(action)
        world, task = self._world, self.task
        if world is None or self._steps == self._last:
            raise ResetNeeded("the episode is over or has not begun: call reset() before step()")
        water = task.current(self._memory, self._steps * self.dt)
        if water is not None:
            x, y, z = map(float, water)
            world.set_current((x, y, z))
        world.advance(conditions.servo_speeds(checked, self._effect.gains), self.frame_skip)
        self._steps += 1
        before = self._state.position
        diverged = world.diverged
        if not diverged:
            self._state, self._fin_angles = world.state(), world.fin_angles
            self._reckoned = conditions.reckon(self._reckoned, checked, self.dt)
        here = self._state.position
        step = Step(before, here, self._state.orientation, checked, self._memory, self.dt)
        terms = {name: float(value) for name, value in task.reward_terms(step).items()}
        if diverged:
            self._steps, terms = self._last, dict.fromkeys(terms, 0.0)
        else:
            self._memory = task.remember(step)
            effect = self._course.at(self._steps)
            if effect is not self._effect:
                if effect.body != self._effect.body:
                    world.update(replace(self._start, body=effect.body.to_array()[None]))
                self._enter(effect)
        info = self._info(before, here)
        info.update(terms)
        info["diverged"] = diverged
        if self.render_mode == "human":
            self.render()
        truncated = self._steps == self._last and not diverged
        return self._observation(), sum(terms.values()), diverged, truncated, info

    def _observation(self) -> Observation:
        state, way = self._state, None
        if self.task.has_goal:
            way = subtract(self.task.goal(self._memory), state.position)
        fins = None
        if self._observe_fins:
            fins = self._reckoned if self._reckons else self._fin_angles
        seen = conditions.observe(state.orientation, state.spin, fins, way)
        if not self._sensors.broken:
            return seen
        most = conditions.limits(self._observe_fins, self.task.has_goal)
        said: Observation = self._sensors.say(seen[None], most, [self.np_random], ONLY)[0]
        return said

    def _info(self, before: Vector, after: Vector) -> dict[str, Any]:
        return conditions.motion_info(before, after, self.dt) | {
            "diverged": False,
            "fin_angles": np.array(self._fin_angles),
            **{name: value.copy() for name, value in self._effect.truth.items()},
        }

    def render(self) -> Any:
        """Return a frame (480, 640, 3) uint8, or show it in the window; None without a mode."""
        if self.render_mode is None:
            return None
        pose = (self._state.position, self._state.orientation)
        angles = self._fin_angles
        if self.render_mode == "human":
            if self._window is None:
                self._window = Window()
            self._window.show(self._effect.body, pose, angles)
            return None
        return render_pose(self._effect.body, pose, angles)

    def close(self) -> None:
        """Give back what the engine and the window hold; closing twice does no harm."""
        if self._world is not None:
            self._world.close()
            self._world = None
        if self._window is not None:
            self._window.close()
            self._window = None
