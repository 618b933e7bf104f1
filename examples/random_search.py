"""A method of one's own for ``aquafish study``: random search.

    aquafish study --method examples.random_search:random_search --conditions out-of-band joint \
        --preset smoke --held-out --replicates 10 --rounds 5 --out out/method

Random bodies are simulated in every trial, each from several random poses of the fins. The best one
by the paper's fitness (Eqs. 2 and 3) is the answer of a round.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from eea import RecordedLog, fish_problem
from eea.core.behavior import similarity, summarize
from eea.study.method import MethodSettings, MethodTarget

BODIES = 200
POSES = 10  # of each body in each trial, of which the best counts


def random_search(
    target: MethodTarget, rounds: int, seed: int, settings: MethodSettings
) -> Iterator[NDArray[np.float64]]:
    """Yield the best of random bodies (9,), in units of 5 cm, after each of some trials."""
    rng = np.random.default_rng(seed)
    problem = fish_problem(settings.plan)
    sizes, speeds = problem.models, problem.actions
    bodies = sizes.low + sizes.span * rng.random((BODIES, len(sizes)))
    fitness = np.zeros(BODIES)
    for _ in range(rounds):
        command = speeds.low + speeds.span * rng.random(len(speeds))
        observed = summarize(RecordedLog(target.perform(command)))
        count = BODIES * POSES
        logs = settings.simulate(
            bodies.repeat(POSES, axis=0),
            np.tile(command, (count, 1)),
            rng.uniform(-np.pi, np.pi, (count, len(problem.hidden))),
        )
        alike = similarity(summarize(RecordedLog(logs)), observed)  # Eq. 2
        fitness += alike.reshape(BODIES, POSES).max(axis=1)  # Eq. 3, but for the number of trials
        yield bodies[fitness.argmax()]
