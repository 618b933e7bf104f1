"""Reinforcement learning for comparison: stable-baselines3 on the tasks (extra ``rl``).

What is learned is a ``Controller``, and swims wherever one does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import asdict, astuple, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.bodies import (
    MorphologiesLike,
    body_array,
    median_body,
    sample_stamp,
    write_bodies,
)
from aquafish_gym.damage import Damage
from aquafish_gym.engines.base import TIMESTEP
from aquafish_gym.envs.tasks import TASKS
from aquafish_gym.runs.arrays import read_arrays, write_arrays
from aquafish_gym.runs.folder import claim, held
from aquafish_gym.runs.storage import DamagedFileError, ensure_writable_directory
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    finite_array,
    integer,
    one_of,
)
from gait.config import Sense, TaskName, check_interval, check_senses
from gait.controller import MAXIMUM_NODES, MAXIMUM_SEED, Controller
from gait.evolve import FINAL_POSES
from gait.fitness import Swims, worth
from gait.learner import Learner, Network
from gait.network import OUTPUTS, Senses
from gait.records import BODIES_FILE, CONTROLLER_FILE, write_history
from gait.rollout import random_poses, stream, swim_all

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CHECKPOINT_FILE, CURVE_FILE = "checkpoint.npz", "curve.csv"
FILES = (CHECKPOINT_FILE, CURVE_FILE, CONTROLLER_FILE)  # and a sample's BODIES_FILE
ALGORITHMS = ("PPO", "SAC", "TD3")
RESUMED = "PPO"
MOST_HIDDEN = MAXIMUM_NODES - len(OUTPUTS)


@dataclass(frozen=True, kw_only=True)
class BaselineConfig:
    """What to learn with.

    Examples
    --------
    >>> BaselineConfig(environments=8).leg
    800
    """

    algorithm: str = "PPO"
    """What learns: PPO, which goes on after an interruption and which the settings suit; SAC or
    TD3, which are slower and start again."""
    steps: int = 1_500_000
    """Actions of all robots together, rounded up to whole legs: an episode of each."""
    environments: int = 256
    """How many robots learn side by side."""
    interval: int = 20
    """For how many steps of 0.01 s an action is held. Where it is short, little is learned."""
    senses: tuple[Sense, ...] = ("imu", "clock", "fins")
    """What the controller feels, besides the way to a goal where the task has one. The fins are not
    measured, but known from where they stood at first and what they were told since."""
    task: TaskName = "forward"
    """What to do: swim forward, or another task of the environments."""
    frames: int = 1
    """How many of its last inputs the controller hears together: more than one is a memory."""
    clock: float = 0.7
    """Frequency of the clock, in Hz."""
    hidden: tuple[int, ...] = (64, 64)
    """Widths of the hidden layers."""
    seed: int = 0
    """The run follows from it alone."""

    def __post_init__(self) -> None:
        one_of("algorithm", self.algorithm, ALGORITHMS)
        integer("steps", self.steps, 1, 10**10)
        integer("environments", self.environments, 1, 1024)
        one_of("task", self.task, get_args(TaskName))
        check_interval(self.interval, TASKS[self.task].seconds)
        object.__setattr__(self, "senses", check_senses(self.senses))
        finite_array("clock", self.clock, (), 0.0, 50.0, "Hz")
        if not isinstance(self.hidden, list | tuple):
            raise InvalidArgumentError(f"hidden must be widths in a row; got {brief(self.hidden)}")
        widths = tuple(integer("hidden", width, 1, MOST_HIDDEN) for width in self.hidden)
        if sum(widths) > MOST_HIDDEN:
            raise InvalidArgumentError(
                f"hidden must be at most {MOST_HIDDEN} nodes together; got {sum(widths)}"
            )
        object.__setattr__(self, "hidden", widths)
        most = 1 + (MOST_HIDDEN - sum(widths)) // len(self.felt.names)
        integer("frames", self.frames, 1, most)
        integer("seed", self.seed, 0, MAXIMUM_SEED)

    @property
    def felt(self) -> Senses:
        """What a controller feels, as it says it."""
        return Senses(
            "imu" in self.senses,
            int("clock" in self.senses),
            "fins" in self.senses,
            TASKS[self.task].has_goal,
        )

    @property
    def leg(self) -> int:
        """Steps of a leg, after which what is learned is scored and kept."""
        return self.environments * (round(self.seconds / TIMESTEP) // self.interval)

    @property
    def seconds(self) -> float:
        """How long an episode is."""
        return TASKS[self.task].seconds

    @property
    def legs(self) -> int:
        """How many legs the steps are."""
        return -(-self.steps // self.leg)


@dataclass(frozen=True)
class Leg:
    """One row of ``curve.csv``, whose columns ``gait baseline --help`` explains."""

    steps: int
    training: float
    score: float


@dataclass(frozen=True)
class Baseline:
    """What learning has come to.

    Attributes
    ----------
    controller
        The one with the highest score of all legs'.
    score
        Its mean distance in 20 s from 32 random poses that are the same throughout, in units; of a
        sample from as many more as it takes for each body to swim equally often. Of another task
        than "forward", or with damage that lasts not throughout, what :func:`gait.task.perform`
        says instead.
    curve
        One row a leg.

    Examples
    --------
    >>> body = median_body(np.full((1, 9), 0.5))
    >>> silent = Controller(np.zeros((3, 14)), np.zeros(3), np.ones(3), 0.7, body, seed=0)
    >>> Baseline(silent, 1.5, (Leg(800, 0.5, 1.5),))
    Baseline(score 1.50, Controller(3 nodes, 0 connections, clock 0.7 Hz, seed 0))
    """

    controller: Controller
    score: float
    curve: tuple[Leg, ...]

    def __repr__(self) -> str:
        return f"Baseline(score {self.score:.2f}, {self.controller!r})"

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw the curve, on matplotlib's present figure or the axes given."""
        from gait.plots import draw_curve

        return draw_curve(self.curve, axes)


class _Run:
    """A learner, a leg at a time."""

    def __init__(self, bodies: NDArray[np.float64], config: BaselineConfig, damage: Damage) -> None:
        self.bodies, self.config, self.damage = bodies, config, damage
        self.sample = sample_stamp(bodies) if len(bodies) > 1 else None
        self.curve: list[Leg] = []
        self.best: Network | None = None
        self._learner = Learner(bodies, config, damage, self._seed())
        # The random ones that gaits are judged by that are evolved with this seed.
        count = -(-FINAL_POSES // len(bodies)) * len(bodies)
        poses = random_poses(count, stream(config.seed, 1))
        self._swims = Swims(np.resize(bodies, (count, 9)), poses)

    def _seed(self, *leg: int) -> int:
        return int(stream(self.config.seed, 8, *leg).generate_state(1)[0])

    @property
    def settings(self) -> dict[str, Any]:
        """All that a run follows from, but for how long it is."""
        settings = asdict(self.config)
        del settings["steps"]
        if self.damage:
            settings["damage"] = str(self.damage)
        sample = {} if self.sample is None else {"sample": self.sample}
        return {"morphology": median_body(self.bodies).to_dict(), **sample, **settings}

    @property
    def score(self) -> float:
        """The highest so far."""
        return max((leg.score for leg in self.curve), default=-np.inf)

    def step(self, tell: Callable[[int, Sequence[Leg]], None]) -> None:
        """Learn for a leg, and score what that has come to."""
        before, size = len(self.curve) * self.config.leg, self.config.leg

        def taken(steps: int) -> None:
            if steps < size:  # the last one is told of when it is scored and kept
                tell(before + steps, self.curve)

        training = self._learner.learn(self._seed(len(self.curve)), taken)
        network = self._learner.network()
        far = worth(self._earned(self.controller(network)), self.config.seconds)
        leg = Leg(before + size, training, float(far.mean()))
        if leg.score > self.score:
            self.best = network
        self.curve.append(leg)

    def _earned(self, controller: Controller) -> NDArray[np.float64]:
        if self.config.task == "forward" and not self.damage:
            return swim_all([controller], *self._swims)
        from gait.task import perform  # which needs gymnasium

        return perform(
            [controller], *self._swims, task=self.config.task, damage=self.damage, seed=0
        )

    def controller(self, network: Network) -> Controller:
        """Return an actor as a controller."""
        c = self.config
        held = len(network.bias) - sum(c.hidden) - len(OUTPUTS)
        return Controller(
            *network,
            response=np.ones(len(network.bias)),
            clock=c.clock,
            morphology=median_body(self.bodies),
            seed=c.seed,
            sample=self.sample,
            senses=c.felt,
            layers=(*c.hidden, held, len(OUTPUTS)) if held else (*c.hidden, len(OUTPUTS)),
            # PPO's actions are cut off by whoever takes them.
            output="clip" if c.algorithm == "PPO" else "tanh",
            interval=c.interval,
        )

    def result(self) -> Baseline:
        """Return what the run has come to, once there is a leg."""
        assert self.best is not None
        return Baseline(self.controller(self.best), self.score, tuple(self.curve))

    def write(self, directory: Path) -> None:
        """Write everything that the rest of the run depends on, and then the results."""
        assert self.best is not None
        if self.config.algorithm == RESUMED:
            best = {f"best.{name}": array for name, array in self.best._asdict().items()}
            curve = np.array([astuple(leg) for leg in self.curve])
            arrays = {**self._learner.state, **best, "curve": curve}
            write_arrays(directory / CHECKPOINT_FILE, arrays)
        self.controller(self.best).save(directory / CONTROLLER_FILE)
        write_history(directory / CURVE_FILE, self.curve)

    def read(self, directory: Path) -> None:
        """Go on from what :meth:`write` wrote for the same settings."""
        path = directory / CHECKPOINT_FILE
        shapes = {name: array.shape for name, array in self._learner.state.items()}
        network = self._learner.network()
        best = {f"best.{name}": array.shape for name, array in network._asdict().items()}
        try:
            arrays = read_arrays(path, {**shapes, **best, "curve": (None, 3)}, "out")
        except DamagedFileError as error:
            raise DamagedFileError(f"{error}; delete it to start again") from None
        self.curve = [Leg(int(steps), *rest) for steps, *rest in arrays.pop("curve").tolist()]
        if not self.curve:
            raise DamagedFileError(f"out: {path} holds no leg; delete it to start again")
        if len(self.curve) > self.config.legs:
            raise InvalidArgumentError(
                f"steps must be at least the {len(self.curve) * self.config.leg} that out already "
                f"holds; got {self.config.steps}"
            )
        self.best = Network(*(arrays.pop(name) for name in best))
        self._learner.state = arrays


def train_baseline(
    morphologies: MorphologiesLike = None,
    config: BaselineConfig | None = None,
    *,
    damage: object = None,
    out: Path | str | None = None,
    on_step: Callable[[int, Sequence[Leg]], None] | None = None,
) -> Baseline:
    """Learn a task with a body, or with a sample of bodies: domain randomisation.

    The robots that learn side by side have a sample's bodies in turn, and all begin from random fin
    poses. Observations and rewards are normalised as they come; what observations are
    normalised by is in the controller's weights in the end.

    Parameters
    ----------
    morphologies
        The body, as ``Morphology.coerce`` takes it; None is the nominal one. Or a list of such, or
        (M, 9) sizes: a sample, of ``config.environments`` at most.
    config
        How; None is ``BaselineConfig()``.
    damage
        What breaks while it learns, as the environment takes it: ``"random:moderate"`` is other
        damage in each episode.
    out
        A directory for ``controller.json`` (the best so far), ``curve.csv`` and, of PPO,
        ``checkpoint.npz``, all brought up to date after each leg, and a sample's ``bodies.json``.
        If it holds an unfinished run of PPO on the same bodies with the same configuration, that
        is taken up, and ends in the same files as if it had never stopped; more ``steps`` prolong
        it.
    on_step
        Told how many steps have been taken, and the legs so far.

    Raises
    ------
    MissingExtraError
        If stable-baselines3 or torch is not installed.
    InvalidArgumentError
        If a body is none, or ``out`` cannot be written, is in use by another command, or holds
        another run, a longer one or a damaged checkpoint.
    """
    config = config or BaselineConfig()
    bodies = body_array(morphologies)
    if not 1 <= len(bodies) <= config.environments:
        raise InvalidArgumentError(
            f"morphologies must be 1 to {config.environments} bodies, as many as environments at "
            f"most; got {len(bodies)}"
        )
    run, tell = (
        _Run(bodies, config, Damage.coerce(damage)),
        on_step or (lambda _steps, _curve: None),
    )
    directory = None if out is None else ensure_writable_directory(out)
    with held(directory) if directory else nullcontext():
        if directory:
            claim(directory, "a baseline", run.settings, outputs=FILES)
            if run.sample:
                write_bodies(directory / BODIES_FILE, bodies)
            if (directory / CHECKPOINT_FILE).exists():
                run.read(directory)
                run.write(directory)  # a kill may have left the results a leg behind
                tell(run.curve[-1].steps, run.curve)
        while len(run.curve) < config.legs:
            run.step(tell)
            if directory:
                run.write(directory)
            tell(run.curve[-1].steps, run.curve)
        return run.result()
