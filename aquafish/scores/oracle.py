"""The oracle of AquaFishRecovery-v0: in each episode a gait for the very robot that is left."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from aquafish.scores.entries import ENTRIES, briefer
from aquafish.scores.play import play_one, what_is_left
from aquafish_gym.engines.worlds import WorldConfig
from gait.config import EvolveConfig
from gait.evolve import Generation, evolve_gait
from gait.task import Crew

NAME = "AquaFishRecovery-v0"
LIKE = "CMA-ES, fins"  # the entry that is evolved
BRIEFER = 2  # than that


def oracle(tier: str, episode: int, shorter: int, tell: Callable[[str, float], None]) -> float:
    """Return how far a gait that was evolved for what is left swims from the onset on, in units.

    It is evolved for the body and the servos as they are once something is broken, and swims
    through the whole episode. Where a sensor is broken, it hears the clock and the fins alone.
    """
    left = what_is_left(NAME, tier, episode)
    deaf = any(left[f"sensor_{what}"].any() for what in ("noise", "bias", "lost"))
    like = ENTRIES[LIKE].config
    assert isinstance(like, EvolveConfig)
    config = replace(
        like,
        seed=episode,
        threads=1,
        senses=("clock", "fins") if deaf else like.senses,
        **briefer(like, BRIEFER * shorter),
    )
    left_gain, right, caudal = left["servo_gain"].tolist()

    def evolving(row: Generation) -> None:
        tell(f"final {row.final:.1f}", (row.generation + 1) / config.plan.rows)

    best = evolve_gait(
        left["morphology"],
        config,
        world=WorldConfig(servo_gain=(left_gain, right, caudal)),
        on_generation=evolving,
    ).controller
    return play_one(NAME, tier, lambda fins: Crew([best], fins), episode)
