"""Episodes that are scored: the same ones for every player, whole and under each tier."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish.scores.entries import Player
from aquafish_gym import IDS
from aquafish_gym.damage.tiers import TIERS
from aquafish_gym.envs.tasks import TASKS
from aquafish_gym.envs.vector import AquaFishVectorEnv

Floats = NDArray[np.float64]
EPISODES = 100
FIRST_SEED = 10**9  # of the episodes that are scored; training begins from 0
WHOLE = "whole"
COLUMNS = (WHOLE, *TIERS)


def damage_of(name: str, column: str) -> str:
    """Return what breaks in an id's episodes: when the id says, in a tier."""
    usual = IDS[name].get("damage", "")
    when = usual.partition("@")[2]
    return "none" if column == WHOLE else f"random:{column}" + (f"@{when}" if when else "")


def play(
    name: str, player: Callable[[Floats], Player], episodes: int = EPISODES
) -> dict[str, dict[str, list[float]]]:
    """Return what a player comes to in an id's episodes, whole and under each tier.

    Parameters
    ----------
    name
        The id.
    player
        Makes what acts for robots whose fins stand at angles (E, 3), rad, when they begin.
    episodes
        How many, always the first ones of the same row.

    Returns
    -------
    dict
        Of each of ``COLUMNS`` the ``returns`` (E,): sums of rewards, as any trainer counts them.
        Where something breaks in mid-swim also ``after``, how far along +y the robot swam from then
        on, and ``twin``, how far it swims in that time if nothing breaks; of each episode in which
        anything broke. A robot that diverged counts up to there.
    """
    returns, whole, _ = _episodes(name, "none", player, episodes)
    found = {WHOLE: {"returns": returns.tolist()}}
    for tier in TIERS:
        damage = damage_of(name, tier)
        returns, y, broken = _episodes(name, damage, player, episodes)
        found[tier] = {"returns": returns.tolist()}
        if "@" in damage:
            struck = np.flatnonzero(broken.any(axis=0))
            onset = broken[:, struck].argmax(axis=0)
            for key, place in (("after", y), ("twin", whole)):
                found[tier][key] = (place[-1, struck] - place[onset, struck]).tolist()
    return found


def _episodes(
    name: str, damage: str, player: Callable[[Floats], Player], episodes: int
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Return returns (E,), and where robots were before and whether broken in each step, (T, E)."""
    kwargs: dict[str, Any] = {**IDS[name], "damage": damage}
    envs = AquaFishVectorEnv(episodes, threads=1, **kwargs)
    seen, info = envs.reset(seed=FIRST_SEED)
    acting = player(info["fin_angles"])
    steps = round(TASKS[IDS[name].get("task", "forward")].seconds / envs.dt)
    returns, over = np.zeros(episodes), np.zeros(episodes, np.bool_)
    y, broken = [np.zeros(episodes)], []
    for step in range(steps):
        seen, rewards, terminated, *_, info = envs.step(
            acting.act(seen, np.full(episodes, step * envs.dt))
        )
        returns += np.where(over, 0.0, rewards)
        y.append(np.where(over, y[-1], info["y_position"]))
        broken.append(info["faults"] > 0)
        over |= terminated
    return returns, np.array(y), np.array(broken)
