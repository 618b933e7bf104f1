"""The swimming robot as a Gymnasium environment."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.command import reckon, servos
from aquafish_gym.engines.worlds import World
from aquafish_gym.envs import episode
from aquafish_gym.envs.robots import OneRobot
from aquafish_gym.envs.tasks import Memory, Step
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.arithmetic import TAU, Vector, subtract
from aquafish_gym.physics.kinematics import Numbers, at_rest
from aquafish_gym.plans import AQUAFISH, PlanLike
from aquafish_gym.rendering import (
    RENDER_MODES,
    Window,
    check_render_mode,
    render_pose,
    usable_modes,
)
from aquafish_gym.scenario import Scenario
from aquafish_gym.sense import observe
from aquafish_gym.utils.validation import flag, integer

Observation = NDArray[np.float32]


class AquaFishEnv(episode.FishEnvBase, gym.Env[Observation, NDArray[np.float32]]):
    r"""A damaged robot fish that observes its IMU and nothing else.

    ## Description

    A capsule-shaped robot hangs weightless in water, moved by two pectoral flippers, which turn
    full circles, and a tail fin, which sweeps from side to side. The goal is set by `task`; by
    default, to swim forward. The task is hard because the robot does not know its fins' angles,
    what is broken, and what will break.

    Drag is quadratic and scale-free; the unit of length is 5 cm. Axes: x to the right, y forward, z
    up.

    ## Action Space

    The action space is a `Box(-1, 1, (3,), float32)`: the three servos' speeds. Values outside
    are clipped; NaN is refused.

    | Num | Action | Control Min | Control Max | Unit at -1 and 1 |
    |-----|--------|-------------|-------------|------------------|
    | 0 | speed of the left pectoral flipper | -1 | 1 | -0.5 and 0.5 rev/s |
    | 1 | speed of the right pectoral flipper | -1 | 1 | -0.5 and 0.5 rev/s |
    | 2 | frequency of the tail's sweep of +-30 degrees | -1 | 1 | 0 and 1 Hz |

    ## Observation Space

    The output of an inertial measurement unit, in the robot's own axes: the directions up and north
    (the world's y, where the robot faces at the start), which say the same as roll, pitch and yaw
    without their jumps, and the gyro. Velocity, position and damage are never observed. The fins'
    angles are hidden: `observe_fins=True` adds them, `"reckoned"` integrates the commands from the
    true initial angles and is wrong under servo faults. Broken sensors change the observation.

    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 0-2 | the world's up (z) in body axes x, y, z | -1 | 1 | |
    | 3-5 | the world's north (y) in body axes x, y, z | -1 | 1 | |
    | 6-8 | angular velocity about body axes x, y, z; saturates | -34.9 | 34.9 | rad/s |
    | 9-11 | with `observe_fins`: sine of left, right flipper angle, tail phase | -1 | 1 | |
    | 12-14 | with `observe_fins`: cosine of the same | -1 | 1 | |
    | the last 3 | with a goal: the way to it, in body axes | -100 | 100 | units |

    ## Rewards

    The reward is the sum of its terms, all of them in `info`. Those of the task "forward", whose
    weights are `task=SwimForward(forward_weight=1.0, ctrl_weight=1e-4)`, are:

    - *reward_forward*: the mean speed along the world's y over the step, in units/s.
    - *reward_ctrl*: minus 1e-4 times the sum of the squares of the action.

    `info` also holds `x_position`, `y_position`, `z_position` (units), `x_velocity`,
    `y_velocity`, `z_velocity` (means over the step, units/s), `distance_from_origin`,
    `diverged`, and hidden truth in numbers: `fin_angles` (left, right angle and tail phase, rad),
    `faults` (how many are active), `morphology` (the nine sizes of the present body), `servo_gain`
    (speed over command), `sensor_noise` (of the gyro, rad/s), and for channels 0-8 `sensor_bias`
    and `sensor_lost` (stuck or dropped); with late, slow or scaled channels also `sensor_scale`,
    `sensor_delay`, `sensor_hold`, `servo_delay` and `servo_hold` (s).

    ## Starting State

    At rest at the origin, upright, facing along y. The fins start as `fin_angles` sets them:
    `"random"` (uniform on the circle), `"zero"` (flippers straight back, tail straight and about to
    sweep) or three angles in rad. `reset(options=...)` takes `fin_angles`, `morphology` and
    `damage` for that episode alone.

    ## Episode End

    ### Termination

    When a task that can be achieved, such as "return", is: `info` then has `is_success` true. Other
    tasks have no such key, and terminate only if the simulation diverges: seen at one start in 2000
    with every size at an end of its range in a current of 20 units/s along every axis. `info` then
    has `diverged` true, the reward is 0 and the observation is the last good one. If the variable
    `AQUAFISH_DIVERGED` names a folder, it gets a file from which `simulate` swims the robot again.

    ### Truncation

    After 20 s, or the time of another task: 100 steps at the default `frame_skip`.

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
    | `engine` | str or class | `"auto"` | `"pybullet"`, `"numba"`: alike to 1e-9; or a `World` |
    | `current` | three numbers | `(0, 0, 0)` | the water's own velocity in the world, units/s |
    | `fin_angles` | str or three numbers | `"random"` | see Starting State |
    | `observe_fins` | bool, str | `False` | the fins' angles: hidden, seen, or `"reckoned"` |
    | `frame_skip` | int | `20` | physics steps of 0.01 s in each step; they divide an episode |
    | `render_mode` | str or None | `None` | `"rgb_array"`, or `"human"` where there is a display |
    | `task` | str or Task | `"forward"` | a name of `tasks.TASKS`, such as `"return"`, or a Task |
    | `reactive` | bool | `False` | whether the water also has added mass; see `simulate` |
    | `plan` | BodyPlan, str | the paper's | the fish: your own, a name of `PLANS`, a JSON file |

    An environment on the engine numba can be pickled and copied, also in mid-episode, and then
    behaves as the original. One on PyBullet belongs to its process: once reset, it cannot be
    pickled, and after a fork it refuses to work.

    ## Version History

    * v0: initial version.

    Examples
    --------
    >>> env = AquaFishEnv(damage="left_pectoral:length=0.5", engine="numba")
    >>> observation, info = env.reset(seed=0)
    >>> observation.shape, info["faults"]
    ((9,), 1)
    >>> env.close()
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 5}  # noqa: RUF012

    def __init__(
        self,
        morphology: object = None,
        damage: object = None,
        engine: str | type[World] = "auto",
        current: ArrayLike = (0.0, 0.0, 0.0),
        fin_angles: object = "random",
        observe_fins: bool | str = False,
        frame_skip: int = 20,
        render_mode: str | None = None,
        task: object = "forward",
        reactive: bool = False,
        plan: PlanLike = AQUAFISH,
    ) -> None:
        super().__init__(task, frame_skip, observe_fins, plan)
        self._config = episode.check_episode(
            self.task, morphology, damage, current, fin_angles, self.frame_skip, self.plan
        )
        self._reactive = flag("reactive", reactive)
        self.render_mode = check_render_mode(render_mode)
        # The class states which modes there are, the environment which of them work here.
        self.metadata = {
            "render_modes": usable_modes(), "render_fps": max(1, round(1 / self.dt))
        }  # fmt: skip
        self.action_space = episode.action_space(self.plan)
        self._shape = (len(self.plan.fins),)
        self.observation_space = episode.observation_space(self._limits)
        self._window: Window | None = None
        self._steps = self._last  # no episode has begun
        intact = Scenario.create(self._config.morphology)
        self._robot = OneRobot(
            episode.check_world(engine), intact, self.frame_skip, self._config.damage.may_be_late
        )
        self._memory: Memory = ()
        # The present state, or the last one before the robot diverged.
        self._fin_angles: Numbers = (0.0,) * len(self.plan.fins)
        self._reckoned = self._fin_angles
        self._state = at_rest(self._fin_angles)
        self._read_robot()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; see Starting State."""
        number = None if seed is None else integer("seed", seed, 0)
        config = self._config.with_options(episode.check_options(options))  # may refuse
        super().reset(seed=number)
        start, memories = episode.begin_episodes(
            [config], [self.np_random], self.frame_skip, self._reactive
        )
        self._memory = tuple(memories[0].tolist())
        world = self._robot.start(start)
        self._read_robot()
        self._state = world.state()
        self._fin_angles = world.fin_angles
        self._reckoned = self._fin_angles
        self._steps = 0
        here = self._state.position
        if self.render_mode == "human":
            self.render()
        idle = (0.0,) * len(self.plan.fins)
        still = Step(here, here, self._state.orientation, idle, self._memory, self.dt)
        nothing = dict.fromkeys(self.task.reward_terms(still), 0.0)
        return self._observe(), self._info(here, nothing)

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Set the servos for ``frame_skip`` physics steps.

        Raises
        ------
        InvalidArgumentError, ResetNeeded
            If the action is not a finite number for each servo, or the episode is over.
        """
        checked = episode.check_single_action(action, self._shape)
        before = self._state.position
        diverged = self._swim(checked)
        terms, succeeded = self._reward(before, checked, diverged)
        terminated = diverged or succeeded
        if not terminated and self._robot.change(self._steps * self.frame_skip):
            self._read_robot()
        info = self._info(before, terms, diverged, succeeded)
        if self.render_mode == "human":
            self.render()
        truncated = self._steps == self._last  # also what ends in the last step, as by TimeLimit
        if terminated:
            self._steps = self._last
        return self._observe(), sum(terms.values()), terminated, truncated, info

    def _swim(self, action: Numbers) -> bool:
        """Swim one step; return whether the robot diverged, and then keep its last state."""
        world = self._robot.world
        if world is None or self._steps == self._last:
            raise ResetNeeded("the episode is over or has not begun: call reset() before step()")
        self._robot.flow(self.task.current(self._memory, self._steps * self.dt))
        followed = self._robot.robots.follow(action)
        world.advance(servos(self.plan).speeds(followed), self.frame_skip)
        if world.diverged:
            return True
        self._steps += 1
        self._state = world.state()
        self._fin_angles = world.fin_angles
        if self._reckons:
            self._reckoned = reckon(self._reckoned, servos(self.plan).speeds(action), TAU * self.dt)
        return False

    def _reward(
        self, before: Vector, action: Numbers, diverged: bool
    ) -> tuple[dict[str, float], bool]:
        """Return the reward's terms, and whether there is success; let the task remember."""
        state = self._state
        step = Step(before, state.position, state.orientation, action, self._memory, self.dt)
        terms = {name: float(value) for name, value in self.task.reward_terms(step).items()}
        if diverged:
            return dict.fromkeys(terms, 0.0), False
        succeeded = bool(self.task.succeeded(step))
        self._memory = self.task.remember(step)
        return terms, succeeded

    def _observe(self) -> Observation:
        goal = self.task.goal(self._memory) if self.task.has_goal else None
        fins = None
        if self._observe_fins:
            fins = self._reckoned if self._reckons else self._fin_angles
        truth = observe(self._state, fins, goal)
        return self._robot.sense(truth, self._limits, [self.np_random])

    def _read_robot(self) -> None:
        truth = self._robot.robots.truth()
        self._truth = {n: np.array(r[0]) if r.ndim > 1 else r[0].item() for n, r in truth.items()}

    def _info(
        self,
        before: Vector,
        terms: dict[str, float],
        diverged: bool = False,
        succeeded: bool = False,
    ) -> dict[str, Any]:
        here = self._state.position
        along_x, along_y, along_z = subtract(here, before)
        velocity = (along_x / self.dt, along_y / self.dt, along_z / self.dt)
        info = episode.motion_info(here, velocity)
        info["diverged"] = diverged
        if self.task.has_success:
            info["is_success"] = succeeded
        info["fin_angles"] = np.array(self._fin_angles)
        for name, value in self._truth.items():
            info[name] = value.copy() if type(value) is np.ndarray else value
        episode.refuse_reserved(terms, info)
        info.update(terms)
        return info

    def render(self) -> Any:
        """Return a frame (480, 640, 3) uint8, or show it in the window; None without a mode."""
        if self.render_mode is None:
            return None
        body = Morphology.from_array(self._robot.robots.now.body[0], self.plan)
        pose = (self._state.position, self._state.orientation)
        if self.render_mode == "human":
            if self._window is None:
                self._window = Window(self.metadata["render_fps"])
            self._window.show(body, pose, self._fin_angles)
            return None
        return render_pose(body, pose, self._fin_angles)

    def close(self) -> None:
        """Free what the engine and the window hold; closing twice does no harm."""
        self._robot.close()
        if self._window is not None:
            self._window.close()
            self._window = None
