"""Change detection in a recorded swim: when is it no longer that of the inferred body?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Unpack

import numpy as np

from eea.core.angles import Floats
from eea.fish.simulator import EngineSimulator, SimulatorOptions
from eea.fish.swim_log import SwimLog

if TYPE_CHECKING:
    from collections.abc import Callable

    from eea.joint.change_detection import WindowTest
    from eea.joint.joint_posterior import JointPosterior

WINDOW = 1.0  # s: a change shows in the first window that is all after it


@dataclass(frozen=True, eq=False)
class Watched:
    """The tests of a swim, window by window."""

    time: Floats  #: (E,) when each window ended, s of swimming since the record's beginning.
    looks: tuple[WindowTest, ...]
    alarm: float  #: The probability of a false alarm in each window.

    @property
    def noticed(self) -> float | None:
        """When the change was detected, s; None if it was not."""
        changed = [not look.same for look in self.looks]
        return float(self.time[changed.index(True)]) if any(changed) else None

    def __str__(self) -> str:
        seconds = f"{self.time[-1]:.4g} s of swimming, {len(self.looks)} windows"
        if self.noticed is None:
            return f"{seconds}: this is still the body that was inferred"
        worst = min(look.p for look in self.looks)
        p = f"p = {worst:.0e}" if worst > 0.0 else "p < 1e-300"
        return (
            f"{seconds}: since {self.noticed:.4g} s this is no longer the body that was inferred "
            f"({p}; one false alarm in {1.0 / self.alarm:,.0f} windows)"
        )


def watch_swim(
    log: SwimLog,
    belief: JointPosterior,
    *,
    alarm: float | None = None,
    seed: int = 0,
    until_noticed: bool = False,
    progress: Callable[[int, int], None] | None = None,
    **simulator: Unpack[SimulatorOptions],
) -> Watched:
    """Compare a swim, second by second, with the posterior of a body.

    ``eea.joint.change_detection`` describes the test.

    Parameters
    ----------
    log
        A swim that begins at any moment; all its trials count. The first 0.2 s of each only show
        how the servos moved.
    belief
        A ``result.belief`` of joint inference, or the result of ``load_posterior``.
    alarm
        The probability of a false alarm in each window; None for one in a million.
    seed
        Of the random starting points.
    until_noticed
        Whether to stop at the first window that another body explains.
    progress
        Called after each window with the number of windows done and of all.
    **simulator
        See ``EngineSimulator``.

    Examples
    --------
    >>> log = read_log("swim.csv")  # doctest: +SKIP
    >>> print(watch_swim(log, load_posterior("posterior.npz")))  # doctest: +SKIP
    60 s of swimming, 59 windows: this is still the body that was inferred
    """
    # scipy.stats is imported here to keep `import eea.fish.watch` quick.
    from eea.fish.joint import fish_joint
    from eea.fish.windows import log_windows
    from eea.joint.change_detection import ALARM, ChangeDetector

    windows = log_windows(log, True, WINDOW)
    joint = fish_joint(EngineSimulator(windows.steps, **simulator), windows)
    detector = ChangeDetector(joint, belief, ALARM if alarm is None else alarm, seed)
    looks: list[WindowTest] = []
    for i, gyro in enumerate(windows.gyro):
        looks.append(detector.look(np.array([i]), gyro))
        if progress is not None:
            progress(i + 1, len(windows.gyro))
        if until_noticed and not looks[-1].same:
            break
    return Watched(windows.ends[: len(looks)], tuple(looks), detector.alarm)
