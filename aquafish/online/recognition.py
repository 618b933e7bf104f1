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
from aquafish.online.search import Alternative, Search, leaves_noise, mismatch
from aquafish.online.self_model import noise_of, predict
from aquafish.online.sensor_faults import SENSOR_FIELDS, with_sensors
from aquafish_gym.damage import Damage
from aquafish_gym.physics.layout import start_rows
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.array_types import Floats


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
        After how many actions it became that robot, and its state (25,) then.
    state
        (25,) of that robot after the last action.
    explained
        Whether this explains most channels; False is "none of my hypotheses".
    decided
        Whether a fault of the fins, if there is one, is much likelier than none, and no channel is
        left unexplained; if nothing broke, whether it fits. Otherwise more observations are needed.
    fits
        Whether the errors that it leaves are as small as chance allows.
    alternatives
        The best damages of different words, the likeliest first.
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
) -> Recognised:
    """Return what explains K observations best.

    Parameters
    ----------
    before
        What the robot may have been until then, scenarios of one; the present belief first, the
        last with its sensors whole.
    states
        (25,) the states before the first action, the second, and so on. Something may have broken
        at any of them.
    observed, actions
        (K, 9) observations, NaN where a channel was not observed, each after its action (K, 3).
    drift
        (9,) rms error of the model's own predictions.
    tolerance
        (9,) the rms error from which on a channel is taken to be broken.
    hold
        For how many steps of 0.01 s an action is held.
    """
    search = Search(before, states, observed, actions, drift, hold)
    likeliest = search.best_candidate()
    b, onset = search.cases[likeliest.case]
    damage = likeliest.grid.damage()
    robot = broken(before[b], [likeliest.grid])
    robot = replace(robot, **{name: getattr(before[-1], name) for name in SENSOR_FIELDS})
    start = search.starts(likeliest.case, np.array([likeliest.current or np.zeros(3)]))
    predicted, ended = predict(robot, start, actions[onset:], hold)
    used = np.isfinite(search.noise) & np.isfinite(observed).any(axis=0)
    errors = np.where(used, observed[onset:] - predicted[0], 0.0)
    silent = search.silent & used
    robot, sensors, odd = with_sensors(robot, errors, silent, search.zero, search.noise, tolerance)
    left = observed[onset:] - predicted[0] - robot.sensor_bias[0]
    fits = not odd and leaves_noise(left, thresholds.FIT_MARGIN * np.hypot(noise_of(robot), drift))
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
        explained=len(odd) <= max(1, int(used.sum()) // 3),
        decided=search.decided(likeliest) and not odd and (something or fits),
        fits=fits,
        alternatives=search.alternatives(),
    )


def find_fins(
    waters: Sequence[Scenario], observed: Floats, actions: Floats, hold: int = 20
) -> Floats:
    """Return the fin angles (3,), rad, at which a robot began at rest.

    ``waters`` are scenarios of one robot, in the waters that it may be in. It observed (K, 9) after
    each of its actions (K, 3).
    """
    turn = 2 * np.pi * np.arange(thresholds.POSES_PER_FIN) / thresholds.POSES_PER_FIN
    spacing = turn[1]
    grid = np.stack(np.meshgrid(turn, turn, turn), -1)
    stencil = np.arange(-1, 2)
    around = np.stack(np.meshgrid(stencil, stencil, stencil), -1).reshape(-1, 3)
    poses: Floats = grid.reshape(-1, 3)
    for _ in range(thresholds.NARROWING_ROUNDS):
        costs = np.min(
            [
                mismatch(
                    predict(
                        robot.take(np.zeros(len(poses), np.intp)), start_rows(poses), actions, hold
                    )[0],
                    observed,
                    noise_of(robot),
                )
                for robot in waters
            ],
            axis=0,
        )
        best = poses[np.argsort(costs, kind="stable")[: thresholds.NARROWED_HYPOTHESES]]
        spacing /= 2
        poses = (best[:, None] + spacing * around).reshape(-1, 3)
    found: Floats = best[0]
    return found


def alike(one: Scenario, other: Scenario) -> bool:
    """Return whether two robots need no different gaits: their sizes and gains are alike."""
    sizes = np.abs(one.body - other.body).max()
    gains = np.abs(one.servo_gain - other.servo_gain).max()
    return bool(max(sizes, gains) <= thresholds.SAME_GAIT_DIFFERENCE)
