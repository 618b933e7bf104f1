"""Scenarios whose robots change in mid-swim, as tests say."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.scenario import Scenario
from aquafish_gym.stages import NEVER, Stages

#: A step, the robots (n,) that change then, and what the n are from then on.
Change = tuple[int, NDArray[np.intp], Scenario]


def with_changes(start: Scenario, changes: Sequence[Change]) -> Scenario:
    """Return robots some of which change, in the order of the changes."""
    robots = []
    for i in range(len(start)):
        mine = [(0, start.take(i))]
        mine += [(step, to.take(rows.tolist().index(i))) for step, rows, to in changes if i in rows]
        steps = [step for step, _ in mine]
        columns = {
            name: np.concatenate([one.columns()[name] for _, one in mine])
            for name in start.columns()
        }
        until = np.array([*steps[1:], NEVER])
        stages = Stages(np.zeros(1, np.intp), np.array(steps), until, columns, {})
        robots.append(start.take(i).with_stages(stages))
    return Scenario.concatenate(robots)
