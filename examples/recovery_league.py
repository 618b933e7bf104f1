"""The league: damage strikes a swimming robot, and the clock runs on.

    python examples/recovery_league.py --entrants self-model "PPO, fins" --episodes 10 --out DIR

Every entrant plays the same episodes of AquaFishRecovery-v0: something breaks at a time between 15
and 30 s, and 60 s are the end. It observes what the environment returns, and the initial fin
angles. An agent of your own enters as a class with ``begin(fin_angles)`` and ``act(observation)``:
add it to ``ENTRANTS``.

DIR holds league.json, {entrant: {tier: {way_after_onset, ...}}}, table.md, pace.png and a file for
each episode. The same command resumes.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import gymnasium as gym
import numpy as np
import tyro
from numpy.typing import NDArray

import aquafish_gym  # noqa: F401  registers the environments
from aquafish_gym.command_line import Out, run_command_line
from aquafish_gym.rendering.pictures import new_figure, save_figure
from aquafish_gym.runs.storage import write_document
from aquafish_gym.utils.validation import integer, one_of
from eea.study.drawing import grid, legend_below
from gait.evaluation import FIRST_SEED, interquartile_mean
from league_entrants import ENTRANTS, Oracle
from tables import do_table

Floats = NDArray[np.float64]

NAME, SCHEMA = "AquaFishRecovery-v0", "aquafish.league/1"
TIERS = {
    "severe": "random:severe@15-30",
    "moderate": "random:moderate@15-30",
    "mild": "random:mild@15-30",
    "two faults": "random:moderate@15-20; random:moderate@30-40",
    "a fault that ends": "random:severe@15-20+15",
    "none": "",
}
Water = Literal["still", "current", "reactive"]
SHARES = (0.5, 0.8, 0.9)  # of the oracle's mean pace after the onset
SMOOTH = 5.0  # s over which a pace is taken
ORACLE = "oracle"


@dataclass(frozen=True)
class Episode:
    """One episode of an entrant."""

    entrant: str
    tier: str
    number: int
    noise: float
    water: Water

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


def play(episode: Episode) -> dict[str, Any]:
    """Play an episode; return the way along +y after each action, and what the agent noticed."""
    broken = [f"gyro:noise={episode.noise!r}"] if episode.noise else []
    broken += [TIERS[episode.tier]] if TIERS[episode.tier] else []
    rng = np.random.default_rng(episode.number)
    current = 0.2 * rng.random() * _direction(rng) if episode.water == "current" else np.zeros(3)
    env = gym.make(
        NAME,
        damage="; ".join(broken) or None,
        engine="numba",
        current=tuple(current.tolist()),
        reactive=episode.water == "reactive",
    )
    observation, info = env.reset(seed=FIRST_SEED + episode.number)
    agent = ENTRANTS[episode.entrant](episode.noise)
    agent.begin(info["fin_angles"])
    at_first = faults = int(info["faults"])
    onset, way, slowest, began = None, [0.0], 0.0, time.process_time()
    truncated = terminated = False
    while not (truncated or terminated):
        before = time.process_time()
        action = np.asarray(agent.act(observation), np.float32)
        slowest = max(slowest, time.process_time() - before)
        observation, _, terminated, truncated, info = env.step(action)
        way.append(float(info["y_position"]))
        if int(info["faults"]) != faults:
            faults = int(info["faults"])
            onset = len(way) - 1 if onset is None and faults > at_first else onset
            if isinstance(agent, Oracle):
                agent.learn(info)
    env.close()
    return {
        "onset": onset,
        "way": [round(y, 6) for y in way],
        "events": [list(event[:3]) for event in getattr(agent, "events", [])],
        "seconds": {"cpu": time.process_time() - began, "slowest": slowest},
    }


def _direction(rng: np.random.Generator) -> Floats:
    vector = rng.standard_normal(3)
    return np.asarray(vector / np.linalg.norm(vector))


@dataclass(frozen=True)
class League:
    """Let entrants play the same episodes, in which something breaks while they swim."""

    out: Out = Path("out/league")
    entrants: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="NAME", help=f"Some of: {'; '.join(ENTRANTS)}.")
    ] = tuple(ENTRANTS)
    tiers: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="TIER", help=f"Some of: {'; '.join(TIERS)}.")
    ] = ("severe", "moderate", "mild")
    episodes: int = 100
    first: int = 0
    """The number of the first episode; those of the reference scores are 0 to 99."""
    noise: float = 0.01
    """Standard deviation of the gyroscope's noise, rad/s."""
    water: Water = "still"
    """Still; with an unknown current of up to 0.2 units/s; or with added mass."""
    workers: int | None = None
    """Processes; every core if not given. No result but the CPU times depends on it."""

    def execute(self) -> None:
        """Play the missing episodes; write league.json, table.md and pace.png."""
        for name, known in (("entrants", ENTRANTS), ("tiers", TIERS)):
            for one in getattr(self, name):
                one_of(name, one, known)
        integer("episodes", self.episodes, 1)
        jobs = [
            Episode(entrant, tier, self.first + i, self.noise, self.water)
            for i in range(self.episodes)
            for tier in self.tiers
            for entrant in self.entrants
        ]
        settings = {"noise": self.noise, "water": self.water}
        rows = do_table(
            jobs, play, self.out, "a league", settings,
            partial(self._tabulate, jobs), self.workers, ("league.json", "pace.png"),
            lambda missing: play(missing[0]),  # compiles for all
        )  # fmt: skip
        for row in rows:
            print("  ".join(f"{cell:>28}" if i else f"{cell:28}" for i, cell in enumerate(row)))

    def _tabulate(
        self, jobs: Sequence[Episode], results: Sequence[dict[str, Any]]
    ) -> list[list[str]]:
        played: dict[tuple[str, str], list[dict[str, Any]]] = {}
        for job, result in zip(jobs, results, strict=True):
            played.setdefault((job.entrant, job.tier), []).append(result)
        league = {
            entrant: {
                tier: summary(played[entrant, tier], played.get((ORACLE, tier)))
                for tier in self.tiers
            }
            for entrant in self.entrants
        }
        write_document(self.out / "league.json", league, SCHEMA)
        save_figure(pace_figure(played, self.entrants, self.tiers), self.out / "pace.png")
        rows = [["entrant", *(f"{tier}, units" for tier in self.tiers), "back to 50%, s", "CPU s"]]
        for entrant, tiers in league.items():
            first = tiers[self.tiers[0]]
            ways = [tiers[tier]["way_after_onset"] for tier in self.tiers]
            half = first["seconds_to"].get("50%")
            rows.append(
                [
                    entrant,
                    *(f"{way[0]:.1f} [{way[1]:.1f}, {way[2]:.1f}]" for way in ways),
                    "-" if half is None else f"{half['median']:.1f}",
                    f"{first['cpu']:.1f}",
                ]
            )
        return rows


def summary(
    results: Sequence[dict[str, Any]], oracle: Sequence[dict[str, Any]] | None
) -> dict[str, Any]:
    """Return what an entrant made in the episodes of a tier.

    ``way_after_onset`` is the interquartile mean in units with its 95% interval; where nothing
    breaks, of the whole way. ``seconds_to`` a share of the oracle's mean pace after the onset
    is when the pace, over 5 s, begins to stay above it: the median, and the mean in which an
    episode that does not counts to its end.
    """
    onsets = [result["onset"] or 0 for result in results]
    after = [
        result["way"][-1] - result["way"][o] for result, o in zip(results, onsets, strict=True)
    ]
    alarms = [[event[0] for event in result["events"] if event[1] == "alarm"] for result in results]
    found: dict[str, Any] = {
        "episodes": len(results),
        "way_after_onset": interquartile_mean([after]),
        "mean": float(np.mean(after)),
        "ways": after,
        "cpu": float(np.mean([result["seconds"]["cpu"] for result in results])),
        "slowest": max(result["seconds"]["slowest"] for result in results),
        "false_alarms": sum(
            any(result["onset"] is None or t < 0.2 * result["onset"] - 0.1 for t in times)
            for result, times in zip(results, alarms, strict=True)
        ),
        "seconds_to": {},
    }
    if oracle is not None and any(onsets):
        for share in SHARES:
            times = [
                _recovered(r["way"], t["way"], o, share)
                for r, t, o in zip(results, oracle, onsets, strict=True)
                if o
            ]
            found["seconds_to"][f"{share:.0%}"] = {
                "median": float(np.median(times)), "mean": float(np.mean(times))
            }  # fmt: skip
    return found


def _recovered(way: Sequence[float], oracle: Sequence[float], onset: int, share: float) -> float:
    """Return after how many s the pace stays above a share of the oracle's mean."""
    best, smooth = (oracle[-1] - oracle[onset]) / (len(oracle) - 1 - onset), round(SMOOTH / 0.2)
    after = np.array(way[onset:])
    slow = np.flatnonzero((after[smooth:] - after[:-smooth]) / smooth < share * best)
    return 0.2 * (int(slow[-1]) + 1) if len(slow) else 0.0


def pace_figure(
    played: dict[tuple[str, str], list[dict[str, Any]]],
    entrants: Sequence[str],
    tiers: Sequence[str],
) -> Any:
    """Draw the mean pace against the seconds since something broke, an entrant a line."""
    figure = new_figure(1.0 + 3.4 * len(tiers), 3.4)
    smooth = round(SMOOTH / 0.2)
    for axes, tier in zip(
        figure.subplots(1, len(tiers), sharey=True, squeeze=False).flat, tiers, strict=True
    ):
        for entrant in entrants:
            lines = []
            for result in played[entrant, tier]:
                onset = result["onset"] or 100
                way = np.array(result["way"][onset - 25 : onset + 126])
                lines.append((way[smooth:] - way[:-smooth]) / SMOOTH)
            shortest = min(map(len, lines))
            mean = np.mean([line[:shortest] for line in lines], axis=0)
            seconds = 0.2 * (np.arange(shortest) - 25 + smooth / 2)
            axes.plot(seconds, mean, lw=1.4, label=entrant)
        axes.axvline(0.0, color="0.6", lw=0.8)
        axes.set_title(tier)
        axes.set_xlabel("seconds since something broke")
        grid(axes)
    figure.axes[0].set_ylabel("pace, units/s")
    legend_below(figure, figure.axes[0], 4)
    return figure


if __name__ == "__main__":
    sys.exit(run_command_line("recovery_league", League))
