"""Different damage for each robot of a scenario."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from aquafish_gym.damage.damage import Damage
from aquafish_gym.scenario import Change, Scenario


def edit_each(scenario: Scenario, damages: Sequence[Damage], hold: int = 1) -> Scenario:
    """Return a scenario in which robot i has ``damages[i]``; see :meth:`Damage.edit`.

    Robots with the same ``Damage`` object are edited together.
    """
    alike: dict[int, list[int]] = {}
    for i, damage in enumerate(damages):
        alike.setdefault(id(damage), []).append(i)
    if len(alike) == 1:
        return damages[0].edit(scenario, hold)
    edited = scenario.copy()
    changes: dict[int, list[Change]] = {}
    for those in alike.values():
        rows = np.array(those)
        part = damages[those[0]].edit(scenario.take(rows), hold)
        for name, table in edited.arrays().items():
            table[rows] = vars(part)[name]
        for step, changed, to in part.schedule:
            changes.setdefault(step, []).append(Change(step, rows[changed], to))
    schedule = tuple(_joined(step, parts) for step, parts in sorted(changes.items()))
    return replace(edited, schedule=schedule)


def _joined(step: int, parts: list[Change]) -> Change:
    """Return the changes of one step as one, its robots in ascending order."""
    rows = np.concatenate([part.rows for part in parts])
    order = np.argsort(rows)
    return Change(step, rows[order], Scenario.concatenate([part.to for part in parts]).take(order))
