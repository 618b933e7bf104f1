"""Which sensors are broken, from the errors that the best hypothesis about the fins leaves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aquafish.online import thresholds
from aquafish_gym.damage import Damage, Fault
from aquafish_gym.scenario import CHANNELS, GYRO_CHANNELS, Scenario
from aquafish_gym.utils.array_types import Flags, Floats

SENSOR_FIELDS = ("gyro_noise", "sensor_bias", "sensor_stuck", "sensor_dropped")


def repeated_channels(observed: Floats) -> tuple[Flags, Flags]:
    """Return which channels (9,) of observations (K, 9) are silent, and which read 0 at last.

    No whole channel repeats itself.
    """
    silent, zero = np.zeros((2, observed.shape[1]), np.bool_)
    for i, column in enumerate(observed.T):
        last = column[np.isfinite(column)][-thresholds.FEWEST_OBSERVATIONS :]
        if len(last):
            zero[i] = last[-1] == 0.0
            silent[i] = (
                (last == last[-1]).all() if len(last) == thresholds.FEWEST_OBSERVATIONS else zero[i]
            )
    return silent, zero


def with_sensors(
    robot: Scenario, errors: Floats, silent: Flags, zero: Flags, expected: Floats, tolerance: Floats
) -> tuple[Scenario, Damage, tuple[str, ...]]:
    """Return a robot with the sensors that errors (K, 9) show, what broke, and the odd channels.

    Errors of what was not observed are NaN. ``expected`` (9,) is the rms error of whole channels.
    An odd channel observes something else than its robot should, for no reason known here. It is
    not used, as if it were stuck.
    """
    seen, noise = np.isfinite(errors), robot.gyro_noise
    errors, count = np.where(seen, errors, 0.0), np.maximum(seen.sum(axis=0), 1)
    mean = errors.sum(axis=0) / count
    deviation = np.sqrt((np.square(errors - mean) * seen).sum(axis=0) / count)
    off = ~silent & (np.sqrt(np.square(errors).sum(axis=0) / count) > tolerance)
    steady = deviation < thresholds.BIAS_DEVIATION * np.abs(mean)
    biased = off & steady & (count >= thresholds.FEWEST_OBSERVATIONS)
    odd = off & ~biased
    # Below the tolerance, many observations show a bias that the filter would fight with for ever.
    around = np.where(np.isfinite(expected), expected, 1.0) ** 2 + deviation**2
    gain = 0.5 * count * np.log1p(mean**2 / around)
    plain = (
        steady
        & (gain > thresholds.BIAS_COST + 0.5 * np.log(count))
        & (mean**2 > thresholds.BIAS_RATIO**2 * around)
    )
    biased |= plain & ~silent & (count >= thresholds.FEWEST_BIAS_OBSERVATIONS)
    faults = list[Fault]()
    # All channels of a noisy gyroscope are, though one by itself may not be over its tolerance.
    heard = (
        ~(silent | biased)[GYRO_CHANNELS]
        & np.isfinite(expected[GYRO_CHANNELS])
        & seen[:, GYRO_CHANNELS].any(axis=0)
    )
    gyro, size = errors[:, GYRO_CHANNELS][:, heard], int(seen[:, GYRO_CHANNELS][:, heard].sum())
    if gyro.shape[1] >= 2 and size >= thresholds.FEWEST_NOISE_OBSERVATIONS * gyro.shape[1]:
        power = np.square(gyro).sum()
        usual = np.hypot(expected, thresholds.TOLERATED_NOISE * tolerance)[GYRO_CHANNELS][heard]
        louder = power > np.square(usual).mean() * (size + thresholds.NOISE_EXCESS * size**0.5)
        if louder and (gyro[1:] * gyro[:-1]).sum() < thresholds.NOISE_CORRELATION * power:  # white
            noise, odd[GYRO_CHANNELS] = np.sqrt(power / size).reshape(1), False
            faults.append(Fault("gyro", "noise", float(noise[0])))
    kinds = {"dropped": silent & zero, "stuck": silent & ~zero, "bias": biased}
    for name, flags in kinds.items():
        for i in np.flatnonzero(flags):
            faults.append(Fault(CHANNELS[i], name, float(mean[i]) if name == "bias" else None))
    sensors = {
        "gyro_noise": noise,
        "sensor_bias": robot.sensor_bias + np.where(biased, mean, 0.0),
        "sensor_dropped": robot.sensor_dropped | kinds["dropped"],
        "sensor_stuck": robot.sensor_stuck | kinds["stuck"] | odd,
    }
    odd_channels = tuple(CHANNELS[i] for i in np.flatnonzero(odd))
    return replace(robot, **sensors), Damage(tuple(faults)), odd_channels
