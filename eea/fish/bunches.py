"""Bunches in the times of a trial: rows that follow each other closely, and then a wait."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.engines.api import TIMESTEP
from eea.core.angles import Floats

BUNCH_GAP_RATIO = 2.5  # ratio of a step between bunches to its shorter neighbour
LONGEST_BUNCH_WAITS = 2.0  # longest bunch, as a multiple of the wait
PACKET_BUNCH_WAITS = 0.5  # bunches above this multiple of the wait are nearly even
FEWEST_BUNCHES = 4  # least number of bunches in a row
FEWEST_ROWS_PER_BUNCH = 1.5  # rows per bunch, on average


class Bunches(NamedTuple):
    """A stretch of a trial whose times come in bunches. Rows count from the trial's first."""

    starts: NDArray[np.intp]  #: The first row of each bunch.
    last: int  #: The last row of the last bunch.
    #: Whether the stamps of the rows matter little: bunches are nearly as long as the waits, or
    #: the waits are shorter than 0.01 s.
    loose: bool

    @property
    def first(self) -> int:
        """The first row of the first bunch."""
        return int(self.starts[0])


def bunches_of(time: Floats) -> list[Bunches]:
    """Return the stretches of a trial's times (T,), s, that come in bunches.

    Neither a gap nor a change of rate makes bunches. A wait of at most 0.005 s does not count.

    Examples
    --------
    >>> row = np.arange(60)
    >>> packets = 0.01 * (row - row % 3) + 1e-4 * (row % 3)
    >>> [found.starts[:4].tolist() for found in bunches_of(packets)]
    [[0, 3, 6, 9]]
    >>> bunches_of(np.concatenate([0.001 * row, 0.06 + 0.02 * row]))
    []
    """
    steps = np.diff(time)
    near = np.minimum(np.append(np.inf, steps[:-1]), np.append(steps[1:], np.inf))
    waits = np.flatnonzero((steps > BUNCH_GAP_RATIO * near) & (steps > 0.5 * TIMESTEP))
    if len(waits) < FEWEST_BUNCHES - 1:
        return []
    starts = np.append(0, waits + 1)
    ends = np.append(waits, len(time) - 1)
    wait = np.minimum(np.append(np.inf, steps[waits]), np.append(steps[waits], np.inf))
    length = time[ends] - time[starts]
    edges = np.flatnonzero(np.diff(np.concatenate([[0], length < LONGEST_BUNCH_WAITS * wait, [0]])))
    found = []
    for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        rows = ends[end - 1] + 1 - starts[begin]
        if end - begin >= FEWEST_BUNCHES and rows >= FEWEST_ROWS_PER_BUNCH * (end - begin):
            long = np.median(length[begin:end] / wait[begin:end]) > PACKET_BUNCH_WAITS
            loose = bool(long or np.median(wait[begin:end]) < TIMESTEP)
            found.append(Bunches(starts[begin:end], int(ends[end - 1]), loose))
    return found
