"""What the pages of docs/environments say in numbers."""

from __future__ import annotations

from tests.docs.committed import Claim, document, fish_fitness, number

SCORES = "results/scores/table.md"
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
        "PPO with known fin angles is best ({:.0f}, three to four points in a minute)",
        (number(SCORES, "AquaFishWaypoint-v0|PPO, fins", "whole"),),
    ),
    Claim(
        "docs/environments/scores.md",
        "Severe damage costs PPO, CMA-ES and NEAT {:.0%} to {:.0%}",
        (min(SEVERE_LOSSES), max(SEVERE_LOSSES)),
    ),
]
