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
    name: str,
    player: Callable[[Floats], Player],
    episodes: int = EPISODES,
    observe_fins: bool | str = False,
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
    observe_fins
        As of the environment: what the player is shown.

    Returns
    -------
    dict
        Of each of ``COLUMNS`` the ``returns`` (E,): sums of rewards, as any trainer counts them.
        Where something breaks in mid-swim also ``after`` (E,), how far along +y the robot swam from
        then on, and ``twin`` (E,), how far it swims in that time if nothing breaks. A robot that
        diverged counts up to there.
    """
    returns, whole, _ = _episodes(name, "none", player, episodes, observe_fins)
    found = {WHOLE: {"returns": returns.tolist()}}
    for tier in TIERS:
        damage = damage_of(name, tier)
        returns, y, broken = _episodes(name, damage, player, episodes, observe_fins)
        found[tier] = {"returns": returns.tolist()}
        if "@" in damage:
            onset = broken.argmax(axis=0), np.arange(episodes)
            for key, place in (("after", y), ("twin", whole)):
                found[tier][key] = (place[-1] - place[onset]).tolist()
    return found


def play_one(
    name: str,
    tier: str,
    before: Callable[[Floats], Player],
    after: Callable[[Floats], Player],
    episode: int,
) -> float:
    """Return how far along +y a robot swims in one episode from when something breaks on.

    ``before`` makes what acts until then, and ``after`` what acts from then on.
    """
    kwargs: dict[str, Any] = {**IDS[name], "damage": damage_of(name, tier)}
    envs = AquaFishVectorEnv(1, threads=1, **kwargs)
    seen, info = envs.reset(seed=FIRST_SEED + episode)
    acting, begun, struck, onset = before(info["fin_angles"]), 0, False, 0.0
    y = 0.0
    for step in range(_steps(name, envs)):
        actions = acting.act(seen, np.full(1, (step - begun) * envs.dt))
        seen, _, terminated, _, info = envs.step(actions)
        if not struck and info["faults"][0]:
            struck, onset, begun, acting = True, y, step + 1, after(info["fin_angles"])
        if terminated[0]:
            break
        y = float(info["y_position"][0])
    return y - onset


def what_is_left(name: str, tier: str, episode: int) -> dict[str, NDArray[np.float64]]:
    """Return the truth about a robot once something is broken, as ``info`` has it."""
    kwargs: dict[str, Any] = {**IDS[name], "damage": damage_of(name, tier)}
    envs = AquaFishVectorEnv(1, threads=1, **kwargs)
    _, info = envs.reset(seed=FIRST_SEED + episode)
    while not info["faults"][0]:
        *_, info = envs.step(np.zeros((1, 3), np.float32))
    kept = ("morphology", "servo_gain", "sensor_noise", "sensor_bias", "sensor_lost")
    return {key: info[key][0] for key in kept}


def _steps(name: str, envs: AquaFishVectorEnv) -> int:
    return round(TASKS[IDS[name].get("task", "forward")].seconds / envs.dt)


def _episodes(
    name: str,
    damage: str,
    player: Callable[[Floats], Player],
    episodes: int,
    observe_fins: bool | str,
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Return returns (E,), and where robots were before and whether broken in each step, (T, E)."""
    kwargs: dict[str, Any] = {**IDS[name], "damage": damage, "observe_fins": observe_fins}
    envs = AquaFishVectorEnv(episodes, threads=1, **kwargs)
    seen, info = envs.reset(seed=FIRST_SEED)
    acting = player(info["fin_angles"])
    returns, over = np.zeros(episodes), np.zeros(episodes, np.bool_)
    y, broken = [np.zeros(episodes)], []
    for step in range(_steps(name, envs)):
        seen, rewards, terminated, *_, info = envs.step(
            acting.act(seen, np.full(episodes, step * envs.dt))
        )
        returns += np.where(over, 0.0, rewards)
        y.append(np.where(over, y[-1], info["y_position"]))
        broken.append(info["faults"] > 0)
        over |= terminated
    return returns, np.array(y), np.array(broken)
