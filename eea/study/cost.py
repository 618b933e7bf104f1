"""How much work a replicate is, to begin the longest first and to say how long the rest takes."""

from __future__ import annotations

from eea.core.config import EEAConfig

# Shares of the asked trials that were simulated with the default settings, 25 rounds of 256 steps
# on the half-fin target: Ideal 0.75 and 0.72, Out-of-Band 0.76, 0.74 and 0.81 (seed 1000).
NEW_ACTIONS = 0.76
NEW_MODELS = 0.74
NEW_POSES = 0.81
# Of joint inference, for each trial so far: 31,000 in each of three rounds of 256 steps with the
# default settings on that target, less the scan, for each of 24 descents (seed 1).
A_DESCENT = 900


def asked_trials(config: EEAConfig) -> tuple[int, int, int]:
    """Return how many trials exploration, estimation and inference ask for in all rounds, at most.

    It is the exact number if no genome recurs and each round begins with new ones; what recurs
    is not simulated again.
    """
    rounds, models = config.rounds, config.estimation.population
    out_of_band = config.out_of_band
    searches = 0
    if config.condition == "out-of-band":
        searches_a_round = -(-config.estimation.generations // out_of_band.period)
        # Round r can infer the angles of r - 1 earlier trials anew, `revisit` of them at most.
        searches = searches_a_round * sum(1 + min(out_of_band.revisit, r) for r in range(rounds))
    poses = out_of_band.inner_population * out_of_band.inner_generations
    return (
        _asked_for_commands(config),
        models * config.estimation.generations * rounds * (rounds + 1) // 2,
        searches * poses * min(out_of_band.sampled_models or models, models),
    )


def _asked_for_commands(config: EEAConfig) -> int:
    """Return how many trials the choices of commands ask for; before the first there is none."""
    models = config.exploration.best_models or config.estimation.population
    return (
        (config.rounds - 1)
        * config.exploration.population
        * config.exploration.generations
        * models
    )


def expected_trials(config: EEAConfig) -> float:
    """Return about how many trials a run of all its rounds simulates."""
    if config.condition == "joint":
        fit = config.joint.bodies * config.joint.poses + A_DESCENT * config.joint.descents
        return fit * config.rounds * (config.rounds + 1) / 2
    actions, models, poses = asked_trials(config)
    # Under In-Band Inference models begin anew from anywhere in the ranges: nothing is known yet.
    known = config.estimation.remember and config.condition != "in-band"
    return NEW_ACTIONS * actions + (NEW_MODELS if known else 1.0) * models + NEW_POSES * poses


def cost(config: EEAConfig) -> float:
    """Return about how many steps of one body a replicate simulates."""
    return expected_trials(config) * config.steps
