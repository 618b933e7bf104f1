"""What the pages of docs/environments say in numbers."""

from __future__ import annotations

from aquafish_gym.envs.tasks import HoldStation, ReturnToBuoys
from gait.learning.train import LearningConfig
from tests.docs.committed import (
    TIERS,
    Claim,
    cell,
    document,
    fish_fitness,
    fraction,
    number,
    numbers,
)

SCORES = "results/scores/table.md"
RETURN = ReturnToBuoys()
TIMES = "results/scores/times.md"


def severe_share(entry: str) -> float:
    """Return the share of its distance that a controller keeps after severe damage."""
    found = cell(SCORES, f"AquaFishRecovery-v0, after the onset|{entry}", "severe")
    return float(found.rpartition(", ")[2].removesuffix("%")) / 100.0


def pace_to_keep(onset: float) -> float:
    """Return the share of its pace that a robot needs from an onset on to return in time."""
    needed = RETURN.seconds * (1.0 - RETURN.spare)
    return (needed - onset) / (RETURN.seconds - onset)


def best(task: str, tier: str, *also: str) -> str:
    """Return which evolved or learned controller has the greatest return."""
    made = ("CPG", "NEAT", "CMA-ES", "CMA-ES, fins", "PPO", "PPO, fins", "PPO, damaged", *also)
    return max(made, key=lambda one: number(SCORES, f"{task}|{one}", tier))


def interval(row: str, tier: str) -> list[float]:
    """Return the interval of a return."""
    return numbers(SCORES, row, tier)[1:]


def overlap(first: list[float], second: list[float]) -> bool:
    """Return whether two intervals have a number in common."""
    return max(first[0], second[0]) <= min(first[1], second[1])


def returned(tier: str) -> list[float]:
    """Return in how many of a hundred episodes the gaits that know the fin angles return."""
    task = "AquaFishReturn-v0, success"
    rows = [f"{task}|{entry}, fins" for entry in ("CMA-ES", "PPO")]
    return [number("results/scores/return.md", row, tier) for row in rows]


SEVERE_LOSSES = [
    1.0 - number(SCORES, row, "severe") / number(SCORES, row, "whole")
    for entry in ("NEAT", "CMA-ES", "CMA-ES, fins", "PPO", "PPO, fins", "PPO, damaged")
    for row in [f"AquaFishWaypoint-v0|{entry}"]
]
FISH_GAIN = document("results/fish/league.json")["self-model"]["severe"]["over"]["blind"]

CLAIMS = [
    Claim(
        "docs/environments/fish.md",
        "with OBJ_FIT {:.3f} [{:.3f}, {:.3f}].",
        fish_fitness("joint"),
    ),
    Claim(
        "docs/environments/fish.md",
        "reaches {:.3f} [{:.3f}, {:.3f}] by 20 trials.",
        fish_fitness("out-of-band"),
    ),
    Claim(
        "docs/environments/fish.md",
        "gains {:.1f} [{:.1f}, {:.1f}] units over one that never looks for damage, in 20 episodes "
        "with severe damage, and is behind it in {}.",
        (*FISH_GAIN["mean"], FISH_GAIN["worse"] or "none"),
    ),
    Claim(
        "docs/environments/scores.md",
        "PPO returns {:.1f} times the CPG with IMU and clock, and {:.0f} times with known fin "
        "angles.",
        tuple(
            number(SCORES, f"AquaFish-v0|{entry}", "whole")
            / number(SCORES, "AquaFish-v0|CPG", "whole")
            for entry in ("PPO", "PPO, fins")
        ),
    ),
    Claim(
        "docs/environments/scores.md",
        "Training on damage costs PPO {:.0%} without damage",
        (
            1.0
            - number(SCORES, "AquaFish-v0|PPO, damaged", "whole")
            / number(SCORES, "AquaFish-v0|PPO, fins", "whole"),
        ),
    ),
    Claim(
        "docs/environments/scores.md",
        "still returns {:.0f} of 300, PPO with known fin angles {:.0f}.",
        tuple(number(SCORES, f"AquaFishStation-v0|{e}", "whole") for e in ("still", "PPO, fins")),
    ),
    Claim(
        "docs/environments/scores.md",
        "PPO with known fin angles is best ({:.0f}).",
        (number(SCORES, "AquaFishWaypoint-v0|PPO, fins", "whole"),),
        holds=best("AquaFishWaypoint-v0", "whole") == "PPO, fins",
    ),
    Claim(
        "docs/environments/scores.md",
        "Severe damage costs PPO, CMA-ES and NEAT {:.0%} to {:.0%}",
        (min(SEVERE_LOSSES), max(SEVERE_LOSSES)),
    ),
    Claim(
        "docs/environments/scores.md",
        "CMA-ES with known fin angles swims farthest under all tiers, in {} of PPO's time.",
        (
            fraction(
                number(TIMES, "CMA-ES, fins", "CPU s, forward")
                / number(TIMES, "PPO, fins", "CPU s, forward")
            ),
        ),
        holds=all(best("AquaFish-v0", tier) == "CMA-ES, fins" for tier in TIERS),
    ),
    Claim(
        "docs/environments/scores.md",
        "under severe damage the intervals of both overlap.",
        holds=overlap(
            *(interval(f"AquaFish-v0|PPO, {one}", "severe") for one in ("damaged", "fins"))
        ),
    ),
    Claim(
        "docs/environments/scores.md",
        "Under severe damage no controller is better than holding still.",
        holds=best("AquaFishStation-v0", "severe", "still") == "still",
    ),
    *(
        Claim(
            "docs/environments/scores.md",
            "with fins, PPO and CMA-ES keep {} of their distance after severe damage.",
            (fraction(severe_share(entry)),),
        )
        for entry in ("PPO, fins", "CMA-ES, fins")
    ),
    Claim(
        "docs/environments/scores.md",
        "CMA-ES and PPO that know the fin angles return in time in {:.0f} and {:.0f} of 100 "
        "episodes whole, in {:.0f} and {:.0f} after moderate damage, and in {:.0f} and {:.0f} "
        "after severe.",
        (*returned("whole"), *returned("moderate"), *returned("severe")),
    ),
    Claim(
        "docs/environments/scores.md",
        "a learned network of two layers of 64; {:g} million actions",
        (LearningConfig().steps / 1e6,),
    ),
    Claim(
        "docs/environments/station-v0.md",
        "A robot that holds its servos still gets {} of that",
        (fraction(number(SCORES, "AquaFishStation-v0|still", "whole") / 300.0),),
    ),
    Claim(
        "docs/environments/station-v0.md",
        "The water flows at {:g} to {:g} units/s",
        (HoldStation().slowest, HoldStation().fastest),
    ),
    Claim(
        "docs/environments/return-v0.md",
        "A robot that swims at {:g} units/s through the water arrives after {:.0f} s, with {:.0%} "
        "of the time to spare.",
        (RETURN.pace, RETURN.seconds * (1.0 - RETURN.spare), RETURN.spare),
    ),
    Claim(
        "docs/environments/return-v0.md",
        "After damage between seconds 15 and 30 it must keep {:.0f} to {:.0%} of that pace",
        (100.0 * pace_to_keep(30.0), pace_to_keep(15.0)),
    ),
]
#: Numbers of methods.
SETTINGS: dict[str, set[str]] = {
    "docs/environments/fish.md": {"95%"},
    "docs/environments/return-v0.md": {"0.05", "0.2"},
    "docs/environments/station-v0.md": {"0.5"},
    "docs/environments/waypoint-v0.md": {"1.5"},
    "docs/environments/scores.md": {"0.5", "95%"},  # 0.5 Hz, of the tail and of "bang-bang"
}
