"""A swim watched: when was the fish no longer the one that it believes to be?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Unpack

from eea.core.angles import Floats
from eea.fish.estimate import fish_problem
from eea.fish.sampling import at_times, steps_for
from eea.fish.simulator import EngineSimulator, SimulatorOptions
from eea.fish.swim_log import SwimLog

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.figure import Figure

    from eea.joint.change_detection import WindowTest
    from eea.joint.joint_posterior import JointPosterior

WINDOW = 1.0  # s: what changed is seen in the first window that is all after it


@dataclass(frozen=True, eq=False)
class Watched:
    """What a swim looked like, window by window."""

    time: Floats  #: (E,) when each window ended, s since the record's beginning.
    looks: tuple[WindowTest, ...]
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

    def plot(self) -> Figure:
        """Return a matplotlib figure of what each window leaves unexplained."""
        from eea.fish.watched_figure import watched_figure

        return watched_figure(self)


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
    """Hold a swim, second by second, against what is believed of the body.

    How that is done, see ``eea.joint.change_detection``.

    Parameters
    ----------
    log
        The swim from any moment on; of several trials all count. The first 0.2 s are only looked
        at for how the servos moved.
    belief
        A ``result.belief`` of joint inference, or what ``load_posterior`` reads.
    alarm
        The chance of a false alarm in each window; None for one in a million.
    seed
        Of the starting points that are tried.
    until_noticed
        Whether to stop at the first window that is not the body's.
    progress
        Called after each window, with how many are done, and of how many.
    **simulator
        See ``EngineSimulator``.

    Raises
    ------
    ConfigurationError, InvalidArgumentError
        If an argument is out of range, or the swim is shorter than a window.

    Examples
    --------
    >>> log = read_log("swim.csv")  # doctest: +SKIP
    >>> print(watch_swim(log, load_posterior("posterior.npz")))  # doctest: +SKIP
    60 s of swimming, 59 windows: this is still the body that was inferred
    """
    # scipy's statistics come with it: importing this room stays quick.
    from eea.fish.joint import Swims, fish_joint
    from eea.fish.log_inference import log_windows
    from eea.joint.change_detection import ALARM, ChangeDetector

    cut, _, ends, _ = log_windows(log, True, WINDOW)
    steps = cut.gyro.shape[1] if cut.time is None else steps_for(cut.time)
    joint = fish_joint(
        fish_problem(), EngineSimulator(steps, **simulator), Swims(cut.interval, cut.begun)
    )
    observed = Swims.array(cut.series, cut.spin)
    if cut.time is not None:
        joint, observed = at_times(joint, observed, cut.time)
    watch, looks = ChangeDetector(joint, belief, ALARM if alarm is None else alarm, seed), []
    for i, gyro in enumerate(cut.gyro):
        looks.append(watch.look(observed[i : i + 1], gyro))
        if progress is not None:
            progress(i + 1, len(cut.gyro))
        if until_noticed and not looks[-1].same:
            break
    return Watched(ends[: len(looks)], tuple(looks), watch.alarm)
