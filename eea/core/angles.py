"""Angles, and the smallest range that includes some poses (Sec. 3.3).

A range is a pair ``min_angle <= max_angle`` in rad with ``min_angle`` in [-pi, pi); one that
crosses pi has ``max_angle`` above pi. All hidden angles are circular, also phases of a cycle.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
TURN = 2.0 * np.pi


def wrap(angles: ArrayLike) -> Floats:
    """Return angles wrapped into [-pi, pi)."""
    wrapped = (np.asarray(angles, dtype=np.float64) + np.pi) % TURN - np.pi
    # The remainder of a tiny negative number rounds up to the whole turn.
    return np.where(wrapped >= np.pi, -np.pi, wrapped)


def circular_distance(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return the shorter way between angles, in [0, pi] rad."""
    return np.abs(wrap(np.asarray(a, dtype=np.float64) - np.asarray(b, dtype=np.float64)))


def smallest_inclusive(poses: ArrayLike) -> tuple[Floats, Floats]:
    """Return the shortest arcs, shapes (H,), that include every pose (K, H), angle by angle."""
    ordered = np.sort(wrap(poses), axis=0)
    # The arc is the turn minus the largest gap between neighbours; the last gap crosses pi.
    gaps = np.concatenate([np.diff(ordered, axis=0), ordered[:1] + TURN - ordered[-1:]])
    each = np.arange(ordered.shape[1])
    last = np.argmax(gaps[::-1], axis=0)
    before = len(ordered) - 1 - last
    start = ordered[(before + 1) % len(ordered), each]
    end = ordered[before, each]
    return start, np.where(end < start, end + TURN, end)


def extended(min_angle: Floats, max_angle: Floats, share: float) -> tuple[Floats, Floats]:
    """Return ranges that reach ``share`` of their width beyond each end, at most a turn wide."""
    width = max_angle - min_angle
    wider = np.minimum(width * (1.0 + 2.0 * share), TURN)
    start = wrap(min_angle - 0.5 * (wider - width))
    return start, start + wider
