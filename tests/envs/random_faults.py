"""Random texts of faults of channels, for tests that compare ways to carry them out."""

from __future__ import annotations

import numpy as np

FACTORS = ("-2", "0", "0.3", "1.5")
NUMBERS = {
    "action": {
        "weak": FACTORS,
        "scale": FACTORS,
        "reversed": (),
        "seized": ("", "-0.7", "0.4"),
        "dead": (),
    },
    "observation": {
        "scale": FACTORS,
        "bias": ("-3", "0.1", "0.7"),
        "stuck": (),
        "dropped": (),
    },
}
TIMES = {"delay": ("1", "2", "3"), "hold": ("1.5", "2", "3.7")}  # in steps
SIZES = {"action": 2, "observation": 4}
LONGEST = 7  # steps of onsets, durations and growths
MOST_FAULTS = 5


def random_fault(rng: np.random.Generator, growing: bool) -> str:
    """Return the text of a fault of any word but noise, of channels of two actions and four senses.

    Only if ``growing`` it may grow.
    """
    side = str(rng.choice(list(NUMBERS)))
    words = NUMBERS[side] | TIMES
    word = str(rng.choice(list(words)))
    number = str(rng.choice(words[word])) if words[word] else ""
    first, last = sorted(rng.integers(0, SIZES[side], 2).tolist())
    part = str(rng.choice([side, f"{side}_{first}", f"{side}_{first}-{last}"]))
    times = ""
    if rng.random() < 0.7:
        times = f"@{rng.integers(0, LONGEST) + rng.choice([0.0, 0.4]):g}"
        if rng.random() < 0.5:
            times += f"+{rng.integers(1, LONGEST)}"
        if growing and word in ("weak", "scale", "bias") and rng.random() < 0.6:
            times += f"~{rng.uniform(0.5, LONGEST):.2f}"
    return f"{part}:{word}" + (f"={number}" if number else "") + times


def random_damages(rng: np.random.Generator, robots: int, growing: bool = True) -> list[str]:
    """Return texts of up to five faults for each of some robots."""
    return [
        "; ".join(random_fault(rng, growing) for _ in range(rng.integers(0, MOST_FAULTS + 1)))
        for _ in range(robots)
    ]
