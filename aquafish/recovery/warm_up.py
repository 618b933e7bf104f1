"""The smallest runs of the self-models that compile all their kernels."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from eea.core.config import Config, JointConfig
from eea.fish import EngineSimulator, fish_problem
from eea.fish.joint import fish_joint


def warmup_config(config: Config) -> Config:
    """Return settings of a short run that compiles everything that a run with ``config`` needs.

    The alternative hypotheses of joint inference, whose fit takes ten seconds, are simulated here.
    """
    if isinstance(config, JointConfig):
        _simulate_hypotheses(config.steps)
        return JointConfig(
            steps=config.steps, rounds=2, bodies=4, poses=4, descents=2, polished=1, restarts=0,
            alternatives="never",
        )  # fmt: skip
    return replace(
        config,
        rounds=2,
        exploration=replace(config.exploration, generations=1),
        estimation=replace(config.estimation, generations=1),
        out_of_band=replace(config.out_of_band, inner_generations=1, revisit=0),
    )


@cache
def _simulate_hypotheses(steps: int) -> None:
    """Simulate a fish under each hypothesis, its servos late or not, in both precisions."""
    joint = fish_joint(fish_problem(), EngineSimulator(steps, threads=1))
    still = np.zeros((len(joint.hypotheses), 3))
    bodies = np.zeros((len(still), 9))
    for lag in (0.0, 0.1):
        nuisances = [
            [h.fixed.get(n.name, lag if n.name == "lag" else n.nominal) for n in joint.nuisances]
            for h in joint.hypotheses
        ]
        for fine in (False, True):
            joint.simulate(bodies, np.array(nuisances), still, still, fine)
