"""The words of a run that takes a second."""

from __future__ import annotations

QUICK = [
    "run",
    *("--condition", "none", "--steps", "32", "--rounds", "2", "--target-engine", "numba"),
    *("--exploration.population", "6", "--exploration.generations", "3"),
    *("--estimation.population", "8", "--estimation.generations", "5"),
    *("--target-damage", "left_pectoral:length=0.5"),
]
