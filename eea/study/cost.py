"""How much work a replicate is, to begin the longest first and to say how long the rest takes."""

from __future__ import annotations

from typing import NamedTuple

from eea.core.config import EEAConfig


class TrialCount(NamedTuple):
    """How many trials each part of a run simulates."""

    exploration: float
    estimation: float
    inference: float

    @property
    def total(self) -> float:
        """Of all three."""
        return self.exploration + self.estimation + self.inference


def asked_trials(config: EEAConfig) -> TrialCount:
    """Return how many trials a run of all its rounds asks for, at most.

    It is the exact number if no genome recurs and each round begins with new ones. What recurs
    is not simulated again, so that runs need fewer: see ``expected_trials``.
    """
    rounds, models = config.rounds, config.estimation.population
    exploration, out_of_band = config.exploration, config.out_of_band
    searches = 0
    if config.condition == "out-of-band":
        searches_a_round = -(-config.estimation.generations // out_of_band.period)
        # Round r can infer the angles of r - 1 earlier trials anew, `revisit` of them at most.
        full = min(out_of_band.revisit, rounds - 1)
        revisited = full * (full + 1) // 2 + full * (rounds - 1 - full)
        searches = searches_a_round * (rounds + revisited)
    poses = out_of_band.inner_population * out_of_band.inner_generations
    return TrialCount(
        exploration=(rounds - 1)
        * exploration.population
        * exploration.generations
        * (exploration.best_models or models),
        estimation=models * config.estimation.generations * rounds * (rounds + 1) // 2,
        inference=searches * poses * min(out_of_band.sampled_models or models, models),
    )


# Shares of the asked trials that were simulated with the default settings, 25 rounds of 256 steps
# on the half-fin target: Ideal 0.75 and 0.72, Out-of-Band 0.76, 0.74 and 0.81 (seed 1000).
NEW_ACTIONS = 0.76
NEW_MODELS = 0.74
NEW_POSES = 0.81


def expected_trials(config: EEAConfig) -> TrialCount:
    """Return about how many trials a run of all its rounds simulates.

    It takes the default operators' rate of recurring genomes. Under In-Band Inference nothing is
    known already: models begin anew from anywhere in the ranges.
    """
    asked = asked_trials(config)
    known = config.estimation.remember and config.condition != "in-band"
    return TrialCount(
        asked.exploration * NEW_ACTIONS,
        asked.estimation * (NEW_MODELS if known else 1.0),
        asked.inference * NEW_POSES,
    )


def cost(config: EEAConfig) -> float:
    """Return about how many steps of one body a replicate simulates."""
    return expected_trials(config).total * config.steps
