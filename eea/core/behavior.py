"""Behaviour summaries of IMU logs, and how alike two of them are (Sec. 3.1 and Eq. 2).

A behaviour is a row of coefficients, complex for the Fourier transform unless only their
magnitudes are kept, else real. Everything here works on whole batches.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from eea.core.checks import TargetError, choice, flag, real

Coefficients = NDArray[Any]  # complex or real floats, single or double precision

Signal = Literal["attitude", "body_rates"]


class Log(Protocol):
    """What a robot's IMU recorded: (B, T, axes) for B trials, or (T, axes) for one.

    Only the signal that the behaviour is of is looked at, by default the gyroscope.
    """

    @property
    def rpy(self) -> NDArray[Any] | None:
        """Roll, pitch and yaw in rad, unwrapped, after each step; ``None`` if not logged."""

    @property
    def gyro(self) -> NDArray[Any] | None:
        """Angular velocity about the body's axes in rad/s; ``None`` if not logged."""


@dataclass(frozen=True)
class BehaviorConfig:
    """What counts as a behaviour, and how two are compared."""

    #: What a trial is reduced to. The paper's choice is "dft", the discrete Fourier transform. It
    #: tried before "mean_rate" and "rms_rate", the mean and the root mean square of the angular
    #: velocity in each axis.
    summary: Literal["dft", "mean_rate", "rms_rate"] = "dft"
    #: What is summarised: "body_rates" is the gyroscope, "attitude" is roll, pitch and yaw. The
    #: rates are the gyroscope's own, or those of the attitude.
    signal: Signal = "body_rates"
    #: Of the angles, or of the rates a second. At MAX = 100 a median 1 - sim between random robots
    #: is, by the gyroscope, about 0.4 in degrees and below 0.01 in radians.
    unit: Literal["degrees", "radians"] = "degrees"
    #: Divide the transform by the number of samples. Without a clamp this changes no ranking of
    #: models, only the scale of MOD_FIT.
    normalised: bool = False
    #: Of two coefficients: "complex" is the modulus of their difference, "magnitude" the difference
    #: of their moduli, which drops the phase.
    difference: Literal["complex", "magnitude"] = "complex"
    clamp: bool = False  #: Count no coefficient's difference as more than maximum.
    maximum: float = 100.0  #: MAX of Eq. 2.
    timestep: float = 0.01  #: Seconds between samples, for the attitude's rates.

    def __post_init__(self) -> None:
        choice("behavior.summary", self.summary, ("dft", "mean_rate", "rms_rate"))
        choice("behavior.signal", self.signal, ("attitude", "body_rates"))
        choice("behavior.unit", self.unit, ("degrees", "radians"))
        flag("behavior.normalised", self.normalised)
        choice("behavior.difference", self.difference, ("complex", "magnitude"))
        flag("behavior.clamp", self.clamp)
        real("behavior.maximum", self.maximum, 1e-9)
        real("behavior.timestep", self.timestep, 1e-9)


def summarize(
    log: Log,
    config: BehaviorConfig,
    steps: int | None = None,
    axes: int | None = None,
    source: str = "a robot",
) -> Coefficients:
    """Return the behaviours of a log's trials, shape (B, coefficients).

    The transform keeps T // 2 + 1 frequencies of each axis; a rate is one number an axis. The
    trials must be of so many ``steps`` and ``axes``, any where None; ``source`` says whose they
    are where they are not.

    Raises
    ------
    TargetError
        If the log lacks the signal, or it is not of shape (B, T, axes) or (T, axes) with T
        of at least 2, or of another length than ``steps``.
    """
    samples = signal_samples(log, config, axes, source, steps)
    if config.unit == "degrees":
        samples = samples * (180.0 / np.pi)
    axes_first = np.ascontiguousarray(samples.transpose(0, 2, 1))
    coefficients: Coefficients
    if config.summary == "dft":
        coefficients = np.fft.rfft(axes_first, axis=-1).reshape(len(samples), -1)
        if config.normalised:
            coefficients = coefficients / samples.shape[1]
    else:
        rates = axes_first
        if config.signal == "attitude":
            rates = np.diff(axes_first, axis=-1) / config.timestep
        if config.summary == "mean_rate":
            coefficients = rates.mean(axis=-1)
        else:
            coefficients = np.sqrt(np.square(rates).mean(axis=-1))
    return modulus(coefficients) if config.difference == "magnitude" else coefficients


def signal_samples(
    log: Log,
    config: BehaviorConfig,
    axes: int | None = None,
    source: str = "a robot",
    steps: int | None = None,
) -> NDArray[Any]:
    """Return what the log holds of the signal, shape (B, T, axes); see ``summarize``."""
    last = "axes" if axes is None else str(axes)
    wanted = f"samples of shape (B, T, {last}) or (T, {last})"
    name = "rpy" if config.signal == "attitude" else "gyro"
    try:
        signal = getattr(log, name)
    except AttributeError as error:
        got = "None" if log is None else f"a {type(log).__name__}"
        raise TargetError(f"{source} must return a log with {name}; it returned {got}") from error
    if signal is None:
        raise TargetError(
            f"a log must hold {name} for behavior.signal = {config.signal}; "
            f"that of {source} holds none"
        )
    try:
        samples = np.asarray(signal)
    except ValueError:
        raise TargetError(f"a log must hold {wanted}; {name} of {source} is ragged") from None
    if samples.dtype.kind not in "fiu":
        raise TargetError(f"a log must hold real numbers; {name} of {source} is {samples.dtype}")
    if samples.ndim == 2:
        samples = samples[None]
    fits = samples.ndim == 3 and samples.shape[1] >= 2 and samples.shape[2] >= 1
    if not fits or axes not in (None, samples.shape[2]):
        raise TargetError(
            f"a log must hold {wanted} with at least 2 steps; got {samples.shape} from {source}"
        )
    if steps is not None and samples.shape[1] != steps:
        # Transforms of T and T + 1 samples are equally long, and a rate does not tell T at all:
        # the comparison would not notice.
        raise TargetError(
            f"{source} must log trials of {steps} steps, as config.steps says; "
            f"it logged {samples.shape[1]}"
        )
    return samples


def modulus(coefficients: Coefficients) -> Coefficients:
    """Return |c|, real; several times as fast as ``abs`` on single-precision complex numbers."""
    if not np.iscomplexobj(coefficients):
        return np.abs(coefficients)
    squares: Coefficients = np.square(coefficients.real)
    squares += np.square(coefficients.imag)
    return np.sqrt(squares, out=squares)


def similarity(a: Coefficients, b: Coefficients, config: BehaviorConfig) -> NDArray[np.float64]:
    """Return how alike behaviours (..., coefficients) are, sim of Eq. 2, shape (...).

    At most 1; below 0 where they differ by more than MAX.
    """
    apart = modulus(a - b)
    if config.clamp:
        apart = np.minimum(apart, config.maximum)
    return likeness(np.asarray(apart.mean(axis=-1, dtype=np.float64)), config)


def likeness(apart: NDArray[np.float64], config: BehaviorConfig) -> NDArray[np.float64]:
    """Return sim (Eq. 2) for the mean difference of two behaviours' coefficients."""
    return 1.0 - apart / config.maximum  # Eq. 2
