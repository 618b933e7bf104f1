"""The episodes of the recovery league: the task, what breaks, in which water, what is sensed."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import Any, Literal

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish.online.agent import SelfModelAgent
from aquafish.online.recognition import alike
from aquafish_gym import held_out
from aquafish_gym.envs.tasks import SwimForward
from aquafish_gym.plans import AQUAFISH, BodyPlan
from aquafish_gym.scenario import CHANNELS
from aquafish_gym.utils.validation import InvalidArgumentError
from experiments.league.draws import (
    FASTEST,
    OUTSIDE,
    BeginningCurrent,
    Draw,
    beginning_current,
    episode_rng,
    three_faults,
)
from experiments.league.entrants import ENTRANTS, TRUTH, Oracle
from experiments.league.policy import DT
from experiments.league.waters import Water, engine_of
from gait.swims.episode import transitions
from gait.swims.evaluation import FIRST_SEED

Task = Literal["recovery", "return"]
IDS: dict[Task, str] = {"recovery": "AquaFishRecovery-v0", "return": "AquaFishReturn-v0"}
SECONDS = 60.0  # of both
Seeds = Literal["published", "development", "held-out"]
#: The numbers of the episodes of each set. "published" has those of the reference scores, 0 to 99,
#: and of the tables that were published first. Agents are made and tuned on "development" alone.
#: "held-out" is played once, when nothing is changed any more.
SEEDS: dict[Seeds, range] = {
    "published": range(1000),
    "development": range(60_000, 120_000),
    "held-out": range(120_000, 130_000),
}
Sensing = Literal["fins", "imu", "gyroscope"]

CURRENT_BEGINS = "current begins"
HELD_OUT = "held-out"
#: What breaks in each tier: nothing; the 26 damages of the list "league" in turn; or one for each
#: episode, by ``damage_of``, of the list of this name or of the tier's. The damages of "early" are
#: those of "after 15 s" in the episodes of the same numbers.
TIERS: dict[str, str | Draw] = {
    "severe": "severe@15-30",
    "moderate": "moderate@15-30",
    "mild": "mild@15-30",
    HELD_OUT: "league",
    "none": "",
    "early": "severe@1-9",
    "after 15 s": "severe@15-16",
    CURRENT_BEGINS: "",
    "three faults": three_faults,
    **OUTSIDE,
}
RETURNS = ("severe", "moderate", "mild")  # of which the return has lists of its own


def count_damages(tier: str) -> int:
    """Return the number of a tier's damages, which its episodes have in turn."""
    return len(held_out("league")) if tier == HELD_OUT else 1


def damage_of(tier: str, number: int, task: Task = "recovery", plan: BodyPlan = AQUAFISH) -> str:
    """Return what breaks in an episode: of the development's numbers drawn, else of a list.

    Raises
    ------
    InvalidArgumentError
        If the list lacks the number, or the tier breaks the fins of the paper's fish alone.
    """
    what = TIERS[tier]
    if plan != AQUAFISH and (callable(what) or tier == HELD_OUT):
        known = [name for name, one in TIERS.items() if isinstance(one, str) and name != HELD_OUT]
        raise InvalidArgumentError(
            f"tiers of the plan {plan.name} must be of {', '.join(known)}; got {tier!r}"
        )
    if tier == HELD_OUT:
        damages = held_out("league")
        return damages[number % len(damages)]
    if not what:
        return ""
    if number in SEEDS["development"]:
        return what(episode_rng(number, tier)) if callable(what) else f"random:{what}"
    name = tier if callable(what) else what
    if task == "return" and tier in RETURNS:
        name = f"return {name}"
    return held_out(name if plan == AQUAFISH else f"{plan.name} {name}", [number])[0]


@dataclass(frozen=True)
class Episode:
    """One episode of an entrant; its number says what breaks, and where the fins begin."""

    entrant: str
    tier: str
    number: int
    noise: float = 0.01  #: Standard deviation of the gyroscope's noise, rad/s.
    water: Water = "still"
    sensing: Sensing = "fins"
    seconds: float = SECONDS
    task: Task = "recovery"
    plan: BodyPlan = AQUAFISH

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.entrant}, {self.tier}, episode {self.number}"

    @property
    def file(self) -> str:
        """The path of its result."""
        entrant, tier = (
            "".join(c if c.isalnum() else "-" for c in text) for text in (self.entrant, self.tier)
        )
        return f"runs/{entrant}/{tier}/{self.number:03d}.json"

    @property
    def damage(self) -> str:
        """All that breaks, the sensors that its tier of sensing lacks among them."""
        faults = [f"gyro:noise={self.noise!r}"] if self.noise else []
        if self.sensing == "gyroscope":
            faults += [f"{channel}:dropped" for channel in CHANNELS[:6]]
        faults.append(damage_of(self.tier, self.number, self.task, self.plan))
        return "; ".join(filter(None, faults))

    @property
    def rng(self) -> np.random.Generator:
        """The generator from which what its tier alone has is drawn."""
        return episode_rng(self.number, self.tier)


def episode_numbers(seeds: Seeds, first: int, count: int) -> list[int]:
    """Return the numbers of some episodes of a set, from its ``first``-th on.

    Raises
    ------
    InvalidArgumentError
        If the set has fewer: the next numbers are those of no set, or of another one.
    """
    known = SEEDS[seeds]
    if first + count > len(known):
        raise InvalidArgumentError(
            f"episodes must be at most {len(known) - first} from the {first}-th of the seeds "
            f"{seeds!r} on; got {count}"
        )
    return list(known[first : first + count])


def play(episode: Episode) -> dict[str, Any]:
    """Play an episode; return the way along +y after each action, and what the agent noticed.

    The way is relative to the water's mean velocity; in the return it is over the ground, and
    ``success`` says whether the line was reached. ``belief`` is what an agent with a self-model
    believes at the end; see :func:`_belief`. The CPU time is the agent's.
    """
    rng = np.random.default_rng(episode.number)
    current = np.zeros(3)
    if episode.water == "current":
        current = FASTEST * rng.random() * _direction(rng)
    x, y = rng.uniform(-np.pi, np.pi, 2).tolist()  # of vortices
    options: dict[str, Any] = {"current": tuple(current.tolist())}
    if episode.seconds != SECONDS:
        options["task"] = SwimForward(seconds=episode.seconds)
    onsets = list[int]()
    begins: BeginningCurrent | None = None
    if episode.tier == CURRENT_BEGINS:
        begins = options["task"] = beginning_current(episode.rng)
        onsets.append(math.ceil(begins.onset / DT - 1e-9))
    env = gym.make(
        IDS[episode.task],
        damage=episode.damage or None,
        engine=engine_of(episode.water, (x, y)),
        reactive=episode.water == "reactive",
        plan=episode.plan,
        **options,
    )
    observation, info = env.reset(seed=FIRST_SEED + episode.number)
    agent = ENTRANTS[episode.entrant].make(
        plan=episode.plan,
        gyro_noise=episode.noise,
        gyro_only=episode.sensing == "gyroscope",
        seconds=episode.seconds,
        seed=episode.number,
    )
    agent.begin(info["fin_angles"] if episode.sensing == "fins" else None)
    measure = getattr(agent, "measure", None)
    truth = _truth(info)
    way = [0.0]
    spent = [0.0]

    def act(observation: NDArray[np.float32]) -> ArrayLike:
        began = time.process_time()
        action = agent.act(observation)
        spent.append(time.process_time() - began)
        return action

    for step in transitions(env, act, observation):
        drifted = DT * len(way) * current[1]
        if begins is not None:
            drifted += DT * max(0, len(way) - onsets[0]) * begins.flow[1]
        way.append(float(step.info["y_position"]) - drifted)
        if measure is not None:
            measure(way[-1])
        if _truth(step.info) != truth:
            truth = _truth(step.info)
            onsets.append(len(way) - 1)
            if isinstance(agent, Oracle):
                agent.learn(step.info)
    env.close()
    success = {"success": step.info["is_success"]} if "is_success" in step.info else {}
    belief = {"belief": _belief(agent, step.info)} if isinstance(agent, SelfModelAgent) else {}
    if begins is not None:
        success["flow"] = begins.flow
    return {
        "onsets": onsets,
        "diverged": step.info["diverged"],
        **success,
        **belief,
        "way": [round(y, 6) for y in way],
        "events": [list(event[:3]) for event in getattr(agent, "events", [])],
        "seconds": {"cpu": sum(spent), "slowest": max(spent)},
    }


def _belief(agent: SelfModelAgent, info: dict[str, Any]) -> dict[str, Any]:
    """Return whether an agent knows what its robot is, and the current that it named last.

    It knows it if its robot and the true one need no different gaits; see ``alike``.
    """
    robot = agent.model.robot
    body = np.asarray(info["morphology"])[None]
    truth = replace(robot, body=body, servo_gain=np.asarray(info["servo_gain"])[None])
    current = () if agent.recognised is None else agent.recognised.current
    return {"alike": alike(robot, truth), "current": list(current)}


def _truth(info: dict[str, Any]) -> dict[str, Any]:
    """Return what is broken, as ``info`` says."""
    return {name: np.asarray(info[name]).tolist() for name in TRUTH}


def _direction(rng: np.random.Generator) -> NDArray[np.float64]:
    vector = rng.standard_normal(3)
    return np.asarray(vector / np.linalg.norm(vector))
