"""The search of the league's ceiling: a gait for what broke, in five CPU minutes.

The search knows the robot and its state at the onset, and simulates it as the environment does. So
the way that it predicts is the way that the robot makes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aquafish.online.gaits import imagine
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.array_types import Floats
from gait.controllers.controller import Controller
from gait.search.ask_tell import Stages, halve
from gait.search.cma import REFINING, SIGMA, Strategy
from gait.search.templates import Template

# Full covariance matrices are no better here: from the library's best gait, in 20 CPU s on two
# severe development episodes, they end at 30.86 and 23.19 units, diagonal ones at 30.99 and 23.48.
# Nor are twelve hidden nodes instead of six, at 30.69 units.
POPULATION = 64
RANDOM_NETWORKS = 4096
RANDOM_STARTS = 8
LIBRARY_STARTS = 10  # each with both step sizes and two seeds
#: The numbers of searches, and of the generations that each then has: 27,200 generations in all, of
#: 64 swims of 30 to 45 s. That is 5e9 to 8e9 robot steps of 0.01 s, 5 CPU minutes.
STAGES: Stages = ((48, 150), (16, 500), (6, 2000))


def search_gait(
    library: Sequence[Controller], robot: Scenario, state: Floats, seconds: float, seed: int
) -> tuple[Controller, float]:
    """Return the gait that swims farthest along +y, and how far, in units.

    CMA-ES searches the weights, biases and clock of a recurrent network that senses the inertial
    measurement unit, its clock and its fins. It starts from the best of a library and of random
    networks. By successive halving, the best searches go on.

    Parameters
    ----------
    library
        Gaits, of which the recurrent ones are of one kind and have equally many nodes.
    robot
        A scenario of one.
    state
        (R,) in which all swims begin.
    seconds
        Their length.
    seed
        Of everything random.
    """
    rng = np.random.default_rng(seed)
    recurrent = [gait for gait in library if gait.memory]
    first = recurrent[0]
    template = Template.like(first)

    def build(vectors: Floats) -> list[Controller]:
        return template.controllers(vectors, first)

    def best_of(gaits: Sequence[Controller], count: int) -> list[Controller]:
        order = np.argsort(-imagine(gaits, robot, state, seconds), kind="stable")
        return [gaits[i] for i in order[:count].tolist()]

    hidden = first.nodes - len(first.plan.fins)
    network = Template.of_class("recurrent", first.senses, hidden, first.interval, first.plan)
    random = network.controllers(network.random(RANDOM_NETWORKS, rng), first)
    starts = [(gait, SIGMA) for gait in best_of(random, RANDOM_STARTS)]
    for gait in best_of(recurrent, LIBRARY_STARTS):
        starts += [(gait, REFINING), (gait, SIGMA)] * 2
    searches = []
    for (gait, sigma), own in zip(starts, rng.spawn(len(starts)), strict=True):
        vector = template.vector(gait)
        vector[0] = np.log2(gait.clock / first.clock)
        searches.append(Strategy(vector, build, POPULATION, own, sigma))
    best = first
    farthest = -np.inf
    for search, _ in halve(searches, STAGES):
        proposal = search.ask()
        gaits = [*proposal.controllers, *(proposal.finalists or ())]
        far = imagine(gaits, robot, state, seconds)
        leader = int(far.argmax())
        if far[leader] > farthest:
            farthest = float(far[leader])
            best = gaits[leader]
        search.tell(far[:POPULATION].tolist(), gaits[leader], float(far[leader]))
    return best, farthest
