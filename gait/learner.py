"""A model of stable-baselines3 (extra ``rl``) that learns in legs, and what it has learned.

The library's own files hold pickles, which run whatever they contain when they are loaded. None is
written or read here: what learning goes on from is plain arrays.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from math import inf
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.utils.validation import MissingExtraError
from gait.network import GAIN, OUTPUTS

if TYPE_CHECKING:
    from aquafish_gym.damage import Damage
    from gait.baselines import BaselineConfig

GAMMA = 0.99
MOST_BATCH = 1600
HORIZON = 1000  # steps of 0.01 s from which PPO learns at a time, at least
_STATISTICS = ("mean", "var", "count")
REGISTER = 1e-3  # of an input is what a node that remembers it holds: tanh is then a straight line


class Network(NamedTuple):
    """Weights (N, I + N) and biases (N,) of a ``Controller``'s nodes."""

    weights: NDArray[np.float64]
    bias: NDArray[np.float64]


def dense_network(
    layers: Sequence[tuple[NDArray[np.floating], NDArray[np.floating]]],
    mean: NDArray[np.float64],
    scale: NDArray[np.float64],
) -> Network:
    """Return a stack of dense layers as a controller's nodes, whose responses are 1.

    The first layer hears (x - mean) / scale of the inputs x. Each is squashed by tanh, the last by
    that or by a clip at 1. A node computes tanh(2.5 z), so that weights and biases are divided.

    Parameters
    ----------
    layers
        Weights (out, in) and biases (out,) of each, in order; the last has three outputs.
    mean, scale
        (I,) each.

    Examples
    --------
    >>> layers = [(np.ones((4, 2)), np.zeros(4)), (np.ones((3, 4)), np.zeros(3))]
    >>> dense_network(layers, np.zeros(2), np.ones(2)).weights.shape
    (7, 9)
    """
    inputs, nodes = len(mean), sum(len(bias) for _, bias in layers)
    weights, biases = np.zeros((nodes, inputs + nodes)), np.zeros(nodes)
    begin, heard = 0, slice(0, inputs)
    for matrix, bias in layers:
        end = begin + len(bias)
        weights[begin:end, heard] = matrix / GAIN
        biases[begin:end] = bias / GAIN
        begin, heard = end, slice(inputs + begin, inputs + end)
    weights[:, :inputs] /= scale
    return Network(weights, biases - weights[:, :inputs] @ mean)


def with_memory(network: Network, frames: int) -> Network:
    """Return a network that hears frames F I of inputs, the latest last, as one that hears I.

    It remembers the others itself: before its three outputs come (F - 1) I nodes that hold the
    inputs of 1 to F - 1 times before. They are tanh nodes as all are, and hold a thousandth of an
    input, so that what they say is true to a millionth.

    Examples
    --------
    >>> with_memory(Network(np.ones((4, 6 + 4)), np.zeros(4)), 3).weights.shape
    (8, 10)
    """
    nodes = len(network.bias)
    inputs = (network.weights.shape[1] - nodes) // frames
    hidden, held = nodes - len(OUTPUTS), (frames - 1) * inputs
    place = np.r_[:hidden, hidden + held : nodes + held]
    weights, bias = np.zeros((nodes + held, inputs + nodes + held)), np.zeros(nodes + held)
    bias[place] = network.bias
    weights[np.ix_(place, inputs + place)] = network.weights[:, frames * inputs :]
    heard = network.weights[:, : frames * inputs].reshape(nodes, frames, inputs)
    weights[place, :inputs] = heard[:, -1]
    registers = hidden + np.arange(held)
    earlier = heard[:, -2::-1].reshape(nodes, held)
    weights[np.ix_(place, inputs + registers)] = earlier / REGISTER
    # The first of them hear the inputs, the others those before them.
    weights[registers[:inputs], np.arange(inputs)] = REGISTER / GAIN
    weights[registers[inputs:], inputs + registers[:-inputs]] = 1.0 / GAIN
    return Network(weights, bias)


def load(module: str) -> Any:
    """Return a module of the extra ``rl``, or raise MissingExtraError."""
    try:
        return import_module(module)
    except ImportError as error:
        raise MissingExtraError(
            "learning needs stable-baselines3, sb3-contrib and torch, which are not all installed "
            f"here ({error}): "
            'pip install ".[rl]" in a clone of the repository'
        ) from None


class Learner:
    """An actor that learns a task with bodies (M, 9), from a seed.

    A leg, of so many ``steps`` of all robots together, begins with fresh robots and with streams
    of random numbers that follow from its seed. So what the legs before it have come to is
    :attr:`state` and nothing else (of PPO: others have a buffer of what happened, too).

    Attributes
    ----------
    model
        The library's own.

    Raises
    ------
    MissingExtraError
        If stable-baselines3 or torch is not installed.
    """

    def __init__(
        self, bodies: NDArray[np.float64], config: BaselineConfig, damage: Damage, seed: int
    ) -> None:
        sb3, torch = load("stable_baselines3"), load("torch")
        vec_env, logger = (
            load(f"stable_baselines3.common.{name}") for name in ("vec_env", "logger")
        )
        self.algorithm, self.steps = config.algorithm, config.leg
        self._frames = config.frames
        self._robots = load("gait.sb3_env").LaneVecEnv(
            config.environments, bodies, config.felt, config.clock, config.interval, config.task,
            damage,
        )  # fmt: skip
        heard = self._robots
        if config.frames > 1:
            heard = vec_env.VecFrameStack(heard, config.frames)
        # No input is far out, so that none need be cut off, which weights could not say.
        self._normal = vec_env.VecNormalize(heard, gamma=GAMMA, clip_obs=inf, epsilon=1e-4)
        with apart():
            self.model = getattr(sb3, config.algorithm)(
                "MlpPolicy",
                self._normal,
                gamma=GAMMA,
                policy_kwargs={"net_arch": list(config.hidden), "activation_fn": torch.nn.Tanh},
                device="cpu",
                seed=seed,
                **self._settings(config.leg // config.environments, config.interval),
            )
        self.model.set_logger(logger.Logger(None, []))
        if config.algorithm == "PPO":
            # As Adam begins, but from the start, so that there is a place for what was kept.
            optimizer = self.model.policy.optimizer
            for parameter in self.model.policy.parameters():
                optimizer.state[parameter] = {
                    "step": torch.tensor(0.0),
                    "exp_avg": torch.zeros_like(parameter),
                    "exp_avg_sq": torch.zeros_like(parameter),
                }

    def _settings(self, episode: int, interval: int) -> dict[str, Any]:
        if self.algorithm == "PPO":
            # From ten seconds each time more is learned than from a whole episode.
            parts = [n for n in range(1, episode) if episode % n == 0 and n * interval >= HORIZON]
            steps = min(parts, default=episode)
            size = self.steps // episode * steps
            batch = max(n for n in range(1, MOST_BATCH + 1) if size % n == 0)
            return {"n_steps": steps, "batch_size": batch, "n_epochs": 6, "learning_rate": 1e-3}
        found = {
            "learning_starts": self.steps,
            "gradient_steps": 8,
            "batch_size": 512,
            "learning_rate": 1e-3,
        }
        if self.algorithm == "TD3":  # which explores by this alone
            noise = load("stable_baselines3.common.noise").NormalActionNoise
            found["action_noise"] = noise(np.zeros(3), np.full(3, 0.2))
        return found

    def learn(self, seed: int, on_step: Callable[[int], None]) -> float:
        """Learn for a leg; return what its last episodes came to in the mean, see ``perform``.

        ``on_step`` is told how many steps of the leg have been taken.
        """
        model, before = self.model, self.model.num_timesteps

        def callback(_locals: dict[str, Any], _globals: dict[str, Any]) -> bool:
            on_step(model.num_timesteps - before)
            return True

        with apart():
            model.set_random_seed(seed)
            model.set_env(self._normal)  # which it then resets
            model.learn(self.steps, callback, reset_num_timesteps=False)
        return float(self._robots.earned.mean())

    def network(self) -> Network:
        """Return the actor, which always does what it likes best."""
        policy, linear = self.model.policy, load("torch").nn.Linear
        if self.algorithm == "PPO":
            parts = [policy.mlp_extractor.policy_net, policy.action_net]
        elif self.algorithm == "SAC":
            parts = [policy.actor.latent_pi, policy.actor.mu]
        else:
            parts = [policy.actor.mu]
        dense = [one for part in parts for one in part.modules() if isinstance(one, linear)]
        layers = [(array(one.weight), array(one.bias)) for one in dense]
        felt = self._normal.obs_rms
        network = dense_network(layers, felt.mean, np.sqrt(felt.var + self._normal.epsilon))
        return network if self._frames == 1 else with_memory(network, self._frames)

    @property
    def state(self) -> dict[str, NDArray[Any]]:
        """All that PPO's next leg goes on from, by name."""
        found = {name: array(tensor) for name, tensor in self._tensors().items()}
        for name, one in self._running().items():
            found |= {f"{name}.{what}": np.asarray(getattr(one, what)) for what in _STATISTICS}
        return found

    @state.setter
    def state(self, arrays: dict[str, NDArray[Any]]) -> None:
        torch = load("torch")
        with torch.no_grad():
            for name, tensor in self._tensors().items():
                tensor.copy_(torch.as_tensor(arrays[name]))
        for name, one in self._running().items():
            for what in _STATISTICS:
                setattr(one, what, arrays[f"{name}.{what}"][()])

    def _tensors(self) -> dict[str, Any]:
        policy = self.model.policy
        moments = policy.optimizer.state_dict()["state"].items()
        return {f"policy.{name}": tensor for name, tensor in policy.state_dict().items()} | {
            f"adam.{i}.{name}": tensor for i, held in moments for name, tensor in held.items()
        }

    def _running(self) -> dict[str, Any]:
        return {"observations": self._normal.obs_rms, "returns": self._normal.ret_rms}


def array(tensor: Any) -> NDArray[np.floating]:
    return np.array(tensor.detach().numpy())


@contextmanager
def apart() -> Iterator[None]:
    """Put the generators that the library seeds back after, and have torch on one thread.

    Networks this small lose more to a second thread than they gain.
    """
    torch = load("torch")
    python, legacy = random.getstate(), np.random.get_state()  # noqa: NPY002
    own, threads = torch.get_rng_state(), torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        random.setstate(python)
        np.random.set_state(legacy)  # noqa: NPY002
        torch.set_rng_state(own)
        torch.set_num_threads(threads)
