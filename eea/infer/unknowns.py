"""The vector of all unknowns, and the numbers that each trial takes from it."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import TURN, Floats, wrap
from eea.infer.mixture import Mixture, Mode, log_constant
from eea.infer.statement import Hypothesis, RobotModel

FIXED_SLOT = -1  # an entry of ``slots`` that is a constant, not a parameter
# Prior precision of a dimension that a hypothesis fixes. The dimension stays an entry.
FIXED_PRECISION = 1e12
UNIFORM_PRECISION = 12.0  # in 1/range^2, of a uniform distribution over the range


@dataclass(frozen=True, eq=False)
class Unknowns:
    """The unknowns of E trials as one vector theta (P,).

    First come the robot's parameters and the nuisances common to all trials, as shares of their
    ranges in [0, 1], then each trial's own nuisances (shares) and hidden angles (rad). A **slot**
    is one of the W numbers that a trial is simulated with: body, nuisances, angles.
    """

    robot: RobotModel
    names: tuple[str, ...]  #: Of the entries; those of trial e end in ``@e``, from 1.
    low: Floats  #: Lower bounds (P,); infinite for angles.
    high: Floats  #: Upper bounds (P,).
    circular: NDArray[np.bool_]  #: Whether each entry (P,) is an angle.
    prior_mean: Floats  #: Mean of the normal prior (P,).
    prior_information: Floats  #: Inverse covariance of the prior (P, P); 0 is uniform.
    slots: NDArray[
        np.intp
    ]  #: (E, W), the entry that gives each slot of a trial its value, or ``FIXED_SLOT``.
    _places: NDArray[np.intp]  # (P,), the slot of each entry
    _constants: Floats  # (W,) and the following: of the slots
    _offset: Floats
    _span: Floats

    @classmethod
    def of(
        cls,
        robot: RobotModel,
        trials: int,
        groups: Collection[str],
        hypothesis: Hypothesis | None = None,
    ) -> Unknowns:
        """Return the unknowns of a number of trials; nuisances outside ``groups`` are nominal."""
        hypothesis = robot.nominal if hypothesis is None else hypothesis
        fixed = robot.fixed(hypothesis)
        nuisances = robot.nuisance_list
        hidden = robot.hidden
        size = len(robot.parameters)
        angles = np.zeros(len(hidden))
        low = np.concatenate([robot.low, [n.low for n in nuisances], angles])
        span = np.concatenate([robot.span, [n.high - n.low for n in nuisances], angles + 1.0])
        constants = np.zeros(len(low))
        # Entries common to all trials, and entries of each: name, slot, prior mean and precision.
        shared: list[tuple[str, int, float, float]] = []
        own: list[tuple[str, int, float, float]] = []
        for i, name in enumerate(robot.parameters):
            if name in fixed:
                constants[i] = (fixed[name] - low[i]) / span[i]
                shared.append((name, i, constants[i], FIXED_PRECISION))
            else:
                shared.append((name, i, 0.5, 0.0))
        for i, nuisance in enumerate(nuisances, size):
            name = nuisance.name
            constants[i] = mean = (nuisance.nominal - low[i]) / span[i]
            precision = (span[i] / nuisance.sd) ** 2
            inferred = nuisance.start or (nuisance.group in groups and not nuisance.switch)
            by_trial = nuisance.start or name in robot.each_trial
            if name in fixed:
                constants[i] = (fixed[name] - low[i]) / span[i]
            elif name in hypothesis.freed or (inferred and not by_trial):
                shared.append((name, i, mean, precision))
            elif inferred:
                own.append((name, i, mean, precision))
        for i, name in enumerate(hidden, size + len(nuisances)):
            (shared if name in hypothesis.shared_angles else own).append((name, i, 0.0, 0.0))
        slots = np.full((trials, len(low)), FIXED_SLOT, dtype=np.intp)
        for entry, (name, i, _, _) in enumerate(shared):
            if name not in fixed:
                slots[:, i] = entry
        by_trial_slots = [i for _, i, _, _ in own]
        count = len(shared) + trials * len(own)
        slots[:, by_trial_slots] = np.arange(len(shared), count).reshape(trials, len(own))
        rows = shared + [(f"{name}@{e + 1}", *row) for e in range(trials) for name, *row in own]
        names, places, means, precisions = zip(*rows, strict=True)
        turning = np.array(places) >= size + len(nuisances)
        prior = _Prior(
            np.array(means),
            np.diag(precisions),
            np.where(turning, -np.inf, 0.0),
            np.where(turning, np.inf, 1.0),
        )
        _inform(prior, robot, hypothesis, names)
        _move(prior, robot, hypothesis, names)
        return cls(
            robot,
            names,
            low=prior.low,
            high=prior.high,
            circular=turning,
            prior_mean=prior.mean,
            prior_information=prior.information,
            slots=slots,
            _places=np.array(places),
            _constants=constants,
            _offset=low,
            _span=span,
        )

    def __len__(self) -> int:
        return len(self.names)

    @property
    def body(self) -> int:
        """Number of the entries of the robot's parameters, which come first."""
        return len(self.robot.parameters)

    @property
    def unknowns(self) -> int:
        """Number of entries that are not constant."""
        return len(np.unique(self.slots[self.slots != FIXED_SLOT]))

    @property
    def informed(self) -> int:
        """Number of entries that have a prior and are not fixed."""
        precision = self.prior_precision
        return int(((precision > 0.0) & (precision < FIXED_PRECISION)).sum())

    @property
    def prior_precision(self) -> Floats:
        """The prior's precision of each entry (P,); 0 is uniform."""
        return np.diag(self.prior_information)

    def local(self, theta: Floats) -> Floats:
        """Return the slots' values (S, E, W) of vectors (S, P), in the same units."""
        values: Floats = np.where(self.slots == FIXED_SLOT, self._constants, theta[:, self.slots])
        return values

    def values(self, local: Floats) -> dict[str, Floats]:
        """Return the values (B,) by name, in natural units, of slots (B, W), for a simulator."""
        natural = self._offset + self._span * local
        return dict(zip(self.robot.names, natural.T, strict=True))

    def natural(self, theta: Floats) -> Floats:
        """Return vectors (..., P) in natural units; angles stay rad."""
        values: Floats = self._offset[self._places] + self._span[self._places] * theta
        return values

    def models(self, theta: Floats) -> Floats:
        """Return the parameters (..., n) of vectors (..., P), in natural units."""
        robot = self.robot
        found = np.clip(robot.low + robot.span * theta[..., : self.body], robot.low, robot.high)
        fixed = np.flatnonzero(self.slots[0, : self.body] == FIXED_SLOT)
        found[..., fixed] = robot.low[fixed] + robot.span[fixed] * self._constants[fixed]
        return found

    def typical(self, bodies: Floats) -> Floats:
        """Return vectors (S, P) of bodies (S, n), shares: nominal nuisances, angles zero.

        Sizes with a prior are at its mean.
        """
        theta: Floats = np.tile(self.prior_mean, (len(bodies), 1))
        sought = self.prior_precision[: self.body] == 0.0
        low = self.low[: self.body]
        within = low + (self.high[: self.body] - low) * bodies
        theta[:, : self.body] = np.where(sought, within, theta[:, : self.body])
        return theta

    def first_entry(self, name: str) -> int:
        """Return which entry is a number, in the first trial if each trial has its own."""
        return self.names.index(name if name in self.names else f"{name}@1")

    def angle_entries(self, trial: int) -> NDArray[np.intp]:
        """Return which entries (h,) are a trial's hidden angles."""
        return self.slots[trial, self.slots.shape[1] - len(self.robot.hidden) :]

    def common_entries(self) -> NDArray[np.intp]:
        """Return which entries are sought and common to all trials, and are no angles."""
        sought = self.prior_precision < FIXED_PRECISION
        common = np.array(["@" not in name for name in self.names])
        return np.flatnonzero(sought & common & ~self.circular)

    def own_entries(self, trial: int) -> NDArray[np.intp]:
        """Return which entries are a trial's alone."""
        own = [
            entry for entry in self.slots[trial] if entry != FIXED_SLOT and "@" in self.names[entry]
        ]
        return np.array(own, dtype=np.intp)

    def freed_entries(self) -> NDArray[np.intp]:
        """Return which entries are switches that the hypothesis has freed."""
        switches = {n.name for n in self.robot.nuisance_list if n.switch}
        return np.flatnonzero([name in switches for name in self.names])

    def start_slots(self) -> NDArray[np.intp]:
        """Return which slots are a trial's initial state, except the angles."""
        starts = [n.start for n in self.robot.nuisance_list]
        return self.body + np.flatnonzero(np.array(starts, dtype=np.bool_))

    def into_bounds(self, theta: Floats) -> Floats:
        """Return vectors (..., P) brought into the box, and their angles into [-pi, pi)."""
        return np.where(self.circular, wrap(theta), np.clip(theta, self.low, self.high))

    def posterior(self, modes: Sequence[Mode]) -> Mixture:
        """Return the posterior of the entries that has some modes."""
        return Mixture(self.names, self.low, self.high, self.circular, modes)

    def prior_cost(self, theta: Floats) -> Floats:
        """Return -log prior (S,) of vectors (S, P), up to a constant."""
        away = theta - self.prior_mean
        cost: Floats = 0.5 * ((away @ self.prior_information) * away).sum(axis=-1)
        return cost

    @property
    def log_prior_constant(self) -> float:
        """The constant of the log prior; it depends on the set of unknowns."""
        return log_constant(
            self.prior_mean, self.prior_information, self.low, self.high, self.circular
        )

    @property
    def uniform_precision(self) -> Floats:
        """The precision (P,) of a range or a turn where the prior is uniform, elsewhere 0."""
        uniform = np.where(self.circular, UNIFORM_PRECISION / TURN**2, UNIFORM_PRECISION)
        return np.where(self.prior_precision > 0.0, 0.0, uniform)

    @property
    def proper_prior(self) -> Floats:
        """The prior's precision (P, P), with that of a range or a turn where it is uniform."""
        return np.asarray(self.prior_information + np.diag(self.uniform_precision))


class _Prior(NamedTuple):
    """A normal prior of P entries, within bounds, as shares of their ranges."""

    mean: Floats
    information: Floats
    low: Floats
    high: Floats


def _inform(
    prior: _Prior, robot: RobotModel, hypothesis: Hypothesis, names: tuple[str, ...]
) -> None:
    """Write a robot's own prior over that of entries that no hypothesis moves, in place."""
    known = robot.prior
    if known is None:
        return
    silent = {*hypothesis.moves, *robot.fixed(hypothesis)}
    said = [name for name in known.names if name not in silent]
    each = {name.partition("@")[2] for name in names if name.partition("@")[0] in robot.each_trial}
    for trial in ("", *sorted(each - {""})):
        here = {name: f"{name}@{trial}" if trial else name for name in said}
        here = {name: own for name, own in here.items() if own in names}
        if trial:
            here = {name: own for name, own in here.items() if name in robot.each_trial}
        entries = [names.index(own) for own in here.values()]
        which = [known.names.index(name) for name in here]
        prior.mean[entries] = known.mean[which]
        prior.information[entries] = 0.0
        covariance = known.covariance[np.ix_(which, which)]
        prior.information[np.ix_(entries, entries)] = np.linalg.inv(covariance)


def _move(prior: _Prior, robot: RobotModel, hypothesis: Hypothesis, names: tuple[str, ...]) -> None:
    """Write what a hypothesis moves, and how far, into the prior, in place.

    A change adds to what was known, and is the same in all trials. Its bounds count from the mean
    of what was known.
    """
    for name, change in hypothesis.moves.items():
        entries = [i for i, one in enumerate(names) if one.partition("@")[0] == name]
        low, high = robot.ranges[name]
        was = (robot.usual.get(name, 0.5 * (low + high)) - low) / (high - low)
        prior.low[entries] = np.clip(was + change.low / (high - low), 0.0, 1.0)
        prior.high[entries] = np.clip(was + change.high / (high - low), 0.0, 1.0)
        block = np.ix_(entries, entries)
        if np.isfinite(change.sd):
            own = _variance(robot, name, prior.information[block])
            prior.mean[entries] = was + change.mean / (high - low)
            covariance = own * np.eye(len(entries)) + (change.sd / (high - low)) ** 2
            prior.information[block] = np.linalg.inv(covariance)
        else:
            prior.information[block] = 0.0


def _variance(robot: RobotModel, name: str, information: Floats) -> float:
    """Return the variance of a number before it moved, as a share of its range squared."""
    if name in robot.whole:
        return 0.0
    if robot.prior is not None and name in robot.prior.names:
        i = robot.prior.names.index(name)
        return float(robot.prior.covariance[i, i])
    return float(1.0 / information[0, 0]) if information.any() else 0.0
