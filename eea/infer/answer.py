"""The joint posterior: hypotheses, each with a posterior over all unknowns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from eea.core.angles import Floats, wrap
from eea.core.checks import ConfigurationError, TargetError, choice, instance, real, whole
from eea.core.floating import own_errors
from eea.core.result import handed_on
from eea.infer.branch import INTERVAL_SAMPLES, Branch, mixed, rivals
from eea.infer.design import Identified, Prospect, identified, prospects
from eea.infer.goodness import Goodness
from eea.infer.misfit import Roughness
from eea.infer.mixture import holding, intervals
from eea.infer.optima import Optima
from eea.infer.statement import RobotModel
from eea.infer.trials import Noise, Trial
from eea.infer.words import (
    at_ends,
    beyond_range,
    faults,
    findings,
    fits_of,
    of_simulator,
    of_turns,
    several,
    undecided,
    unnoticed,
)

if TYPE_CHECKING:
    from eea.infer.known import Known

MAXIMUM_SAMPLES = 10**7


@dataclass(frozen=True, eq=False)
class WarmStart:
    """Warm start: results of one fit that the fit of more trials starts from."""

    #: Optima of all fits so far, by hypothesis.
    optima: Mapping[str, Optima] = field(default_factory=dict)
    dropped: frozenset[str] = frozenset()  #: Hypotheses that are not fitted again.
    explained: bool = True  #: Whether the nominal fit left nothing but noise.
    robots: int = 0  #: Number of trials that the fit simulated.
    roughness: Roughness | None = None  #: That of the simulator, as far as it was looked at.


@dataclass(frozen=True, eq=False)
class Answer:
    """A posterior over a robot's numbers and hypotheses.

    Samples and intervals mix all hypotheses, in proportion to their probabilities, and include
    model discrepancy. The medians, the probabilities and the findings assume that the
    simulator is right.
    """

    branches: tuple[Branch, ...]  #: Fits of the hypotheses, the most probable first.
    #: Goodness of the best fit. If it is not good, reports and files have no intervals.
    goodness: Goodness
    sigma: float  #: Standard deviation of the noise, in the signal's units, given or estimated.
    samples: int  #: Number of samples behind the estimate ``sigma``; 0 if it was given.
    #: Warm start of the next fit; None for a posterior from a file.
    warm_start: WarmStart | None = field(default=None, repr=False)
    #: Of each channel, of which ``sigma`` is a multiple; None where all have the same.
    noise: Noise | None = None
    caveats: tuple[str, ...] = ()  #: Sentences on what was assumed, the last findings.
    #: What ended the search before its time, such as a budget; empty where it was completed.
    ended: str = ""
    #: What was learned from known-good logs, if anything: by it the trials were inferred.
    learned: Known | None = field(default=None, repr=False)

    @property
    def robot(self) -> RobotModel:
        """The robot."""
        return self.branches[0].parameters.robot

    @property
    def best_fit(self) -> Optima:
        """The best fits of the most probable hypothesis; a posterior from a file has none."""
        if self.warm_start is None:
            raise TargetError("a posterior that was read from a file has no fit")
        return self.warm_start.optima[self.branches[0].hypothesis.name]

    def sample(self, count: int, rng: np.random.Generator) -> Floats:
        """Return parameters (count, n) drawn from the posterior, in natural units.

        They are input of other searches, so each is rounded to 1e-4 of its range.
        """
        whole("count", count, 1, MAXIMUM_SAMPLES)
        instance("rng", rng, np.random.Generator)
        return handed_on(self._drawn(count, rng), self.robot.low, self.robot.span)

    @own_errors
    def _drawn(self, count: int, rng: np.random.Generator) -> Floats:
        """Return robots' parameters (count, n), in random order."""

        def draw(branch: Branch, times: int) -> Floats:
            return branch.parameters.models(branch.doubted.sample(times, rng))

        return rng.permutation(mixed(self.branches, count, rng, draw))

    @cached_property
    def _robots(self) -> Floats:
        return self._drawn(INTERVAL_SAMPLES, np.random.default_rng(0))

    @cached_property
    @own_errors
    def model(self) -> Floats:
        """The median parameters (n,) inside the model."""
        rng = np.random.default_rng(0)

        def draw(branch: Branch, times: int) -> Floats:
            return branch.parameters.models(branch.posterior.sample(times, rng))

        return np.asarray(np.median(mixed(self.branches, INTERVAL_SAMPLES, rng, draw), axis=0))

    @property
    def spread(self) -> Floats:
        """The standard deviation in each dimension (n,), as a share of its range."""
        spread: Floats = self._robots.std(axis=0) / self.robot.span
        return spread

    @own_errors
    def interval(self, mass: float = 0.9) -> tuple[Floats, Floats]:
        """Return the ends (n,) of each dimension's interval, which holds the median.

        See ``eea.infer.mixture.intervals``. They are valid if some robot explains the
        trials: check ``good``.
        """
        robot = self.robot
        straight = np.zeros(len(robot.sought), dtype=np.bool_)
        low, high = intervals(self._robots, robot.low, robot.high, straight, mass)
        return holding(low, high, self.model, straight)[:2]

    def probability(self, hypothesis: str) -> float:
        """Return the probability of a hypothesis by its name; 0 if it was not worth a fit."""
        known = [h.name for h in (self.robot.nominal, *self.robot.alternatives)]
        choice("hypothesis", hypothesis, known)
        return sum(b.probability for b in self.branches if b.hypothesis.name == hypothesis)

    @own_errors
    def broken(self, name: str, mass: float = 0.9) -> tuple[float, float, float] | None:
        """Return the median and the interval of a number, given that it has changed.

        The mixture of all hypotheses has "nothing is broken" in it, whose value is a point. This is
        of the hypotheses that move the number; None where none was fitted. One that varies from
        trial to trial is that of the first. An angle's interval may end beyond pi.
        """
        choice("name", name, {n: 0 for h in self.robot.alternatives for n in h.moves})
        real("mass", mass, 0.0, 1.0)
        moved = [b for b in self.branches if name in b.hypothesis.moves and b.probability > 0]
        if not moved:
            return None
        rng = np.random.default_rng(0)

        def draw(branch: Branch, times: int) -> Floats:
            theta = branch.doubted.sample(times, rng)
            return branch.parameters.natural(theta)[:, branch.parameters.first_entry(name)]

        drawn = mixed(moved, INTERVAL_SAMPLES, rng, draw)
        if self.robot.table[name].circular:
            mean = np.angle(np.exp(1j * drawn).sum())
            drawn = mean + wrap(drawn - mean)
        ends = [0.5 - mass / 2, 0.5, 0.5 + mass / 2]
        low, middle, high = np.quantile(drawn, ends).tolist()
        return middle, low, high

    @own_errors
    def table(
        self, mass: float = 0.9, hypothesis: str | None = None
    ) -> dict[str, tuple[float, float, float]]:
        """Return the median and the interval of everything, by name, in natural units.

        Numbers of trial e have ``@e`` after their names, from 1. They are those of the most
        probable hypothesis, or of another by its name. An interval holds its median; that of an
        angle may end beyond pi. Where several hypotheses may hold, and a number that all trials
        share differs among them, its interval is that of all, unless the robot has parts.
        """
        if hypothesis is None:
            table = self.branches[0].table(mass)
            return table if self.robot.parts else {**table, **self._of_rivals(table, mass)}
        fitted = {branch.hypothesis.name: branch for branch in self.branches}
        choice("hypothesis", hypothesis, fitted)
        return fitted[hypothesis].table(mass)

    def _of_rivals(
        self, table: Mapping[str, tuple[float, float, float]], mass: float
    ) -> dict[str, tuple[float, float, float]]:
        """Return the rows of a table that differ among the hypotheses that may hold."""
        others = rivals(self.branches)
        differ = dict.fromkeys(name for some in others.values() for name in some)
        names = [name for name in differ if name in table]
        if not names:
            return {}
        likely = [b for b in self.branches if b is self.branches[0] or b.hypothesis.name in others]
        rng = np.random.default_rng(0)

        def draw(branch: Branch, times: int) -> Floats:
            values = branch.parameters.local(branch.doubted.sample(times, rng))[:, 0]
            return np.array([branch.parameters.values(values)[name] for name in names]).T

        drawn = mixed(likely, INTERVAL_SAMPLES, rng, draw)
        numbers = [self.robot.table[name] for name in names]
        low = np.array([one.low for one in numbers])
        high = np.array([one.high for one in numbers])
        straight = np.zeros(len(names), np.bool_)
        low, high = intervals(drawn, low, high, straight, mass)
        middle = np.array([table[name][0] for name in names])
        rows = np.stack(holding(low, high, middle, straight))[[2, 0, 1]].T
        return dict(zip(names, map(tuple, rows.tolist()), strict=True))

    @own_errors
    def identified(self) -> Identified:
        """Return which numbers the trials determine, and which only in combination.

        To first order at the best fit of the most probable hypothesis: sums of multiples stand for
        what else numbers have in common. State a robot by numbers on which its signal depends
        linearly, where there are such numbers. Hidden angles and what differs from trial to trial
        is left out. See :mod:`eea.infer.design`.
        """
        return identified(self.best_fit)

    @own_errors
    def prospects(self, trials: Mapping[str, Trial]) -> dict[str, Prospect]:
        """Return what each of some trials would tell if it was performed next, the best first.

        The values in a trial's ``signal`` do not matter, only where there will be samples. The
        trial is imagined at the best fit, its angles at 0 and its own numbers at their means.

        Raises
        ------
        ConfigurationError
            If there is none, or one has other channels than the robot.
        """
        return prospects(self.best_fit, self.branches[0].hypothesis, trials)

    def known(self, robot: RobotModel | None = None) -> Known:
        """Return what is known of the robot from now on: of the most probable hypothesis.

        Angles are left out, for they may have changed since.

        Parameters
        ----------
        robot
            The same robot with other numbers of each trial, such as one in mid-swim; None for that
            of the trials.

        Raises
        ------
        ConfigurationError
            If no robot explains the trials, or several answers do alike, or hypotheses with other
            values of a number: another trial must tell them apart (:meth:`prospects`). If ``robot``
            has other channels, or other numbers than the trials told.
        """
        from eea.infer.known import Known

        if robot is not None:
            instance("robot", robot, RobotModel)
        if not self.good:
            raise ConfigurationError(f"an answer must be good to be known; got: {self.verdict}")
        if said := several(self.branches[0]) + undecided(self.branches):
            raise ConfigurationError(f"an answer must be one to be known; got: {said[0]}")
        return Known.of(self, robot)

    def angles(self, trial: int, mass: float = 0.9) -> tuple[Floats, Floats]:
        """Return the ends (h,) of the intervals of a trial's hidden angles, rad.

        The first trial is 0.

        Raises
        ------
        ConfigurationError
            If there is no such trial.
        """
        best = self.branches[0].parameters
        whole("trial", trial, 0, len(best.slots) - 1)
        table = self.table(mass)
        rows = [table[best.names[entry]] for entry in best.angle_entries(trial)]
        return np.array([low for _, low, _ in rows]), np.array([high for _, _, high in rows])

    @property
    def good(self) -> bool:
        """Whether the best fit leaves nothing but noise, so that the intervals can be trusted."""
        return self.goodness.good and not self.ended

    @property
    def verdict(self) -> str:
        """A sentence on whether the best fit is good, with the reason."""
        if self.ended:
            return f"unfinished, by {self.ended}: so far {self.goodness.verdict}"
        return self.goodness.verdict

    @property
    def findings(self) -> list[str]:
        """The findings in sentences, most important first."""
        unfinished = [self.verdict] if self.ended else []
        return [*unfinished, *self._findings, *self.caveats]

    @cached_property
    @own_errors
    def _findings(self) -> list[str]:
        best = self.branches[0]
        if self.goodness.good and self.robot.parts:
            return findings(best.posterior, self.robot, fits_of(self.branches))
        limits: list[str] = []
        if not self.robot.parts:
            limits = several(best) + at_ends(best)
            if self.warm_start is not None:
                limits = of_turns(self.best_fit) + limits + of_simulator(self.best_fit)
        if self.goodness.good and self.robot.alternatives:
            said = limits + faults(fits_of(self.branches), self.robot)
            return said + unnoticed(self.branches)
        if self.goodness.good:
            return limits + self._gaps()
        # Where no hypothesis fits, neither their probabilities nor any sizes mean much.
        said = [] if self.ended else [self.goodness.verdict]
        if best.hypothesis.name != self.robot.nominal.name:
            said.append(f"the best of the hypotheses that fail: {best.hypothesis.name}")
        return said + limits + beyond_range(best.posterior, self.robot)

    def _gaps(self) -> list[str]:
        """Return what was not measured; nothing of a file, or where nearby robots diverge."""
        if self.warm_start is None:
            return []
        try:
            return self.identified().gaps
        except TargetError:
            return []

    def to_dict(self) -> dict[str, Any]:
        """Return everything except the modes' covariances, ready for JSON.

        Where no robot explains the trials there are no ``intervals``. See
        :mod:`eea.infer.file` for the covariances.
        """
        modes = {}
        for branch in self.branches:
            parameters = branch.parameters
            posterior = branch.posterior
            theta = parameters.into_bounds(np.array([mode.theta for mode in posterior.modes]))
            modes[branch.hypothesis.name] = {
                "names": list(parameters.names),
                "probabilities": posterior.weights.tolist(),
                "values": parameters.natural(theta).tolist(),
            }
        return {
            "sigma": self.sigma,
            "goodness": asdict(self.goodness),
            "hypotheses": {b.hypothesis.name: b.probability for b in self.branches},
            "findings": self.findings,
            "intervals": {
                f"{mass:.0%}": {name: list(row) for name, row in self.table(mass).items()}
                for mass in ((0.5, 0.8, 0.9) if self.good else ())
            },
            "dimensions": list(self.robot.sought),
            "modes": modes,
        }
