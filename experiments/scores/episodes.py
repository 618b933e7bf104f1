"""The episodes of the reference scores, the same for every agent: whole, and under each tier."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from aquafish_gym import IDS, held_out
from aquafish_gym.damage.tiers import TIERS
from aquafish_gym.envs.vector import AquaFishVectorEnv
from gait import Controller, evaluate
from gait.controllers.agents import ControllerAgent
from gait.swims.episode import transitions
from gait.swims.evaluation import EPISODES, FIRST_SEED, Evaluation

RECOVERY = "AquaFishRecovery-v0"
RETURN = "AquaFishReturn-v0"
# What controllers are made for, a task or another fish, and the ids that they then play. They are
# made in the first.
MadeFor = Literal["forward", "station", "waypoint", "four-fins", "tail-fish"]
IDS_OF: dict[MadeFor, tuple[str, ...]] = {
    "forward": ("AquaFish-v0", RECOVERY, RETURN),
    "station": ("AquaFishStation-v0",),
    "waypoint": ("AquaFishWaypoint-v0",),
    "four-fins": ("FourFins-v0",),
    "tail-fish": ("TailFish-v0",),
}
WHOLE = "whole"
COLUMNS = (WHOLE, *TIERS)


def damages_of(name: str, column: str, numbers: Sequence[int]) -> list[str]:
    """Return the damages of an id's episodes in a column, held out; their onset is the id's own."""
    if column == WHOLE:
        return ["none"] * len(numbers)
    onset = IDS[name].get("damage", "").partition("@")[2]
    task = IDS[name].get("task", "")
    own = f"{task} " if task not in ("", "recovery") else ""  # which draws more than fin angles
    own = f"{IDS[name]['plan']} " if "plan" in IDS[name] else own
    return held_out(f"{own}{column}" + (f"@{onset}" if onset else ""), numbers)


def play(name: str, agent: object, episodes: int = EPISODES) -> dict[str, Any]:
    """Return an agent's results in an id's episodes, by column.

    Returns
    -------
    dict
        For each of ``COLUMNS`` the ``returns`` (E,), and where the task has success the number of
        ``successes``. Otherwise, where damage strikes in mid-swim also ``after`` (E,), the distance
        along +y from the onset on, and ``twin`` (E,), the same distance in the episode without
        damage. A robot that diverged counts up to there.
    """
    whole = evaluate(agent, name, episodes=episodes, damage="none", threads=1)
    found = {WHOLE: _result(whole)}
    for tier in TIERS:
        damages = damages_of(name, tier, range(episodes))
        broken = evaluate(agent, name, episodes=episodes, damage=damages, threads=1)
        found[tier] = _result(broken)
        if "@" in damages[0] and broken.succeeded is None:
            found[tier]["after"] = broken.way_since(broken.onset).tolist()
            found[tier]["twin"] = whole.way_since(broken.onset).tolist()
    return found


def _result(played: Evaluation) -> dict[str, Any]:
    found: dict[str, Any] = {"returns": played.returns.tolist()}
    if played.succeeded is not None:
        found["successes"] = int(played.succeeded.sum())
    return found


@dataclass(frozen=True)
class Onset:
    """An episode of one robot at the end of the step in which something broke.

    Attributes
    ----------
    info
        What the environment says of the robot then, its new body and servo gains included.
    state
        (25,) as of ``AquaFishVectorEnv.states``.
    seconds
        What is left of the episode.
    """

    info: dict[str, Any]
    state: NDArray[np.float64]
    seconds: float
    _envs: AquaFishVectorEnv
    _seen: NDArray[np.float32]
    _y: float

    def swim_on(self, gait: Controller) -> float:
        """Return the distance along +y from the onset on with a gait that knows the servo gains."""
        envs = copy.deepcopy(self._envs)
        agent = ControllerAgent(gait, self.info["servo_gain"])
        agent.reset(self.info)
        y = self._y
        for step in transitions(envs, agent.act, self._seen):
            if not step.terminated[0]:
                y = float(step.info["y_position"][0])
        return y - self._y


def swim_to_onset(name: str, tier: str, gait: Controller, episode: int) -> Onset:
    """Return one episode at the onset, up to which the robot swims a gait."""
    kwargs: dict[str, Any] = {**IDS[name], "damage": damages_of(name, tier, [episode])}
    envs = AquaFishVectorEnv(1, threads=1, **kwargs)
    seen, info = envs.reset(seed=FIRST_SEED + episode)
    agent = ControllerAgent(gait)
    agent.reset(info)
    seconds = envs.task.seconds
    y = 0.0
    for step in transitions(envs, agent.act, seen):
        seconds -= envs.dt
        if step.info["faults"][0]:
            break
        y = float(step.info["y_position"][0])
    robot = {key: value[0] for key, value in step.info.items()}
    return Onset(robot, envs.states[:, 0], seconds, envs, step.observation, y)
