"""Rivals of the recovery league that have no model of themselves: they try gaits on the robot.

They know more than the others. The league passes the robot's true position along +y to ``measure``
after each step, as motion capture would.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish.online.gaits import load_library
from aquafish_gym.utils.storage import read_document
from experiments.league.archive import SCHEMA, varied
from experiments.league.policy import DT, FixedGait, Offline
from gait.controllers.controller import Controller

Floats = NDArray[np.float64]

# Between these two actions it learns which pace to expect.
SETTLED = 25
CALIBRATED = 75
WINDOW = 15  # actions over which a pace is measured
SHARE = 0.8  # of the expected pace, below which an alarm is raised
TRIAL = 20  # actions of a trial
SKIPPED = 5  # first actions of a trial, a transition, that do not count
# Intelligent Trial and Error, as in the paper: the kernel's length scale and noise, the weight of
# the uncertainty, and the share of the best prediction at which it stops.
LENGTH = 0.4
NOISE = 0.001
KAPPA = 0.05
ALPHA = 0.9
# Of the direct search: step size, its factor after a success, and trials.
SIGMA = 0.3
LARGER = 1.5
TRIALS = 5


class TrialAgent(ABC):
    """An agent that tries gaits for a few seconds each once its pace falls.

    It knows the initial fin angles and reckons them from its commands. In a search a subclass
    proposes gaits and learns their paces; after it, the robot swims the best.

    Parameters
    ----------
    first
        The gait before something breaks.
    """

    def __init__(self, first: Controller) -> None:
        self._first = first

    def begin(self, fin_angles: ArrayLike | None) -> None:
        """Begin an episode."""
        self._agent = FixedGait(self._first)
        self._agent.begin(fin_angles)
        self._way = [0.0]
        self.events: list[tuple[float, str, str]] = []
        self._expected = -np.inf
        self._trying = False
        self._began = 0

    def act(self, observation: ArrayLike) -> ArrayLike:
        """Return the present gait's action."""
        return self._agent.act(observation)

    def measure(self, y_position: float) -> None:
        """Measure how far the robot is along +y after a step, in units."""
        self._way.append(y_position)
        now = len(self._way) - 1
        since = now - self._began
        if self._trying:
            if since == TRIAL:
                self._end_trial(self._pace(TRIAL - SKIPPED))
        elif now == CALIBRATED:
            self._expected = self._pace(CALIBRATED - SETTLED)
        elif since >= WINDOW and self._pace(WINDOW) < SHARE * self._expected:
            self._log("alarm", f"slower than {SHARE * self._expected:.2f} units/s")
            self.restart(self._pace(WINDOW))
            self._try(self.propose())

    def _pace(self, actions: int) -> float:
        return (self._way[-1] - self._way[-1 - actions]) / (DT * actions)

    def _end_trial(self, pace: float) -> None:
        self.learn(pace)
        self._log("tried", f"{pace:.3f} units/s")
        self._try(self.propose())

    def _try(self, gait: Controller | None) -> None:
        if gait is None:
            self._trying = False
            best, self._expected = self.best()
            self._log("chose", f"{self._expected:.3f} units/s")
            self._swim(best)
        else:
            self._trying = True
            self._swim(gait)

    def _swim(self, gait: Controller) -> None:
        fin_angles = self._agent.fin_angles
        self._agent = FixedGait(gait)
        self._agent.begin(fin_angles)
        self._began = len(self._way) - 1

    def _log(self, what: str, about: str) -> None:
        self.events.append((DT * (len(self._way) - 1), what, about))

    @abstractmethod
    def restart(self, pace: float) -> None:
        """Begin a search, with the pace of the present gait, units/s."""

    @abstractmethod
    def propose(self) -> Controller | None:
        """Return the next gait to try; None ends the search."""

    @abstractmethod
    def learn(self, pace: float) -> None:
        """Learn the pace, units/s, of the gait proposed last."""

    @abstractmethod
    def best(self) -> tuple[Controller, float]:
        """Return the best gait that was tried, and its pace."""


class TrialAndError(TrialAgent):
    """Intelligent Trial and Error (Cully, Clune, Tarapore and Mouret, Nature 521, 2015).

    Gaits are chosen by Bayesian optimisation: a Gaussian process (Matern 5/2) of their descriptors
    whose prior mean is their pace on the whole robot, and the upper confidence bound.

    Parameters
    ----------
    gaits
        N gaits; the first is swum until something breaks.
    paces, descriptors
        (N,) units/s on the whole robot, and (N, 3).
    """

    def __init__(self, gaits: Sequence[Controller], paces: Floats, descriptors: Floats) -> None:
        super().__init__(gaits[0])
        self._gaits = gaits
        self._paces = paces
        self._descriptors = descriptors

    def begin(self, fin_angles: ArrayLike | None) -> None:
        """Begin an episode."""
        super().begin(fin_angles)
        self._present = 0

    def restart(self, pace: float) -> None:
        """Forget the paces that were measured before."""
        self._tried = [self._present]
        self._found = [pace]

    def propose(self) -> Controller | None:
        """Return the gait with the highest bound, unless a tried one is nearly the best."""
        mean, deviation = predict(self._paces, self._descriptors, self._tried, self._found)
        if max(self._found) >= ALPHA * mean.max():
            return None
        self._tried.append(int(np.argmax(mean + KAPPA * deviation)))
        return self._gaits[self._tried[-1]]

    def learn(self, pace: float) -> None:
        """Keep the pace."""
        self._found.append(pace)

    def best(self) -> tuple[Controller, float]:
        """Return the fastest gait that was tried, and its pace."""
        top = int(np.argmax(self._found))
        self._present = self._tried[top]
        return self._gaits[self._present], self._found[top]


def predict(
    prior: Floats, descriptors: Floats, tried: Sequence[int], found: Sequence[float]
) -> tuple[Floats, Floats]:
    """Return mean and standard deviation (N,) of the paces of N gaits, of which some were tried."""
    apart = np.linalg.norm(descriptors[:, None] - descriptors[list(tried)], axis=2)
    scaled = np.sqrt(5.0) * apart / LENGTH
    kernel = (1.0 + scaled + scaled**2 / 3.0) * np.exp(-scaled)  # (N, T)
    known = kernel[list(tried)] + NOISE * np.eye(len(tried))
    gain = np.linalg.solve(known, kernel.T).T
    mean = prior + gain @ (np.array(found) - prior[list(tried)])
    variance = 1.0 - np.sum(gain * kernel, axis=1)
    return mean, np.sqrt(np.maximum(variance, 0.0))


class DirectSearch(TrialAgent):
    """A (1+1) evolution strategy on the robot itself, with the 1/5 success rule.

    It varies six numbers: for each servo the logarithm of a factor of the gait's output weights,
    and an addition to their bias. After ``TRIALS`` trials it swims the best.
    """

    def __init__(self, first: Controller, seed: int = 0) -> None:
        super().__init__(first)
        self._seed = seed

    def begin(self, fin_angles: ArrayLike | None) -> None:
        """Begin an episode."""
        super().begin(fin_angles)
        self._rng = np.random.default_rng(self._seed)
        self._base = self._first
        self._parent: Floats = np.zeros(6)

    def restart(self, pace: float) -> None:
        """Begin at the present gait."""
        self._base = scaled(self._base, self._parent)
        self._parent = np.zeros(6)
        self._sigma = SIGMA
        self._fastest = pace
        self._trials = 0

    def propose(self) -> Controller | None:
        """Return a variation of the best so far."""
        self._trials += 1
        self._child = self._parent + self._sigma * self._rng.standard_normal(6)
        return scaled(self._base, self._child) if self._trials <= TRIALS else None

    def learn(self, pace: float) -> None:
        """Keep the variation if it is faster, and adapt the step size."""
        if pace > self._fastest:
            self._sigma *= LARGER
            self._parent = self._child
            self._fastest = pace
        else:
            self._sigma *= LARGER**-0.25

    def best(self) -> tuple[Controller, float]:
        """Return the fastest variation, and its pace."""
        return scaled(self._base, self._parent), self._fastest


def scaled(gait: Controller, numbers: Floats) -> Controller:
    """Return a gait with other output weights, see :class:`DirectSearch`."""
    factor = np.exp(numbers[:3])
    more = numbers[3:]
    weights = gait.weights.copy()
    bias = gait.bias.copy()
    weights[-3:] *= factor[:, None]
    bias[-3:] = bias[-3:] * factor + more
    return replace(gait, weights=weights, bias=bias)


@cache
def load_archive(path: Path) -> tuple[tuple[Controller, ...], Floats, Floats, Offline]:
    """Return gaits, paces (N,), descriptors (N, 3), and what they took, of an archive.

    ``PPO, fins`` is the first gait; ``experiments.league.archive`` made the others.
    """
    data = read_document(path, SCHEMA, "archive")
    first = data["first"]
    gait = load_library()[0]
    return (
        (gait, *(varied(gait, np.array(x)) for x in data["vectors"])),
        np.array([first["pace"], *data["paces"]]),
        np.array([first["descriptor"], *data["descriptors"]]),
        Offline(**data["offline"]),
    )
