"""The episodes of the reference scores, the same for every agent: whole, and under each tier."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym import IDS
from aquafish_gym.damage.tiers import TIERS
from aquafish_gym.envs.tasks import TASKS
from aquafish_gym.envs.vector import AquaFishVectorEnv
from gait import Controller, evaluate
from gait.agent import ControllerAgent
from gait.evaluation import EPISODES, FIRST_SEED, AgentLike

WHOLE = "whole"
COLUMNS = (WHOLE, *TIERS)


def damage_of(name: str, column: str) -> str:
    """Return the damage of an id's episodes in a column; its onset is the id's own."""
    usual = IDS[name].get("damage", "")
    onset = usual.partition("@")[2]
    return "none" if column == WHOLE else f"random:{column}" + (f"@{onset}" if onset else "")


def play(name: str, agent: AgentLike, episodes: int = EPISODES) -> dict[str, Any]:
    """Return an agent's results in an id's episodes, by column.

    Returns
    -------
    dict
        For each of ``COLUMNS`` the ``returns`` (E,). Where damage strikes in mid-swim also
        ``after`` (E,), the distance along +y from the onset on, and ``twin`` (E,), the same
        distance in the episode without damage. A robot that diverged counts up to there.
    """
    whole = evaluate(agent, name, episodes=episodes, damage="none", threads=1)
    found = {WHOLE: {"returns": whole.returns.tolist()}}
    for tier in TIERS:
        damage = damage_of(name, tier)
        broken = evaluate(agent, name, episodes=episodes, damage=damage, threads=1)
        found[tier] = {"returns": broken.returns.tolist()}
        if "@" in damage:
            found[tier]["after"] = broken.way_since(broken.onset).tolist()
            found[tier]["twin"] = whole.way_since(broken.onset).tolist()
    return found


def play_one(name: str, tier: str, before: Controller, after: Controller, episode: int) -> float:
    """Return the distance along +y after the onset in one episode, with ``after`` from then on."""
    envs = _one_robot(name, tier)
    seen, info = envs.reset(seed=FIRST_SEED + episode)
    acting, struck, onset, y = ControllerAgent(before), False, 0.0, 0.0
    acting.reset(info)
    for _ in range(round(TASKS[IDS[name].get("task", "forward")].seconds / envs.dt)):
        seen, _, terminated, _, info = envs.step(acting.act(seen))
        if not struck and info["faults"][0]:
            struck, onset, acting = True, y, ControllerAgent(after)
            acting.reset(info)
        if terminated[0]:
            break
        y = float(info["y_position"][0])
    return y - onset


def robot_after_onset(name: str, tier: str, episode: int) -> dict[str, NDArray[np.float64]]:
    """Return the true state of a robot after the onset, as ``info`` has it."""
    envs = _one_robot(name, tier)
    _, info = envs.reset(seed=FIRST_SEED + episode)
    while not info["faults"][0]:
        *_, info = envs.step(np.zeros((1, 3), np.float32))
    kept = ("morphology", "servo_gain", "sensor_noise", "sensor_bias", "sensor_lost")
    return {key: info[key][0] for key in kept}


def _one_robot(name: str, tier: str) -> AquaFishVectorEnv:
    kwargs: dict[str, Any] = {**IDS[name], "damage": damage_of(name, tier)}
    return AquaFishVectorEnv(1, threads=1, **kwargs)
