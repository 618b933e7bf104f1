"""All tables of the league, one after another, each in a folder of its own.

    python -m experiments.league.whole --seeds held-out --out out/whole

Every usual entrant plays every table, in the same episodes; the ceiling, which takes five CPU
minutes an episode, plays tables of its own. The command says how many episodes are
missing, and about how long they take, before it begins; started again, it plays those that are
still missing. At the end waters-TIER.md compare the entrants' gains over blind in all waters, and
ceiling.md says how far below the ceiling others swim.
``--scheduler`` lets a dask cluster play, as in ``docs/howto/cluster.md``.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import tyro

from aquafish_gym.runs.command_line import Out, run_command_line
from aquafish_gym.utils.storage import read_document
from aquafish_gym.utils.validation import one_of
from experiments.league.command import (
    BLIND,
    HERO,
    ORACLE,
    SCHEMA,
    League,
    expectation,
)
from experiments.league.draws import OUTSIDE
from experiments.league.entrants import CEILING, ENTRANTS, USUAL
from experiments.league.episodes import CURRENT_BEGINS, HELD_OUT, Seeds, count_damages
from experiments.league.waters import WATERS
from experiments.tables import interval_text, write_tables

EPISODES = 40  # of a tier at home
RETURN_EPISODES = 100  # of a tier in the return
ELSEWHERE = 20  # of a tier in other waters, and with fewer sensors
BELOW = (BLIND, HERO, ORACLE)  # entrants that are compared with the ceiling
_ALL: Any = ("severe", "moderate", "mild", "none")
OTHER_WATERS = tuple(water for water in WATERS if water != "still")
WATER_TABLES = ("home", "none", *OTHER_WATERS)
#: What each table differs in from the default league.
TABLES: dict[str, dict[str, Any]] = {
    "home": {"episodes": EPISODES},
    "none": {"episodes": ELSEWHERE, "tiers": ("none",)},
    "held-out": {"episodes": 2 * count_damages(HELD_OUT), "tiers": (HELD_OUT,)},
    "return": {"episodes": RETURN_EPISODES, "task": "return", "tiers": _ALL},
    **{
        water: {"episodes": ELSEWHERE, "water": water, "tiers": _ALL}
        for water in OTHER_WATERS
    },
    "imu": {"episodes": ELSEWHERE, "sensing": "imu"},
    "gyroscope": {"episodes": ELSEWHERE, "sensing": "gyroscope"},
    "three-faults": {
        "episodes": ELSEWHERE, "tiers": ("three faults",), "entrants": (BLIND, HERO, ORACLE),
    },
    "early": {
        "episodes": ELSEWHERE, "tiers": ("early", "after 15 s"), "entrants": (HERO, ORACLE),
    },
    "outside": {"episodes": EPISODES, "tiers": tuple(OUTSIDE), "entrants": (BLIND, HERO)},
    "current-begins": {
        "episodes": ELSEWHERE, "tiers": (CURRENT_BEGINS,), "entrants": (BLIND, HERO),
    },
    "ceiling-severe": {"episodes": 10, "tiers": ("severe",), "entrants": (*BELOW, CEILING)},
    "ceiling-other": {
        "episodes": 5, "tiers": ("moderate", "mild"), "entrants": (*BELOW, CEILING),
    },
    # Long swims in which nothing breaks: how often the agent is alarmed for nothing.
    "calm": {
        "episodes": 100, "seconds": 600.0, "water": "current", "tiers": ("none",),
        "entrants": (HERO,),
    },
}  # fmt: skip


@dataclass(frozen=True)
class WholeLeague:
    """Play all tables of the league: every entrant, task, water and set of sensors."""

    example: ClassVar[str] = "--tables home return --episodes 2 --seeds development --out out/whole"

    out: Out = Path("out/whole")
    tables: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="NAME", help=f"Some of: {'; '.join(TABLES)}.")
    ] = tuple(TABLES)
    entrants: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="NAME", help=f"Some of: {'; '.join(ENTRANTS)}.")
    ] = USUAL
    seeds: Seeds = "published"
    """Set of the episodes. Make and tune agents on development alone, play held-out once."""
    first: int = 0
    """The first episode of the set."""
    episodes: int | None = None
    """Episodes of each tier, for a quick look; by default each table's own."""
    workers: int | None = None
    """Processes; every core if not given. No result but the CPU times depends on it."""
    scheduler: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS")] = None
    """Address of a dask scheduler whose workers play, such as tcp://host:8786. They must be able to
    import this clone: start them with its folder in PYTHONPATH."""

    def leagues(self) -> list[League]:
        """Return the tables' leagues."""
        found = []
        for name in self.tables:
            settings = TABLES[one_of("tables", name, TABLES)]
            league = League(
                out=self.out / name, seeds=self.seeds, first=self.first, workers=self.workers,
                scheduler=self.scheduler, **{"entrants": self.entrants} | settings,
            )  # fmt: skip
            if self.episodes is not None:
                league = replace(league, episodes=self.episodes)
            found.append(league)
        return found

    def execute(self) -> None:
        """Play the missing episodes of all tables."""
        leagues = self.leagues()
        total = sum(len(league.jobs()) for league in leagues)
        missing, cpu = (sum(each) for each in zip(*(x.cpu_left() for x in leagues), strict=True))
        print(
            f"{len(leagues)} tables: "
            + expectation(int(missing), total, cpu, self.workers, self.scheduler),
            file=sys.stderr,
        )
        for league in leagues:
            print(f"\n{league.out}", file=sys.stderr)
            league.execute()
        self._compare_waters(leagues)
        self._compare_with_ceiling(leagues)

    def _compare_waters(self, leagues: Sequence[League]) -> None:
        """Write waters-TIER.md: the entrants' gains over blind in each water that was played."""
        waters: dict[str, dict[str, Any]] = {}
        for league in leagues:
            if league.out.name in WATER_TABLES:
                found = read_document(league.out / "league.json", SCHEMA, "league")
                tiers_of = waters.setdefault(league.water, {})
                for entrant in self.entrants:
                    tiers_of[entrant] = tiers_of.get(entrant, {}) | found.get(entrant, {})
        if not waters or BLIND not in self.entrants:
            return
        for tier in _ALL:
            rows = [["entrant", *waters]]
            for entrant in self.entrants:
                cells = [_gain(found, entrant, tier) for found in waters.values()]
                rows.append([entrant, *cells])
            write_tables(self.out, {f"waters-{tier}": rows})

    def _compare_with_ceiling(self, leagues: Sequence[League]) -> None:
        """Write ceiling.md: how far below the ceiling others swim in the same episodes."""
        rows = [
            [
                "tier", "episodes", "ceiling, units", *(f"{one}, below it" for one in BELOW),
                *(f"{one}, share" for one in BELOW), f"{ORACLE} below it",
            ]
        ]  # fmt: skip
        for league in leagues:
            if CEILING not in league.entrants:
                continue
            found = read_document(league.out / "league.json", SCHEMA, "league")
            for tier in league.tiers:
                top = found[CEILING][tier]
                others = [found[one][tier] for one in BELOW]
                below = [top["over"][one]["mean"] for one in BELOW]
                worse = found[ORACLE][tier]["over"][CEILING]["worse"]
                rows.append(
                    [
                        tier,
                        f"{top['episodes']}",
                        f"{top['mean']:.1f}",
                        *(interval_text(one, 2) for one in below),
                        *(f"{one['mean'] / top['mean']:.1%}" for one in others),
                        f"{worse} of {top['episodes']}",
                    ]
                )
        if len(rows) > 1:
            write_tables(self.out, {"ceiling": rows})


def _gain(found: Mapping[str, Any], entrant: str, tier: str) -> str:
    """Return a cell: an entrant's gain over blind, and of blind itself its mean way."""
    if tier not in found.get(entrant, {}):
        return "-"
    one = found[entrant][tier]
    if entrant == BLIND:
        return f"way {one['mean']:.1f}"
    return interval_text(one["over"][BLIND]["mean"], 2)


if __name__ == "__main__":
    sys.exit(run_command_line("experiments.league.whole", WholeLeague))
