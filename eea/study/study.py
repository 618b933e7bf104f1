"""A study: its replicates, and everything that determines their results."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from aquafish_gym.runs.manifest import versions
from eea.core.checks import ConfigurationError, whole
from eea.core.config import Config
from eea.study.plan import Plan, written_plan
from eea.study.replicate import Replicate, World

# An arm's name names folders, figures and cells of tables.
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
_LONGEST = 120
# Settings that are the study's, or depend on the clock.
_NOT_AN_ARMS = ("steps", "rounds", "time_limit")
MOST_REPLICATES = 10_000  # of an arm; the paper has 25
MOST_JOBS = 100_000


@dataclass(frozen=True)
class Study:
    """The replicates of a study, and everything that determines their results.

    Raises
    ------
    ConfigurationError
        If an argument is wrong or there is no replicate.
    """

    arms: Mapping[str, Config]  #: Name to settings, without steps, rounds and time limit.
    steps: tuple[int, ...]  #: Lengths of trials; each arm has each.
    rounds: int
    first_seed: int
    replicates: int  #: Seeds of each arm at each length; the same in all, so that arms are paired.
    world: World

    def __post_init__(self) -> None:
        whole("replicates", self.replicates, 1, MOST_REPLICATES)
        whole("first_seed", self.first_seed, 0, 2**63 - 1)
        whole("the number of arms", len(self.arms), 1)
        whole("the number of steps", len(self.steps), 1)
        if len(set(self.steps)) < len(self.steps):
            raise ConfigurationError(f"steps must differ from each other; got {self.steps}")
        for name, config in self.arms.items():
            if not _NAME.fullmatch(name) or len(name) > _LONGEST:
                raise ConfigurationError(
                    f"an arm's name must be letters, digits, '.', '_' and '-', begin with a letter "
                    f"or digit and have at most {_LONGEST} characters; got {name!r}"
                )
            if config.time_limit is not None:
                raise ConfigurationError(
                    f"time_limit must be None in a study; the arm {name} has {config.time_limit}"
                )
        count = len(self.arms) * len(self.steps) * self.replicates
        whole("arms times steps times replicates", count, 1, MOST_JOBS)
        self._configs()  # checks the steps and the rounds

    def _configs(self) -> list[tuple[str, Config]]:
        """Return the name and the settings of each arm at each length of trial."""
        return [
            (name, replace(config, steps=steps, rounds=self.rounds))
            for name, config in self.arms.items()
            for steps in self.steps
        ]

    @property
    def seeds(self) -> range:
        """The seeds of every arm."""
        return range(self.first_seed, self.first_seed + self.replicates)

    def jobs(self) -> list[Replicate]:
        """Return every replicate, by arm, steps and seed."""
        return [
            Replicate(name, config, seed, self.world)
            for name, config in self._configs()
            for seed in self.seeds
        ]

    @property
    def plan(self) -> Plan:
        """The seeds of each arm and length of trial."""
        return {name: dict.fromkeys(sorted(self.steps), self.seeds) for name in self.arms}

    def to_dict(self) -> dict[str, Any]:
        """Return everything that determines the results, ready for JSON."""
        world = dict(vars(self.world))
        gap = world.pop("gap")
        return {
            "target_morphology": world.pop("morphology").to_dict(),
            "target_damage": world.pop("damage").to_list(),
            **world,
            "current": list(self.world.current),
            **({"gap": gap.changes} if gap.changes else {}),
            "rounds": self.rounds,
            "replicates": written_plan(self.plan),
            "arms": {
                name: {k: v for k, v in config.to_dict().items() if k not in _NOT_AN_ARMS}
                for name, config in self.arms.items()
            },
            "versions": [versions()],
        }
