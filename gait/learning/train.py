"""Reinforcement learning for comparison: PPO of stable-baselines3 on the tasks (extra ``rl``).

The learned policy is exported as a ``Controller``. The library's own model files hold pickles,
so none is written or read.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from importlib import import_module
from math import inf
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.bodies import MorphologiesLike, body_array, median_body, plan_key, sample_stamp
from aquafish_gym.damage import Damage
from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.envs.tasks import TASKS
from aquafish_gym.plans import AQUAFISH, PlanLike, check_plan
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    MissingExtraError,
    brief,
    callback,
    finite_array,
    flag,
    install_advice,
    instance,
    integer,
    one_of,
)
from aquafish_gym.world_config import WorldConfig
from gait.controllers.controller import MAXIMUM_SEED, Controller
from gait.controllers.network import OUTPUT_GAIN, Senses
from gait.files import CONTROLLER_FILE, run_folder, write_rows
from gait.search.config import AnyPlan, Sense, TaskName, check_interval, check_senses, make_senses
from gait.search.evolve import FINAL_POSES
from gait.swims.poses import random_poses, stream
from gait.swims.scores import scores

CURVE_FILE = "curve.csv"
TRAINING_FILES = (CURVE_FILE, CONTROLLER_FILE)  # and a sample's bodies.json
HIDDEN_WIDTHS = (64, 64)  # widths of the hidden layers
CLOCK_HZ = 0.7  # Hz
GAMMA = 0.99
MAXIMUM_BATCH = 1600
LEAST_ROLLOUT_STEPS = 1000  # physics steps in a rollout of PPO, at least


@dataclass(frozen=True, kw_only=True)
class LearningConfig:
    """How PPO learns a task.

    Examples
    --------
    >>> LearningConfig(environments=8).epoch_steps
    800
    """

    steps: int = 1_500_000
    """Actions of all robots together, rounded up to whole episodes of each robot."""
    environments: int = 256
    """Number of robots that learn side by side."""
    interval: int = 20
    """Steps of 0.01 s that an action is held. Little is learned with short ones."""
    senses: tuple[Sense, ...] = ("imu", "clock", "fins")
    """What the controller observes, besides the direction to a goal if the task has one. Fin angles
    are not measured: they are integrated from the initial angles and the commands."""
    task: TaskName = "forward"
    """Swim forward, or another task of the environments."""
    plan: AnyPlan = "aquafish"
    """The robots' body plan: its name, or a JSON file; in Python also a BodyPlan."""
    reactive: bool = False
    """Whether the water also has added mass."""
    seed: int = 0
    """Seed of everything random in the run."""

    def __post_init__(self) -> None:
        flag("reactive", self.reactive)
        integer("steps", self.steps, 1, 10**10)
        integer("environments", self.environments, 1, 1024)
        integer("seed", self.seed, 0, MAXIMUM_SEED)
        one_of("task", self.task, get_args(TaskName))
        plan = check_plan(self.plan)
        if self.plan != plan.name:  # of a file, which is read once
            object.__setattr__(self, "plan", plan)
        check_interval(self.interval, TASKS[self.task].seconds)
        object.__setattr__(self, "senses", check_senses(self.senses))

    @property
    def inputs(self) -> Senses:
        """The inputs of the controller."""
        return make_senses(self.senses, self.task)

    @property
    def seconds(self) -> float:
        """Length of an episode, in s."""
        return TASKS[self.task].seconds

    @property
    def episode_actions(self) -> int:
        """Actions of one robot in an episode."""
        return round(self.seconds / TIMESTEP) // self.interval

    @property
    def epoch_steps(self) -> int:
        """Actions of all robots in an epoch: one episode of each."""
        return self.environments * self.episode_actions

    @property
    def epochs(self) -> int:
        """Number of epochs."""
        return -(-self.steps // self.epoch_steps)


@dataclass(frozen=True)
class CurvePoint:
    """One row of ``curve.csv``; ``gait baseline --help`` explains the columns."""

    steps: int
    training: float
    score: float


@dataclass(frozen=True)
class Learned:
    """The result of :func:`train`.

    Attributes
    ----------
    controller
        The one with the highest score over all epochs.
    score
        Its mean distance in 20 s from 32 fixed random poses, in units of 5 cm (see
        :func:`gait.scores` for other tasks); for a sample, from as many for
        each body.
    curve
        One point an epoch.
    """

    controller: Controller
    score: float
    curve: tuple[CurvePoint, ...] = field(repr=False)


def train(
    morphologies: MorphologiesLike = None,
    config: LearningConfig | None = None,
    *,
    damage: object = None,
    out: Path | str | None = None,
    on_epoch: Callable[[CurvePoint], None] | None = None,
) -> Learned:
    """Learn a task on a body, or on a sample of bodies: domain randomisation.

    The robots have a sample's bodies in turn, and start from random fin poses. Observations and
    rewards are normalised online; the controller's weights include the observations' scale.

    Parameters
    ----------
    morphologies
        As of :func:`gait.evolve_gait`, at most ``config.environments`` of them.
    config
        None is ``LearningConfig()``.
    damage
        What breaks while it learns, as the environment takes it: ``"random:moderate"`` samples
        other damage in each episode.
    out
        A folder for ``controller.json`` (the best so far) and ``curve.csv``, both rewritten after
        each epoch, and a sample's ``bodies.json``. A run does not resume: it starts again.
    on_epoch
        Called with each point of the curve.

    Raises
    ------
    MissingExtraError
        If stable-baselines3 or torch is not installed.
    InvalidArgumentError
        If an argument does not fit, or ``out`` cannot be written, is in use, or holds another run.
    """
    config = LearningConfig() if config is None else instance("config", config, LearningConfig)
    plan = check_plan(config.plan)
    bodies = body_array(morphologies, plan=plan)
    if not 1 <= len(bodies) <= config.environments:
        raise InvalidArgumentError(
            f"morphologies must be 1 to {config.environments} bodies, at most one for each of the "
            f"environments; got {len(bodies)}"
        )
    callback("on_epoch", on_epoch)
    broken = Damage.coerce(damage)
    learner = _Learner(bodies, config, broken)
    # From the poses of a gait that is evolved with this seed, and as often with each body.
    count = -(-FINAL_POSES // len(bodies)) * len(bodies)
    poses = random_poses(count, stream(config.seed, 1), plan)
    world = WorldConfig(reactive=config.reactive)
    swims = np.resize(bodies, (count, bodies.shape[1])), poses
    settings = {"morphology": median_body(bodies, plan).to_dict(), **asdict(config)}
    del settings["plan"], settings["reactive"]
    settings |= plan_key(plan) | ({"reactive": True} if config.reactive else {})
    settings |= {"damage": str(broken)} if broken else {}
    settings |= {"sample": sample_stamp(bodies)} if len(bodies) > 1 else {}
    best = Learned(learner.controller(), -inf, ())
    curve = list[CurvePoint]()
    with run_folder(out, "a baseline", settings, TRAINING_FILES, bodies, plan=plan) as folder:
        for epoch in range(1, config.epochs + 1):
            training = learner.learn(_seed(config, epoch - 1))
            controller = learner.controller()
            found = scores([controller], *swims, task=config.task, damage=broken, world=world)
            score = float(found.mean())
            curve.append(CurvePoint(epoch * config.epoch_steps, training, score))
            if score > best.score:
                best = Learned(controller, score, ())
            if folder:
                best.controller.save(folder / CONTROLLER_FILE)
                write_rows(folder / CURVE_FILE, curve)
            if on_epoch:
                on_epoch(curve[-1])
    return Learned(best.controller, best.score, tuple(curve))


def _seed(config: LearningConfig, *key: int) -> int:
    return int(stream(config.seed, 8, *key).generate_state(1)[0])


class _Learner:
    """PPO on bodies (M, S), an epoch at a time; each epoch has a seed and new robots."""

    def __init__(self, bodies: NDArray[np.float64], config: LearningConfig, damage: Damage) -> None:
        sb3 = load_extra("stable_baselines3")
        torch = load_extra("torch")
        vec_env = load_extra("stable_baselines3.common.vec_env")
        logger = load_extra("stable_baselines3.common.logger")
        self.plan = check_plan(config.plan)
        self.bodies = bodies
        self.config = config
        self.robots = load_extra("gait.learning.sb3_env").LaneVecEnv(
            config.environments,
            bodies,
            config.inputs,
            CLOCK_HZ,
            config.interval,
            config.task,
            damage,
            self.plan,
            config.reactive,
        )
        # Without a clip, which the exported weights could not express.
        self.normal = vec_env.VecNormalize(self.robots, gamma=GAMMA, clip_obs=inf, epsilon=1e-4)
        # More is learned from rollouts of ten seconds than from whole episodes.
        actions = config.episode_actions
        horizons = [
            n
            for n in range(1, actions)
            if not actions % n
            and n * config.interval >= LEAST_ROLLOUT_STEPS
            and n * config.environments > 1  # PPO takes no batch of one action
        ]
        horizon = min(horizons, default=actions)
        size = config.environments * horizon
        with isolated_rng():
            self.model = sb3.PPO(
                "MlpPolicy",
                self.normal,
                gamma=GAMMA,
                n_steps=horizon,
                batch_size=max(n for n in range(1, MAXIMUM_BATCH + 1) if not size % n),
                n_epochs=6,
                learning_rate=1e-3,
                policy_kwargs={"net_arch": list(HIDDEN_WIDTHS), "activation_fn": torch.nn.Tanh},
                device="cpu",
                seed=_seed(config),
            )
        self.model.set_logger(logger.Logger(None, []))

    def learn(self, seed: int) -> float:
        """Learn for an epoch, and return the mean return of the last episodes."""
        with isolated_rng():
            self.model.set_random_seed(seed)
            self.model.set_env(self.normal)  # resets the robots
            self.model.learn(self.config.epoch_steps, reset_num_timesteps=False)
        return float(self.robots.earned.mean())

    def controller(self) -> Controller:
        """Return the policy's mean action as a controller."""
        policy = self.model.policy
        config = self.config
        layers = [
            (module.weight.detach().numpy(), module.bias.detach().numpy())
            for part in (policy.mlp_extractor.policy_net, policy.action_net)
            for module in part.modules()
            if isinstance(module, load_extra("torch").nn.Linear)
        ]
        moments = self.normal.obs_rms
        scale = np.sqrt(moments.var + self.normal.epsilon)
        weights, bias = dense_network(layers, moments.mean, scale, self.plan)
        return Controller(
            weights,
            bias,
            response=np.ones(len(bias)),
            clock=CLOCK_HZ,
            morphology=median_body(self.bodies, self.plan),
            seed=config.seed,
            sample=sample_stamp(self.bodies) if len(self.bodies) > 1 else None,
            senses=config.inputs,
            layers=(*HIDDEN_WIDTHS, len(self.plan.fins)),
            output="clip",  # the environment clips PPO's actions
            interval=config.interval,
        )


def dense_network(
    layers: Sequence[tuple[NDArray[np.floating], NDArray[np.floating]]],
    mean: NDArray[np.float64],
    scale: NDArray[np.float64],
    plan: PlanLike = AQUAFISH,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return weights (N, I + N) and biases (N,) of a controller from a stack of dense layers.

    A node computes tanh(2.5 z), so weights and biases are divided by 2.5. All responses are 1.

    Parameters
    ----------
    layers
        Weights (out, in) and biases (out,) of each layer, in order; the last has an output for each
        servo.
    mean, scale
        (I,) each: the first layer receives (x - mean) / scale of the inputs x.
    plan
        The body plan of the controller's robots.

    Raises
    ------
    InvalidArgumentError
        If a layer does not fit the one before, or the last has not an output for each servo.

    Examples
    --------
    >>> layers = [(np.ones((4, 2)), np.zeros(4)), (np.ones((3, 4)), np.zeros(3))]
    >>> dense_network(layers, np.zeros(2), np.ones(2))[0].shape
    (7, 9)
    """
    mean = finite_array("mean", mean, (None,))
    if not len(mean):
        raise InvalidArgumentError("mean must have an entry for each input; got none")
    scale = finite_array("scale", scale, mean.shape, np.finfo(float).tiny)
    inputs = len(mean)
    layers = _check_layers(layers, inputs, len(check_plan(plan).fins))
    nodes = sum(len(bias) for _, bias in layers)
    weights = np.zeros((nodes, inputs + nodes))
    biases = np.zeros(nodes)
    begin = 0
    sources = slice(0, inputs)
    for matrix, bias in layers:
        end = begin + len(bias)
        weights[begin:end, sources] = matrix / OUTPUT_GAIN
        biases[begin:end] = bias / OUTPUT_GAIN
        sources = slice(inputs + begin, inputs + end)
        begin = end
    weights[:, :inputs] /= scale
    return weights, biases - weights[:, :inputs] @ mean


def _check_layers(
    layers: object, inputs: int, outputs: int
) -> list[tuple[NDArray[Any], NDArray[Any]]]:
    """Return layers whose shapes follow each other, from ``inputs`` to ``outputs``."""
    if not isinstance(layers, list | tuple) or not layers:
        raise InvalidArgumentError(
            f"layers must be a list of weights and biases of each layer; got {brief(layers)}"
        )
    checked = list[tuple[NDArray[Any], NDArray[Any]]]()
    sources = inputs
    for i, layer in enumerate(layers):
        if not isinstance(layer, list | tuple) or len(layer) != 2:
            raise InvalidArgumentError(
                f"layers[{i}] must be a pair of weights and biases; got {brief(layer)}"
            )
        last = outputs if i == len(layers) - 1 else None
        bias = finite_array(f"layers[{i}] biases", layer[1], (last,))
        matrix = finite_array(f"layers[{i}] weights", layer[0], (len(bias), sources))
        checked.append((matrix, bias))
        sources = len(bias)
    return checked


def load_extra(module: str) -> Any:
    """Return a module of the extra ``rl``, or raise MissingExtraError."""
    try:
        return import_module(module)
    except ImportError as error:
        raise MissingExtraError(
            "learning needs stable-baselines3, sb3-contrib and torch, which are not all installed "
            f"here ({error}): {install_advice('rl')}"
        ) from None


@contextmanager
def isolated_rng() -> Iterator[None]:
    """Restore the global random generators afterwards, and run torch on one thread.

    Networks this small lose more to a second thread than they gain.
    """
    torch = load_extra("torch")
    python = random.getstate()
    legacy = np.random.get_state()  # noqa: NPY002
    own = torch.get_rng_state()
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        random.setstate(python)
        np.random.set_state(legacy)  # noqa: NPY002
        torch.set_rng_state(own)
        torch.set_num_threads(threads)
