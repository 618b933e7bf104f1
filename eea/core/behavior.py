"""Behaviours of gyroscope logs, and the similarity of two behaviours (Sec. 3.1 and Eq. 2).

A behaviour is a row of complex coefficients: the discrete Fourier transforms of the angular
velocity about each axis, in degrees/s, one after the other. Functions take whole batches.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from eea.core.checks import TargetError, masked

Coefficients = NDArray[Any]  # complex, in single or double precision

MAX = 100.0  # MAX of Eq. 2
DEGREES = 180.0 / np.pi


class Log(Protocol):
    """A log of a robot's IMU."""

    @property
    def gyro(self) -> NDArray[Any] | None:
        """Angular velocity about the body's axes, rad/s: (B, T, axes) of B trials, or (T, axes)."""


def summarize(
    log: Log, steps: int | None = None, axes: int | None = None, source: str = "a robot"
) -> Coefficients:
    """Return the behaviours (B, axes * (T // 2 + 1)) of a log; see :func:`gyro_samples`."""
    samples = gyro_samples(log, steps, axes, source) * DEGREES
    axes_first = np.ascontiguousarray(samples.transpose(0, 2, 1))
    coefficients: Coefficients = np.fft.rfft(axes_first, axis=-1).reshape(len(samples), -1)
    return coefficients


def gyro_samples(
    log: Log, steps: int | None = None, axes: int | None = None, source: str = "a robot"
) -> NDArray[Any]:
    """Return the gyroscope's samples (B, T, axes) of a log.

    Parameters
    ----------
    steps, axes
        Required length T and number of axes; None accepts any.
    source
        Source of the log, for error messages.

    Raises
    ------
    TargetError
        If the log has no ``gyro``, or ``gyro`` does not have the required shape with T >= 2.
    """
    last = "axes" if axes is None else str(axes)
    wanted = f"samples of shape (B, T, {last}) or (T, {last})"
    try:
        gyro = log.gyro
    except AttributeError as error:
        got = "None" if log is None else f"a {type(log).__name__}"
        raise TargetError(f"{source} must return a log with gyro; it returned {got}") from error
    if gyro is None:
        raise TargetError(f"a log must hold gyro; that of {source} holds none")
    try:
        hidden = masked(gyro)
        samples: NDArray[Any] = np.zeros(0) if hidden else np.asarray(gyro)
    except ValueError:
        raise TargetError(f"a log must hold {wanted}; gyro of {source} is ragged") from None
    except RuntimeError as error:  # a tensor of torch that requires a gradient
        raise TargetError(f"a log must hold {wanted}; of gyro of {source}: {error}") from None
    if hidden:
        raise TargetError(f"a log must hold all its samples; gyro of {source} has masked ones")
    if samples.dtype.kind not in "fiu":
        raise TargetError(f"a log must hold real numbers; gyro of {source} is {samples.dtype}")
    if samples.ndim == 2:
        samples = samples[None]
    fits = samples.ndim == 3 and samples.shape[1] >= 2 and samples.shape[2] >= 1
    if not fits or axes not in (None, samples.shape[2]):
        raise TargetError(
            f"a log must hold {wanted} with at least 2 steps; got {samples.shape} from {source}"
        )
    if steps is not None and samples.shape[1] != steps:
        # Transforms of T and T + 1 samples are equally long, so the comparison would not fail.
        raise TargetError(
            f"{source} must log trials of {steps} steps, as config.steps says; "
            f"it logged {samples.shape[1]}"
        )
    return samples


def similarity(a: Coefficients, b: Coefficients) -> NDArray[np.float64]:
    """Return sim (Eq. 2) of behaviours (..., F), shape (...): at most 1, unbounded below."""
    return likeness(np.asarray(modulus(a - b).mean(axis=-1, dtype=np.float64)))


def likeness(difference: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return sim (Eq. 2) for the mean difference of two behaviours' coefficients."""
    return 1.0 - difference / MAX  # Eq. 2


def modulus(coefficients: Coefficients) -> Coefficients:
    """Return |c|, real; several times faster than ``abs`` on single-precision complex numbers."""
    squares: Coefficients = np.square(coefficients.real)
    squares += np.square(coefficients.imag)
    return np.sqrt(squares, out=squares)
