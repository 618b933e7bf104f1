"""A swim watched: when was the fish no longer the one that it believes to be?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Unpack

import numpy as np

from aquafish_gym.engines.base import TIMESTEP
from eea.aquafish.estimate import fish_problem
from eea.aquafish.simulator import EngineSimulator, SimulatorOptions
from eea.aquafish.swims import Trace, windows
from eea.core.angles import Floats

if TYPE_CHECKING:
    from collections.abc import Callable

    from eea.joint.belief import JointBelief
    from eea.joint.watch import Look

WINDOW = 100  # samples: what changed is seen in the first window that is all after it


@dataclass(frozen=True, eq=False)
class Watched:
    """What a swim looked like, window by window."""

    time: Floats  #: (E,) when each window ended, s since the record's beginning.
    looks: tuple[Look, ...]
    alarm: float  #: The chance of a false alarm in each window.

    @property
    def noticed(self) -> float | None:
        """When it was noticed that the body is no longer the same, s; None if it was not."""
        changed = [not look.same for look in self.looks]
        return float(self.time[changed.index(True)]) if any(changed) else None

    def __str__(self) -> str:
        seconds = f"{self.time[-1]:g} s of swimming, {len(self.looks)} windows"
        if self.noticed is None:
            return f"{seconds}: this is still the body that was inferred"
        worst = min(look.p for look in self.looks)
        said = f"p = {worst:.0e}" if worst > 0.0 else "p < 1e-300"
        return (
            f"{seconds}: since {self.noticed:g} s this is no longer the body that was inferred "
            f"({said}; false alarms once in {1.0 / self.alarm:,.0f} windows)"
        )


def watch_swim(
    swim: Trace,
    belief: JointBelief,
    *,
    alarm: float | None = None,
    window: int = WINDOW,
    seed: int = 0,
    until_noticed: bool = False,
    progress: Callable[[Look], None] | None = None,
    **simulator: Unpack[SimulatorOptions],
) -> Watched:
    """Hold a swim against what is believed of the body; see ``eea.joint.watch``.

    Parameters
    ----------
    swim
        A record of it from any moment on, 100 samples a second. Its first 0.2 s are only looked at
        for how the servos moved.
    belief
        A ``result.belief`` of joint inference, or what ``load_posterior`` reads.
    alarm
        The chance of a false alarm in each window; None for one in a million.
    window
        Samples in a window.
    seed
        Of the starting points that are tried.
    until_noticed
        Whether to stop at the first window that is not the body's.
    progress
        Called after each window.
    **simulator
        See ``EngineSimulator``.

    Raises
    ------
    ConfigurationError, InvalidArgumentError
        If an argument is out of range, or the swim is shorter than a window.
    """
    # scipy's statistics come with it: importing this room stays quick.
    from eea.aquafish.joint import Swims, fish_joint
    from eea.joint.watch import ALARM, Watch

    cut = windows([swim], True, window)
    problem = fish_joint(
        fish_problem(), EngineSimulator(window, **simulator), Swims(cut.interval, cut.begun)
    )
    watch = Watch(problem, belief, ALARM if alarm is None else alarm, seed)
    rows, looks = Swims.array(cut.series, cut.spin), []
    for row, gyro in zip(rows, cut.gyro, strict=True):
        look = watch.look(row[None], gyro)
        looks.append(look)
        if progress is not None:
            progress(look)
        if until_noticed and not look.same:
            break
    ends = cut.begun + window * np.arange(1, len(looks) + 1)
    time = np.asarray(TIMESTEP * ends, dtype=np.float64)
    return Watched(time, tuple(looks), watch.alarm)
