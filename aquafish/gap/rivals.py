"""Two general optimisers on joint inference's own likelihood: CMA-ES, and a real-coded GA.

Both maximise what ``eea.joint`` maximises, over the same unknowns and by the same simulator at the
same precision, with fast commands; what differs is how they search. They need the extra "compare".
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats, wrap
from eea.core.behavior import similarity, summarize
from eea.core.checks import whole
from eea.core.config import EEAConfig
from eea.core.experiment import Context, Target
from eea.core.fitness import model_fitness
from eea.core.replay import RecordedLog
from eea.core.session import Answer, Conclusion, Session
from eea.joint.commands import fast_command
from eea.joint.least_squares import COARSE, FINE, Misfit, Observed
from eea.joint.parameters import Parameters
from eea.joint.problem import JointProblem
from eea.joint.search import LEAST_SIGMA

BODY_SD, ANGLE_SD = 0.3, np.pi / np.sqrt(3.0)  # of what is not known at all
KNOWN = 0.2  # of these, about what the trials before have taught
WORST = 1e30  # the cost of a robot that diverged
OFFSPRING = 64  # of CMA-ES's first descent: a batch that fills the lanes
GENOMES, CROSSOVER, CROSSOVER_ETA, MUTATION_ETA = 200, 0.9, 15.0, 20.0


class Likelihood:
    """-log posterior of vectors, up to a constant, and how many trials were simulated for it.

    Where the noise is not known it is the likeliest for each vector.
    """

    def __init__(self, parameters: Parameters, observed: Observed, noise: float | None) -> None:
        self.parameters = parameters
        self.trials = 0
        self._misfit = Misfit(parameters, observed, COARSE)
        self._noise = noise

    def __call__(self, theta: Floats) -> Floats:
        """Return the cost (S,) of vectors (S, P)."""
        self.trials += len(theta) * self.parameters.trials
        inside = self.inside(theta)
        squares, count = self._misfit.squares(inside), self._misfit.count
        if self._noise:
            cost = 0.5 * squares / self._noise**2
        else:
            cost = 0.5 * count * np.log(squares / count + LEAST_SIGMA**2)
        cost = cost + self.parameters.prior_cost(inside)
        return np.where(np.isfinite(cost), cost, WORST)

    def inside(self, theta: Floats) -> Floats:
        """Return vectors (..., P) in the box, as if its walls were mirrors; angles may turn."""
        shares = 1.0 - np.abs(1.0 - np.mod(theta, 2.0))
        return np.where(self.parameters.circular, wrap(theta), shares)

    def random(self, count: int, rng: np.random.Generator) -> Floats:
        """Return vectors (count, P): any body, any angles, nuisances as their priors have them."""
        parameters, (mean, sd) = self.parameters, self.prior
        theta = mean + sd * rng.standard_normal((count, len(mean)))
        theta[:, : parameters.body] = rng.random((count, parameters.body))
        turns = np.count_nonzero(parameters.circular)
        theta[:, parameters.circular] = rng.uniform(-np.pi, np.pi, (count, turns))
        return self.inside(theta)

    @property
    def prior(self) -> tuple[Floats, Floats]:
        """Mean and standard deviation (P,) of the prior; of a uniform one about what it has."""
        told = self.parameters.prior_precision > 0.0
        precision = np.where(told, self.parameters.prior_precision, 1.0)
        uniform = np.where(self.parameters.circular, ANGLE_SD, BODY_SD)
        sd = np.where(told, np.minimum(precision**-0.5, BODY_SD), uniform)
        return self.parameters.prior_mean, sd


class Start(NamedTuple):
    """What the trials before have taught."""

    theta: Floats  #: Shape (K, P), the best first; what is new in them is random.
    known: NDArray[np.bool_]  #: Which entries (P,) are not new.


class Found(NamedTuple):
    """What a search has come to."""

    theta: Floats  #: The best vector (P,).
    population: Floats  #: The last one (N, P).


# Searches with so many trials, or a few more.
Search = Callable[[Likelihood, Start | None, np.random.Generator, int], Found]


def cma_es(cost: Likelihood, start: Start | None, rng: np.random.Generator, budget: int) -> Found:
    """Search by CMA-ES, with restarts of doubled populations (Auger and Hansen 2005).

    The first descent begins at ``start``, the others anywhere.
    """
    import cma

    best, least, population, size = np.empty(0), np.inf, np.empty((0, 0)), OFFSPRING
    while cost.trials < budget:
        (_, sd), first = cost.prior, cost.random(1, rng)[0]
        if start is not None:
            first, sd = start.theta[0], np.where(start.known, KNOWN, 1.0) * sd
        options = {
            "CMA_stds": sd,
            "popsize": size,
            "tolfun": 1e-3,  # what is less in a log posterior says nothing
            "randn": lambda *shape: rng.standard_normal(shape),
            "seed": np.nan,  # leaves numpy's global stream alone
            "verbose": -10,
            "verb_log": 0,
        }
        strategy = cma.CMAEvolutionStrategy(first, 1.0, options)
        while not strategy.stop() and cost.trials < budget:
            asked = strategy.ask()
            population = np.array(asked)
            values = cost(population)
            strategy.tell(asked, values.tolist())
            if values.min() < least:
                least, best = values.min(), population[values.argmin()]
        start, size = None, 2 * size
    return Found(cost.inside(best), cost.inside(population))


def genetic(cost: Likelihood, start: Start | None, rng: np.random.Generator, budget: int) -> Found:
    """Search by a real-coded GA: simulated binary crossover, polynomial mutation, the best stay.

    Half of the first generation is ``start``'s, the rest is random (Deb and Agrawal 1995).
    """
    from deap import tools

    parameters = cost.parameters
    low = np.where(parameters.circular, -np.pi, 0.0).tolist()
    high = np.where(parameters.circular, np.pi, 1.0).tolist()
    population = cost.random(GENOMES, rng)
    if start is not None:
        half = start.theta[: GENOMES // 2]
        population[: len(half)] = half
    values = cost(population)
    with _global_random(rng):
        while cost.trials < budget:
            # Two by two, the better one is a parent.
            pairs = np.concatenate([rng.permutation(GENOMES), rng.permutation(GENOMES)])
            pairs = pairs.reshape(-1, 2)
            chosen = pairs[np.arange(GENOMES), values[pairs].argmin(axis=1)]
            children = population[chosen].tolist()
            for one, other in zip(children[::2], children[1::2], strict=True):
                if random.random() < CROSSOVER:
                    tools.cxSimulatedBinaryBounded(one, other, CROSSOVER_ETA, low, high)
            for child in children:
                tools.mutPolynomialBounded(child, MUTATION_ETA, low, high, 1.0 / len(low))
            both = np.concatenate([population, np.array(children)])
            costs = np.concatenate([values, cost(both[GENOMES:])])
            order = np.argsort(costs, kind="stable")[:GENOMES]
            population, values = both[order], costs[order]
    return Found(population[0], population)


#: By the names of their methods.
RIVALS: dict[str, Search] = {"cma-es": cma_es, "ga": genetic}
PACKAGES = {"cma-es": "cma", "ga": "deap"}


class Rival(Session):
    """Finds the likeliest body, nuisances and hidden angles of all trials by some search.

    Parameters
    ----------
    target, joint, config, seed, truth
        As for ``eea.joint.inference.JointInference``; of ``config.joint`` the nuisances, which
        all trials share, and the noise have a say.
    search
        One of ``RIVALS``.
    budget
        Trials that may be simulated in a round for each trial that the target has performed: so
        many vectors are tried.

    Raises
    ------
    ConfigurationError
        If a setting is wrong.
    """

    def __init__(
        self,
        target: Target,
        joint: JointProblem,
        config: EEAConfig,
        seed: int = 0,
        truth: Floats | None = None,
        *,
        search: Search,
        budget: int,
    ) -> None:
        super().__init__(target, joint.problem, config, seed, truth)
        whole("budget", budget, 1)
        self._joint, self._search, self._budget = joint, search, budget
        self._observed = Observed(
            np.empty((0, len(joint.problem.actions))),
            np.empty((0, config.steps, joint.problem.axes)),
        )
        self._population: Floats | None = None
        self._names: tuple[str, ...] = ()

    @contextmanager
    def _undone_if_broken_off(self) -> Iterator[None]:
        before = self._observed, self._population, self._names
        try:
            yield
        except BaseException:
            self._observed, self._population, self._names = before
            raise

    def _round(self) -> tuple[Answer, Conclusion]:
        settings, problem = self.result.config.joint, self._problem
        done, exploring = self._observed.commands, self._rngs["exploration"]
        answer = self._perform(fast_command(problem.actions, done, exploring))
        self._observed = Observed(
            np.concatenate([self._observed.commands, answer.command[None]]),
            np.concatenate([self._observed.signal, answer.samples[None]]),
        )
        groups = self._joint.groups if settings.nuisances is None else settings.nuisances
        parameters = Parameters.of(self._joint, len(self._observed), groups)
        cost, rng = Likelihood(parameters, self._observed, settings.noise), self._rngs["estimation"]
        start = self._start(cost, rng)
        theta, population = self._search(cost, start, rng, self._budget * len(self._observed))
        self._population = np.concatenate([theta[None], population])
        self._names = parameters.names
        return answer, Conclusion(
            None,
            parameters.models(theta),
            self._model_fitness(parameters, theta),
            Context.known(theta[parameters.angle_entries(len(self._observed) - 1)]),
            population[:, : parameters.body].std(axis=0),
            cost.trials,
        )

    def _start(self, cost: Likelihood, rng: np.random.Generator) -> Start | None:
        """Return what is known of fewer trials, with the newest one's angles anywhere."""
        if self._population is None:
            return None
        theta, column = cost.random(len(self._population), rng), self._names.index
        known = np.array([name in self._names for name in cost.parameters.names])
        for i in np.flatnonzero(known):
            theta[:, i] = self._population[:, column(cost.parameters.names[i])]
        return Start(theta, known)

    def _model_fitness(self, parameters: Parameters, theta: Floats) -> float:
        """Return the MOD_FIT (Eq. 3) of a vector (P,), its angles and nuisances included."""
        observed, config = self._observed.signal, self.result.config.behavior
        apart = Misfit(parameters, self._observed, FINE).residuals(theta[None])[0]
        simulated = summarize(RecordedLog(gyro=observed + apart.reshape(observed.shape)), config)
        felt = summarize(RecordedLog(gyro=observed), config)
        return float(model_fitness(similarity(simulated, felt, config)))


@contextmanager
def _global_random(rng: np.random.Generator) -> Iterator[None]:
    """Seed Python's global stream, which DEAP draws from, and put it back afterwards."""
    before = random.getstate()
    random.seed(int(rng.integers(2**63)))
    try:
        yield
    finally:
        random.setstate(before)
