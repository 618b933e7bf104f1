"""What the pages of the agent that swims on say in numbers."""

from __future__ import annotations

import math

from tests.docs.committed import HERO, TIERS, Claim, cell, gain, number, worse

LEAGUE = "results/league"
CEILING = [number(f"{LEAGUE}/ceiling.md", tier, "self-model, share") for tier in TIERS]
ORACLES = [number(f"{LEAGUE}/ceiling.md", tier, "oracle, share") for tier in TIERS]

#: The numbers that each page says of methods.
SETTINGS = {
    "docs/swimming_on.md": ("0.01", "0.2", "0.4", "1.2", "1.4", "1.7", "4%", "90%", "95%"),
}
CLAIMS = [
    Claim(
        "docs/swimming_on.md",
        "Recognising is worth {:.1f} units after severe damage, {:.1f} after moderate and {:.1f} "
        "after mild. The agent is behind blind in {} of 120 episodes. More is hardly to be had: "
        "the oracle gains {:.1f}, {:.1f} and {:.1f}.",
        (
            *(gain(HERO, tier) for tier in TIERS),
            worse(HERO),
            *(gain("oracle", tier) for tier in TIERS),
        ),
    ),
    Claim(
        "docs/swimming_on.md",
        "Without refinement (*library only*) the agent loses {:.1f}, {:.1f} and {:.1f} units. RMA "
        "searches nothing in an episode and is {:.1f}, {:.1f} and {:.1f} units behind the agent",
        (
            *(gain(HERO, tier, "self-model, library only") for tier in TIERS),
            *(gain(HERO, tier, "RMA") for tier in TIERS),
        ),
    ),
    Claim(
        "docs/swimming_on.md",
        "The agent keeps {:.0f}% of the ceiling's way after severe damage, and {:.0f}% or more "
        "after moderate and mild. What is left is not recognition: the oracle keeps {:.0f}% to "
        "{:.0f}%.",
        (CEILING[0], math.floor(min(CEILING[1:])), min(ORACLES), max(ORACLES)),
    ),
    Claim(
        "docs/swimming_on.md",
        "the agent keeps {:.0f}% of the oracle's pace, and is right in {} episodes",
        (
            100.0 * number(f"{LEAGUE}/three-faults.md", "three faults", "pace, of the oracle's"),
            cell(f"{LEAGUE}/three-faults.md", "three faults", "right"),
        ),
    ),
    Claim(
        "docs/swimming_on.md",
        "right in {}. They leave {:.0%} of the pace that the same fault leaves after 15 s.",
        (
            cell(f"{LEAGUE}/early.md", "early", "right"),
            number(f"{LEAGUE}/early.md", "early", "pace, units/s")
            / number(f"{LEAGUE}/early.md", "after 15 s", "pace, units/s"),
        ),
    ),
    Claim(
        "docs/swimming_on.md",
        "**A current that begins**: found within 0.03 units/s in {} episodes",
        (cell(f"{LEAGUE}/current-begins.md", "current begins", "right"),),
    ),
    Claim(
        "docs/swimming_on.md",
        "the agent gains {:.1f} units over blind and keeps {:.0f}% of the oracle's pace",
        (
            number(f"{LEAGUE}/held-out.md", "blind", "lost, held-out")
            - number(f"{LEAGUE}/held-out.md", HERO, "lost, held-out"),
            100.0
            * number(f"{LEAGUE}/held-out-recognition.md", "held-out", "pace, of the oracle's"),
        ),
    ),
    Claim(
        "docs/swimming_on.md",
        "after severe damage the agent returns in time in {:g}% of the episodes, blind in {:g}%",
        tuple(number(f"{LEAGUE}/return.md", who, "success, severe") for who in (HERO, "blind")),
    ),
    Claim(
        "docs/swimming_on.md",
        "{:.2f} units after severe damage in MuJoCo's box water, {:.2f} with added mass, {:.2f} "
        "among vortices",
        tuple(
            number(f"{LEAGUE}/waters-severe.md", HERO, water)
            for water in ("mujoco", "reactive", "vortices")
        ),
    ),
    Claim(
        "docs/swimming_on.md",
        "with unknown fin angles recognising is worth {:.2f} units after severe damage, with the "
        "gyroscope alone {:.2f}.",
        tuple(
            number(f"{LEAGUE}/{table}.md", HERO, "gain over blind, severe")
            for table in ("imu", "gyroscope")
        ),
    ),
]
