"""Recognising in mid-swim what broke: its fins, a current that began, its sensors.

``aquafish.online.search`` finds the likeliest hypothesis about fins and current. What that leaves
unexplained is the fault of a sensor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from aquafish.online import thresholds
from aquafish.online.hypotheses import broken
from aquafish.online.identification import identify
from aquafish.online.search import Alternative, Candidate, Search, leaves_noise
from aquafish.online.self_model import SENSOR_FIELDS, noise_of, predict
from aquafish_gym.damage import Damage, Fault
from aquafish_gym.scenario import CHANNELS, GYRO_CHANNELS, Scenario
from aquafish_gym.utils.array_types import Flags, Floats


@dataclass(frozen=True, eq=False)
class Recognised:
    """What explains the observations best.

    Attributes
    ----------
    damage, before
        What broke of its fins, and the number of the robot that it happened to.
    current
        Velocity (3,) in units/s with which the water began to flow; empty if it did not.
    sensors
        What is broken of its sensors.
    odd
        Channels that observe something else than they should, for no reason known here.
    robot
        What it became, its sensors included: a scenario of one.
    onset, start
        After how many actions it became that robot, and its state (R,) then.
    state
        (R,) of that robot after the last action.
    explained
        Whether this explains most channels; False is "none of my hypotheses".
    decided
        Whether a fault of the fins, if there is one, is much likelier than none, and no channel is
        left unexplained; if nothing broke, whether it fits. Otherwise more observations are needed.
    fits
        Whether the errors that it leaves are as small as chance allows.
    alternatives
        The best damages of different words, the likeliest first.
    identified
        Whether all sizes and servo gains were fitted at once, since no hypothesis fits.
    """

    damage: Damage
    before: int
    current: tuple[float, ...]
    sensors: Damage
    odd: tuple[str, ...]
    robot: Scenario
    onset: int
    start: Floats
    state: Floats
    explained: bool
    decided: bool
    fits: bool
    alternatives: tuple[Alternative, ...] = ()
    identified: bool = False

    @property
    def whole(self) -> bool:
        """Whether nothing of it is broken."""
        return not (self.damage or self.sensors or self.odd)

    @property
    def unchanged(self) -> bool:
        """Whether nothing broke, and no current began."""
        return self.whole and not self.current

    @property
    def about(self) -> str:
        """In words."""
        fins = self.damage.said() if self.damage else ""
        speeds = ", ".join(f"{speed:z.2f}" for speed in self.current)
        water = f"a current of ({speeds}) units/s began" if speeds else ""
        sensors = self.sensors.said() if self.sensors else ""
        odd = f"{' and '.join(self.odd)} cannot be explained" if self.odd else ""
        parts = (fins, water, sensors, odd)
        return " and ".join(filter(None, parts)) or Damage().said()


def recognise(
    before: Sequence[Scenario],
    states: Sequence[Floats],
    observed: Floats,
    actions: Floats,
    drift: Floats,
    tolerance: Floats,
    hold: int = 20,
    identifies: bool = False,
) -> Recognised:
    """Return what explains K observations best.

    Parameters
    ----------
    before
        What the robot may have been until then, scenarios of one; the present belief first, the
        last with its sensors whole.
    states
        (R,) the states before the first action, the second, and so on. Something may have broken
        at any of them.
    observed, actions
        (K, 9) observations, NaN where a channel was not observed, each after its action (K, F).
    drift
        (9,) rms error of the model's own predictions.
    tolerance
        (9,) the rms error from which on a channel is taken to be broken.
    hold
        For how many steps of 0.01 s an action is held.
    identifies
        Whether all sizes and servo gains are fitted at once where no hypothesis fits.
    """
    search = Search(before, states, observed, actions, drift, hold)
    found = _recognised(search, search.best_candidate(), tolerance)
    if identifies and not found.fits:
        other = _recognised(search, identify(search), tolerance)
        found = replace(other if other.fits else found, identified=True)
    return found


def _recognised(search: Search, likeliest: Candidate, tolerance: Floats) -> Recognised:
    """Return a hypothesis about fins and current with the faults of sensors that it leaves."""
    before = search.before
    observed = search.observed
    b, onset = search.cases[likeliest.case]
    damage = likeliest.grid.damage()
    robot = broken(before[b], [likeliest.grid])
    robot = replace(robot, **{name: getattr(before[-1], name) for name in SENSOR_FIELDS})
    start = search.starts(likeliest.case, np.array([likeliest.current or np.zeros(3)]))
    predicted, ended = predict(robot, start, search.actions[onset:], search.hold)
    used = np.isfinite(search.noise) & np.isfinite(observed).any(axis=0)
    errors = np.where(used, observed[onset:] - predicted[0], 0.0)
    silent = search.silent & used
    robot, sensors, odd = with_sensors(robot, errors, silent, search.zero, search.noise, tolerance)
    left = observed[onset:] - predicted[0] - robot.sensor_bias[0]
    noise = np.hypot(noise_of(robot), search.drift)
    fits = not odd and leaves_noise(left, thresholds.FIT_MARGIN * noise)
    something = bool(damage or likeliest.current or sensors or odd)
    return Recognised(
        damage=damage,
        before=b,
        current=likeliest.current,
        sensors=sensors,
        odd=odd,
        robot=robot,
        onset=onset,
        start=start[:, 0],
        state=ended[:, 0],
        explained=len(odd) <= max(1.0, thresholds.MOST_ODD_SHARE * used.sum()),
        decided=search.decided(likeliest) and not odd and (something or fits),
        fits=fits,
        alternatives=search.alternatives(),
    )


def alike(one: Scenario, other: Scenario) -> bool:
    """Return whether two robots need no different gaits: their sizes and gains are alike."""
    sizes = np.abs(one.body - other.body).max()
    gains = np.abs(one.servo_gain - other.servo_gain).max()
    return bool(max(sizes, gains) <= thresholds.SAME_GAIT_DIFFERENCE)


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
    biased |= plain & ~silent & (count >= thresholds.CONFIRMING_OBSERVATIONS)
    faults = list[Fault]()
    # All channels of a noisy gyroscope are, though one by itself may not be over its tolerance.
    heard = (
        ~(silent | biased)[GYRO_CHANNELS]
        & np.isfinite(expected[GYRO_CHANNELS])
        & seen[:, GYRO_CHANNELS].any(axis=0)
    )
    gyro, size = errors[:, GYRO_CHANNELS][:, heard], int(seen[:, GYRO_CHANNELS][:, heard].sum())
    if gyro.shape[1] >= 2 and size >= thresholds.CONFIRMING_OBSERVATIONS * gyro.shape[1]:
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
