"""Add numbers to the lists of held-out damages; those that a list has never change.

    python -m experiments.held_out --lists "severe@15-30" --first 120200 --count 100

The numbers are drawn as the league and the reference scores draw: in an episode of the seed 10^9 +
number after its fin angles and its task, or by ``experiments.league.draws``. Commit the file before
anything is tried on them.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro
from gymnasium.utils import seeding

import aquafish_gym.damage
from aquafish_gym.damage import Damage
from aquafish_gym.damage.held_out import FILE, SCHEMA, lists, spans
from aquafish_gym.damage.words import parts_of
from aquafish_gym.envs.tasks import TASKS
from aquafish_gym.plans import AQUAFISH, PLANS
from aquafish_gym.runs.command_line import run_command_line
from aquafish_gym.utils.storage import write_document
from aquafish_gym.utils.validation import InvalidArgumentError, integer, one_of
from experiments.league.draws import OUTSIDE, Draw, episode_rng, three_faults
from gait.swims.evaluation import FIRST_SEED

PLACE = Path(str(aquafish_gym.damage.__file__)).with_name(FILE)
#: Of the lists whose damages depend on the number and the list's name alone.
DRAWS: dict[str, Draw] = {"three faults": three_faults, **OUTSIDE}
_TIERS = ("severe", "moderate", "mild")
#: The other fish than the paper's: their lists begin with their names.
OTHERS = {f"{plan.name} ": plan for plan in PLANS.values() if plan != AQUAFISH}
#: Of bodies alone, as the list "recovery", which was chosen by hand.
BODIES = tuple(f"{own}recovery" for own in OTHERS)
#: Of the others, the task whose episodes they are for, and what breaks at random.
RANDOM: dict[str, tuple[str, str]] = {
    **{f"{own}{what}": ("forward", what) for own in OTHERS for what in (*_TIERS, "severe@15-30")},
    **{tier: ("forward", tier) for tier in _TIERS},
    **{f"{task} {tier}": (task, tier) for task in ("station", "waypoint") for tier in _TIERS},
    **{f"{tier}@15-30": ("recovery", f"{tier}@15-30") for tier in _TIERS},
    "severe@1-9": ("recovery", "severe@1-9"),
    "severe@15-16": ("recovery", "severe@15-16"),
    **{f"return {tier}@15-30": ("return", f"{tier}@15-30") for tier in _TIERS},
}


LISTS = (*RANDOM, *BODIES, *DRAWS)


def draw(name: str, number: int) -> str:
    """Return what today's rules draw for a number of a list."""
    if name in DRAWS:
        return DRAWS[name](episode_rng(number, name))
    plan = next((plan for own, plan in OTHERS.items() if name.startswith(own)), AQUAFISH)
    if name in BODIES:
        return str(Damage.random(episode_rng(number, name), plan))
    task, what = RANDOM[name]
    rng, _ = seeding.np_random(FIRST_SEED + number)
    rng.uniform(-math.pi, math.pi, len(plan.fins))  # fin angles, as in aquafish_gym.envs.episode
    TASKS[task].begin(rng)
    return str(Damage.parse(f"random:{what}").sample(rng, parts_of(plan)))


@dataclass(frozen=True)
class HeldOut:
    """Add numbers to lists of held-out damages."""

    example: ClassVar[str] = '--lists "severe@15-30" --first 120200 --count 100'

    lists: Annotated[
        tuple[str, ...],
        tyro.conf.arg(metavar="NAME", help=f"Some of: {'; '.join(LISTS)}."),
    ] = LISTS
    first: int = 120_200
    """The first number."""
    count: int = 100
    """How many numbers."""

    def execute(self) -> None:
        """Draw the numbers, and write the file."""
        found = {name: dict(damages) for name, damages in lists().items()}
        numbers = range(
            integer("first", self.first, 0), self.first + integer("count", self.count, 1)
        )
        for name in self.lists:
            one_of("lists", name, LISTS)
            found[name] = extended(name, found.get(name, {}), numbers)
            print(f"{name}: {spans(list(found[name]))}")
        write_document(PLACE, {"lists": found}, SCHEMA, indent=0)


def extended(name: str, damages: dict[int, str], numbers: Sequence[int]) -> dict[int, str]:
    """Return the damages of a list with those of new numbers, in order."""
    known = sorted(damages.keys() & set(numbers))
    if known:
        raise InvalidArgumentError(
            f"first and count must be of numbers that the list {name!r} lacks, as damages never "
            f"change; it has {spans(known)}"
        )
    whole = damages | {number: draw(name, number) for number in numbers}
    return {number: whole[number] for number in sorted(whole)}


if __name__ == "__main__":
    sys.exit(run_command_line("experiments.held_out", HeldOut))
