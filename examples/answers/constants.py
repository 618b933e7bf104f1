"""My model's constants, online, with the innovation shown, and an alarm with a cause.

    python examples/answers/constants.py --out out/constants.png

A motor with friction is driven by hand for a minute. Each second of its log updates the constants.
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from eea import Hypothesis, Number, Robot, Trial

PERIOD = 0.01  # s, between samples
WINDOW = 100  # samples
NOISE = {"position": 0.02, "velocity": 0.1}  # m, m/s
CONSTANTS = {"Ks": 0.6, "Kv": 3.0, "Ka": 0.2}  # V, V/(m/s), V/(m/s^2)


@numba.njit
def drive(ks, kv, ka, position, velocity, volts):  # type: ignore[no-untyped-def]
    """Return position and velocity (B, T, 2): volts = ks sign(v) + kv v + ka dv/dt."""
    log = np.empty((*volts.shape, 2))
    for robot in range(len(volts)):
        x = position[robot]
        v = velocity[robot]
        lag = ka[robot] / kv[robot]
        for step in range(volts.shape[1]):
            volt = volts[robot, step]
            before = v
            left = PERIOD
            final = (volt - np.sign(v) * ks[robot]) / kv[robot]
            if v * final < 0.0:  # it stops within the step, or later
                stop = lag * np.log(1.0 - v / final)
                if stop < left:
                    left -= stop
                    v = 0.0
            if v == 0.0:
                final = np.sign(volt) * max(abs(volt) - ks[robot], 0.0) / kv[robot]
            v = final + (v - final) * np.exp(-left / lag)
            x += 0.5 * PERIOD * (before + v)
            log[robot, step] = x, v
    return log


def simulate(values: Any, volts: NDArray[Any]) -> NDArray[Any]:
    """Return position and velocity (B, T, 2) of motors that get volts (B, T)."""
    names = ("Ks", "Kv", "Ka", "position at first", "velocity at first")
    log: NDArray[Any] = drive(*(values[name] for name in names), volts)
    return log


MOTOR = Robot(
    simulate=simulate,
    numbers={
        "Ks": Number(0.0, 3.0, unit="V"),
        "Kv": Number(0.5, 6.0, unit="V s/m"),
        "Ka": Number(0.02, 1.0, unit="V s^2/m"),
        "position at first": Number(-100.0, 100.0, varies=True),
        "velocity at first": Number(-8.0, 8.0, varies=True),
    },
    channels={"position": "m", "velocity": "m/s"},
    hypotheses=[
        Hypothesis("the friction has changed", moves={"Ks": Number(0.0, sd=0.5)}, odds=0.1),
        Hypothesis("the speed per volt has changed", moves={"Kv": Number(0.0, sd=0.5)}, odds=0.1),
        Hypothesis("the load has changed", moves={"Ka": Number(0.0, sd=0.1)}, odds=0.1),
    ],
)
STEADY_SECONDS = 5.0
CHANGES = {
    "the friction has changed": {"Ks": 0.9},
    "the speed per volt has changed": {"Kv": 2.7},
    "the load has changed": {"Ka": 0.26},
}


def record(
    seconds: int,
    rng: np.random.Generator,
    steady: float = 0.0,
    change: dict[str, float] | None = None,
    at: float = 0.0,
) -> list[Trial]:
    """Return a log, a window a second; some constants ``change`` after ``at`` seconds.

    The voltage is that of a test in WPILib, from a random time on, after some steady seconds.
    """
    time = PERIOD * np.arange(seconds * WINDOW)
    later = time + rng.uniform(0.0, 100.0)
    waves = zip((8.0, 6.0, 4.0), (2.0, 3.0, 5.0), strict=True)
    volts = sum(size * np.sin(np.pi * root**0.5 * later) for size, root in waves)
    volts = np.where(time < steady, 6.0, np.clip(volts, -12.0, 12.0))
    cut = round(at * WINDOW)
    state = {"position at first": 0.0, "velocity at first": 1.8}
    parts = []
    for own, constants in ((volts[:cut], CONSTANTS), (volts[cut:], CONSTANTS | (change or {}))):
        if len(own):
            values = {name: np.array([x]) for name, x in (constants | state).items()}
            parts.append(simulate(values, own[None])[0])
            state = dict(zip(state, parts[-1][-1], strict=True))
    log = np.concatenate(parts)
    log += rng.normal(0.0, list(NOISE.values()), log.shape)
    windows = []
    for first in range(0, len(log), WINDOW):
        seen = log[first : first + WINDOW].copy()
        seen[:, 0] -= seen[0, 0]  # a window begins anywhere
        windows.append(Trial(seen, volts[first : first + WINDOW]))
    return windows


def count_false_alarms(logs: int, seconds: int, alarm: float) -> None:
    """Print how often healthy windows raise an alarm, and intervals hold the truth."""
    rng = np.random.default_rng(0)
    alarms = 0
    held = 0
    for _ in range(logs):
        follower = MOTOR.follow(NOISE, alarm)
        alarms += sum(follower.update(window).alarm for window in record(seconds, rng))
        held += sum(
            low <= CONSTANTS[name] <= high for name, (_, low, high) in follower.table().items()
        )
    print(f"{logs * seconds} healthy seconds: {alarms} alarms at a stated rate of {alarm:g}")
    print(f"the truth is in {held} of {logs * len(CONSTANTS)} 90% intervals after {seconds} s")


def count_names(logs: int) -> None:
    """Print how often a change is noticed, and its cause named."""
    rng = np.random.default_rng(0)
    for cause, change in CHANGES.items():
        named: Counter[bool] = Counter()
        delays = []
        for _ in range(logs):
            at = rng.uniform(6.0, 8.0)
            follower = MOTOR.follow(NOISE)
            for second, window in enumerate(record(14, rng, change=change, at=at)):
                followed = follower.update(window)
                if followed.alarm and second >= int(at) and followed.explained:
                    named[followed.findings[0].startswith(cause)] += 1
                    delays.append(second + 1 - at)
                    break
        (name,) = change
        print(
            f"{name} from {CONSTANTS[name]:g} to {change[name]:g}: {cause}, named in {named[True]} "
            f"of {logs}, another cause in {named[False]}, after {np.median(delays):.1f} s"
        )


def main(out: Path | None = None, statistics: bool = True) -> None:
    """Print and draw the constants of a motor whose friction changes.

    ``statistics``: also how often alarms are false, and causes right.
    """
    follower = MOTOR.follow(NOISE)
    rng = np.random.default_rng(0)
    windows = record(60, rng, STEADY_SECONDS, {"Ks": 1.0}, 40.4)
    history = [follower.update(window) for window in windows]
    print(f"{'second':>6}  innovation   " + "   ".join(f"{name:^17}" for name in CONSTANTS))
    for second, followed in enumerate(history):
        if second in (1, 4, 5, 9, 39, 40, 41, 59):
            row = "   ".join(f"{low:.3f} to {high:.3f}" for _, low, high in followed.table.values())
            print(f"{second + 1:>6}  {followed.innovation_rms:>10.2f}   {row}")
    for second, followed in enumerate(history):
        if followed.alarm:
            print(f"alarm after {second + 1} s (p = {followed.p:.1g}): {followed.findings[0]}")
    if statistics:
        count_false_alarms(logs=40, seconds=25, alarm=0.01)
        count_names(logs=20)
    if out is not None:
        draw(out, history)


def draw(out: Path, history: list[Any]) -> None:
    """Draw constants, innovation and alarms, second by second."""
    import matplotlib.pyplot as plt

    figure, rows = plt.subplots(4, 1, figsize=(9.0, 7.0), sharex=True)
    time = np.arange(1, len(history) + 1)
    alarms = [second for second, followed in zip(time, history, strict=True) if followed.alarm]
    for axes, (name, true) in zip(rows, CONSTANTS.items(), strict=False):
        middle, low, high = np.array([followed.table[name] for followed in history]).T
        axes.fill_between(time, low, high, color="tab:blue", alpha=0.3, step="mid", linewidth=0)
        axes.step(time, middle, color="tab:blue", where="mid")
        truth = np.where((time > 40.4) & (name == "Ks"), 1.0, true)
        axes.step(time, truth, color="black", linestyle="--", linewidth=1.0, where="mid")
        axes.set(ylabel=f"{name} ({MOTOR.table[name].unit})", ylim=(0.0, 1.05 * high.max()))
    rows[0].set_title("90% intervals; dashed: true. Grey: steady voltage. Red: alarms.")
    innovation = [followed.innovation_rms for followed in history]
    rows[3].step(time, innovation, color="tab:blue", where="mid")
    rows[3].axhline(1.0, color="black", linestyle="--", linewidth=1.0)
    rows[3].set(xlabel="time (s)", ylabel="innovation\n(times the noise)", ylim=(0.0, 3.0))
    for axes in rows:
        axes.axvspan(0.5, STEADY_SECONDS + 0.5, color="0.93", zorder=0)
        for second in alarms:
            axes.axvline(second, color="tab:red", linewidth=1.0)
        axes.spines[["top", "right"]].set_visible(False)
    figure.align_ylabels()
    figure.tight_layout()
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("out/constants.png"))
    main(parser.parse_args().out)
