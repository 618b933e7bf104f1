"""Any swimming is an experiment: the body from what a robot did by itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from math import gcd
from typing import NamedTuple, NoReturn, Unpack

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.command import check_commands
from aquafish_gym.morphology import Morphology
from aquafish_gym.utils.validation import finite_array
from eea.aquafish.estimate import MorphologyEstimate, fish_problem
from eea.aquafish.sampling import at_times, steps_for
from eea.aquafish.simulator import EngineSimulator, SimulatorOptions
from eea.core.angles import Floats
from eea.core.checks import ConfigurationError, TargetError, instance, whole
from eea.core.config import EEAConfig

#: Samples of the commands before a window that its servos may still obey: a lag of 0.2 s.
BEFORE = 20


class Trace(NamedTuple):
    """What a robot was told and felt, 100 times a second.

    ``commands`` (N, 3), rev/s, rev/s and Hz, are in force in the 0.01 s that end with the samples
    of ``gyro`` (N, 3), rad/s about the body's axes.

    Examples
    --------
    >>> len(Trace(np.zeros((500, 3)), np.zeros((500, 3))).gyro)
    500
    """

    commands: Floats
    gyro: Floats


class Windows(NamedTuple):
    """Swims cut into windows of T samples, to be simulated for K steps of 0.01 s."""

    series: Floats  #: (E, ., 3) commands.
    spin: Floats  #: (E, 3) the gyroscope just before.
    gyro: Floats  #: (E, T, 3).
    interval: int  #: Samples that each command is held.
    begun: int  #: Samples of a series before its window.
    #: (E, T) s after each window's beginning; None for a sample each 0.01 s.
    time: Floats | None = None


def windows(swims: Sequence[Trace], moving: bool, steps: int | None = None) -> Windows:
    """Cut swims into windows of equal length.

    Parameters
    ----------
    swims
        One after another; a swim's commands before a window tell how its servos move when it
        begins.
    moving
        Whether the robot was already under way when each swim's record begins: then what is before
        the first window of each is only looked at for that. Else each begins at rest, and its first
        ``steps`` samples are its one window.
    steps
        Length of a window in samples; None for as long as the shortest swim allows.

    Raises
    ------
    ConfigurationError
        If a swim is shorter than that, or there is none.
    InvalidArgumentError
        If a command is none of the fish's, or a sample not finite.
    """
    before = BEFORE if moving else 0
    told, felt = [], []
    for number, (commands, gyro) in enumerate(swims, 1):
        told.append(check_commands(commands, f"commands of swim {number}"))
        felt.append(finite_array(f"gyro of swim {number}", gyro, (len(told[-1]), 3), unit="rad/s"))
    if not told:
        raise ConfigurationError("swims must hold at least one; got none")
    shortest = min(map(len, told)) - before
    steps = shortest if steps is None else steps
    whole("steps", steps, 1, max(shortest, 1))
    cuts = [
        (i, first)
        for i, gyro in enumerate(felt)
        for first in (range(before, len(gyro) - steps + 1, steps) if moving else (0,))
    ]
    series = np.array([told[i][first - before : first + steps] for i, first in cuts])
    interval = held_for(series)
    return Windows(
        series[:, ::interval],
        np.array([felt[i][first - 1] if moving else np.zeros(3) for i, first in cuts]),
        np.array([felt[i][first : first + steps] for i, first in cuts]),
        interval,
        before,
    )


def held_for(series: Floats) -> int:
    """Return for how many samples each command of series (E, T, 3) is held."""
    changes = np.flatnonzero((np.diff(series, axis=1) != 0.0).any(axis=(0, 2))) + 1
    return gcd(*changes.tolist()) or series.shape[1]


class _Nobody:
    """In the place of a target where all that there is has happened already."""

    def perform(self, command: Floats) -> NoReturn:
        raise TargetError(f"nobody is there to perform {command}: the swims are all that there is")


def estimate_from_swims(
    swims: Sequence[Trace],
    config: EEAConfig | None = None,
    seed: int = 0,
    truth: Morphology | ArrayLike | None = None,
    *,
    moving: bool = False,
    **simulator: Unpack[SimulatorOptions],
) -> MorphologyEstimate:
    """Infer a body from what the robot did by itself, with no trial movement at all.

    Parameters
    ----------
    swims
        What it was told and felt, from rest or in mid-swim.
    config
        Settings, of which ``steps`` is the length of a window; None for the joint condition's
        defaults and windows as long as the shortest swim.
    seed, truth, **simulator
        See ``fish_eea``.
    moving
        Whether it was already under way when each swim's record begins. Its velocity through the
        water is then inferred, and no current, from which it cannot be told apart.

    Raises
    ------
    ConfigurationError
        If the condition is not joint, or as ``windows`` says.

    Examples
    --------
    >>> from aquafish_gym import simulate
    >>> told = np.repeat([[0.5, -0.4, 0.9], [0.3, 0.5, 0.2], [-0.5, 0.1, 1.0]], 50, axis=0)
    >>> felt = simulate(None, told[None], (1.0, 2.0, 3.0), steps=150, dtype="float64").gyro[0]
    >>> found = estimate_from_swims([Trace(told, felt)], truth=Morphology.nominal())
    >>> bool(found.objective_fitness > 0.99)
    True
    """
    cut = windows(swims, moving, None if config is None else config.steps)
    if config is None:
        config = EEAConfig("joint", steps=cut.gyro.shape[1], rounds=1)
    instance("config", config, EEAConfig)
    if config.condition != "joint":
        raise ConfigurationError(
            f"config.condition must be joint for swims; got {config.condition}"
        )
    return estimate_from_windows(cut, config, seed, truth, **simulator)


def estimate_from_windows(
    cut: Windows,
    config: EEAConfig,
    seed: int = 0,
    truth: Morphology | ArrayLike | None = None,
    **simulator: Unpack[SimulatorOptions],
) -> MorphologyEstimate:
    """Infer a body from windows of swims; see ``estimate_from_swims``.

    ``config.steps`` is how many samples each has.
    """
    # scipy's statistics come with it: importing this room stays quick.
    from eea.aquafish.joint import Swims, fish_joint
    from eea.joint.inference import JointInference

    steps = cut.gyro.shape[1] if cut.time is None else steps_for(cut.time)
    engine = EngineSimulator(steps, **simulator)
    joint = fish_joint(fish_problem(), engine, Swims(cut.interval, cut.begun))
    observed = Swims.array(cut.series, cut.spin)
    if cut.time is not None:
        joint, observed = at_times(joint, observed, cut.time)
    body = None if truth is None else Morphology.coerce(truth).to_array()
    inference = JointInference(_Nobody(), joint, config, seed, body)
    last = cut.series[-1, cut.begun // cut.interval :]
    inference.observe(observed, cut.gyro, last.mean(axis=0))
    result = inference.result
    return MorphologyEstimate(**{f.name: getattr(result, f.name) for f in fields(result)})
