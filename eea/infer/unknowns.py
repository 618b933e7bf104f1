"""The vector of all unknowns, and the numbers that each trial takes from it."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import TURN, Floats, wrap
from eea.core.checks import ConfigurationError, brief
from eea.infer.mixture import Mixture, Mode, log_constant
from eea.infer.statement import Hypothesis, RobotModel

FIXED_SLOT = -1  # an entry of ``slots`` that is a constant, not a parameter
ALL_TRIALS = -1  # of ``entry_trials``, of an entry that all trials share
# Prior precision of a dimension that a hypothesis fixes. The dimension stays an entry.
FIXED_PRECISION = 1e12
UNIFORM_PRECISION = 12.0  # in 1/range^2, of a uniform distribution over the range


@dataclass(frozen=True, eq=False)
class Unknowns:
    """The unknowns of E trials as one vector theta (P,).

    First come the numbers that all trials share, those that are sought before the others, as shares
    of their ranges in [0, 1]; then each trial's own numbers (shares) and angles (rad). A **slot**
    is one of the W numbers that a trial is simulated with, in the order of ``robot.table``.
    """

    robot: RobotModel
    names: tuple[str, ...]  #: Of the entries, for people; those of trial e end in ``@e``, from 1.
    groups: frozenset[str]  #: The groups of numbers that are inferred.
    low: Floats  #: Lower bounds (P,); infinite for angles.
    high: Floats  #: Upper bounds (P,).
    circular: NDArray[np.bool_]  #: Whether each entry (P,) is an angle.
    prior_mean: Floats  #: Mean of the normal prior (P,).
    prior_information: Floats  #: Inverse covariance of the prior (P, P); 0 is uniform.
    slots: NDArray[
        np.intp
    ]  #: (E, W), the entry that gives each slot of a trial its value, or ``FIXED_SLOT``.
    entry_slots: NDArray[np.intp]  #: (P,), the slot of each entry.
    entry_trials: NDArray[np.intp]  #: (P,), the trial of each entry from 0, or ``ALL_TRIALS``.
    _constants: Floats  # (W,) and the following: of the slots
    _offset: Floats
    _span: Floats
    _end: Floats

    @classmethod
    def of(
        cls,
        robot: RobotModel,
        trials: int,
        groups: Collection[str],
        hypothesis: Hypothesis | None = None,
    ) -> Unknowns:
        """Return the unknowns of a number of trials; numbers outside ``groups`` have their mean.

        Raises
        ------
        ConfigurationError
            If there is none.
        """
        hypothesis = robot.nominal if hypothesis is None else hypothesis
        fixed = robot.fixed(hypothesis)
        table = robot.table
        learned = robot.prior.names if robot.prior is not None else ()
        turning = np.array([number.circular for number in table.values()])
        low = np.array([0.0 if one.circular else one.low for one in table.values()])
        high = np.array([1.0 if one.circular else one.high for one in table.values()])
        span = high - low
        constants = np.zeros(len(table))
        # Entries common to all trials, and entries of each: slot, prior mean and precision.
        shared: list[tuple[int, float, float]] = []
        own: list[tuple[int, float, float]] = []
        for i, (name, number) in enumerate(table.items()):
            if number.circular:
                all_trials = name in hypothesis.moves or not number.varies
                (shared if all_trials else own).append((i, 0.0, 0.0))
                continue
            if name in fixed:
                constants[i] = (fixed[name] - low[i]) / span[i]
                if number.sought:
                    shared.append((i, constants[i], FIXED_PRECISION))
                continue
            if number.sought:
                shared.append((i, 0.5, 0.0))
                continue
            assert number.mean is not None
            constants[i] = mean = (number.mean - low[i]) / span[i]
            row = (i, mean, (span[i] / number.sd) ** 2)
            if number.varies:
                own.append(row)
            elif (
                name in hypothesis.moves
                or (number.switch and name in learned)
                or (number.grouped and number.group in groups)
            ):
                shared.append(row)
        slots = np.full((trials, len(table)), FIXED_SLOT, dtype=np.intp)
        names = robot.names
        for entry, (i, _, _) in enumerate(shared):
            if names[i] not in fixed:
                slots[:, i] = entry
        count = len(shared) + trials * len(own)
        own_slots = [i for i, _, _ in own]
        slots[:, own_slots] = np.arange(len(shared), count).reshape(trials, len(own))
        if not count:
            raise ConfigurationError(
                f"numbers must have one that is unknown if {hypothesis.name}; got "
                f"{brief(list(names))}, of the groups {brief(sorted(groups))}"
            )
        places, means, precisions = zip(*shared, *(own * trials), strict=True)
        entry_slots = np.array(places, dtype=np.intp)
        entry_trials = np.full(count, ALL_TRIALS, dtype=np.intp)
        entry_trials[len(shared) :] = np.repeat(np.arange(trials), len(own))
        circular = turning[entry_slots]
        prior = _Prior(
            entry_slots,
            entry_trials,
            np.array(means),
            np.diag(precisions),
            np.where(circular, -np.inf, 0.0),
            np.where(circular, np.inf, 1.0),
        )
        _inform(prior, robot, hypothesis)
        _move(prior, robot, hypothesis)
        return cls(
            robot,
            tuple(
                names[i] if e == ALL_TRIALS else f"{names[i]}@{e + 1}"
                for i, e in zip(entry_slots.tolist(), entry_trials.tolist(), strict=True)
            ),
            groups=frozenset(groups),
            low=prior.low,
            high=prior.high,
            circular=circular,
            prior_mean=prior.mean,
            prior_information=prior.information,
            slots=slots,
            entry_slots=entry_slots,
            entry_trials=entry_trials,
            _constants=constants,
            _offset=low,
            _span=span,
            _end=high,
        )

    def __len__(self) -> int:
        return len(self.names)

    @property
    def body(self) -> int:
        """Number of the entries of the numbers that are sought, which come first."""
        return len(self.robot.sought)

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
        natural = self._natural(local, np.arange(local.shape[-1]))
        return dict(zip(self.robot.names, natural.T, strict=True))

    def natural(self, theta: Floats) -> Floats:
        """Return vectors (..., P) in natural units; angles stay rad."""
        return self._natural(theta, self.entry_slots)

    def _natural(self, shares: Floats, slots: NDArray[np.intp]) -> Floats:
        """Return the values (..., n) of slots (n,) in natural units.

        The share 1 is the end of a range to the bit: ``low + (high - low)`` may be beyond it.
        """
        inside = self._offset[slots] + self._span[slots] * shares
        return np.where(shares == 1.0, self._end[slots], inside)

    def models(self, theta: Floats) -> Floats:
        """Return the parameters (..., n) of vectors (..., P), in natural units."""
        robot = self.robot
        found = np.clip(self.natural(theta)[..., : self.body], robot.low, robot.high)
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

    def entries_of(self, name: str) -> NDArray[np.intp]:
        """Return which entries are a number: one, or one of each trial."""
        return np.flatnonzero(self.entry_slots == self.robot.names.index(name))

    def first_entry(self, name: str) -> int:
        """Return which entry is a number, in the first trial if each trial has its own."""
        return int(self.entries_of(name)[0])

    def has(self, name: str) -> bool:
        """Return whether a number is an entry."""
        return name in self.robot.table and bool(len(self.entries_of(name)))

    def base(self, entry: int) -> str:
        """Return the name of the number that an entry is, whichever trial's."""
        return self.robot.names[int(self.entry_slots[entry])]

    def angle_entries(self, trial: int) -> NDArray[np.intp]:
        """Return which entries (h,) are a trial's angles."""
        return self.slots[trial, self.slots.shape[1] - len(self.robot.angles) :]

    @property
    def common(self) -> NDArray[np.bool_]:
        """Which entries (P,) all trials share."""
        return np.asarray(self.entry_trials == ALL_TRIALS)

    def common_entries(self) -> NDArray[np.intp]:
        """Return which entries are sought and common to all trials, and are no angles."""
        sought = self.prior_precision < FIXED_PRECISION
        return np.flatnonzero(sought & self.common & ~self.circular)

    def own_entries(self, trial: int) -> NDArray[np.intp]:
        """Return which entries are a trial's alone."""
        return np.flatnonzero(self.entry_trials == trial)

    def freed_entries(self) -> NDArray[np.intp]:
        """Return which entries beside the sought numbers may be anywhere in their ranges."""
        flat = self.common & ~self.circular & (self.prior_precision == 0.0)
        return self.body + np.flatnonzero(flat[self.body :])

    def start_slots(self) -> NDArray[np.intp]:
        """Return which slots are a trial's own, except the angles."""
        own = ~self.common & ~self.circular
        return np.unique(self.entry_slots[own])

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

    slots: NDArray[np.intp]
    trials: NDArray[np.intp]
    mean: Floats
    information: Floats
    low: Floats
    high: Floats


def _inform(prior: _Prior, robot: RobotModel, hypothesis: Hypothesis) -> None:
    """Write a robot's own prior over that of entries that no hypothesis moves, in place."""
    known = robot.prior
    if known is None:
        return
    silent = {*hypothesis.moves, *robot.fixed(hypothesis)}
    slots = {name: i for i, name in enumerate(robot.names) if name not in silent}
    wanted = {slots[name]: k for k, name in enumerate(known.names) if name in slots}
    for trial in np.unique(prior.trials):
        here = [i for i in np.flatnonzero(prior.trials == trial) if prior.slots[i] in wanted]
        which = [wanted[prior.slots[i]] for i in here]
        prior.mean[here] = known.mean[which]
        prior.information[here] = 0.0
        covariance = known.covariance[np.ix_(which, which)]
        prior.information[np.ix_(here, here)] = np.linalg.inv(covariance)


def _move(prior: _Prior, robot: RobotModel, hypothesis: Hypothesis) -> None:
    """Write what a hypothesis moves, and how far, into the prior, in place.

    A change adds to what was known, and is the same in all trials. Its bounds count from the mean
    of what was known.
    """
    for name, change in hypothesis.moves.items():
        if change.circular:
            continue
        entries = np.flatnonzero(prior.slots == robot.names.index(name))
        low = robot.table[name].low
        high = robot.table[name].high
        was = (robot.usual.get(name, 0.5 * (low + high)) - low) / (high - low)
        prior.low[entries] = np.clip(was + change.low / (high - low), 0.0, 1.0)
        prior.high[entries] = np.clip(was + change.high / (high - low), 0.0, 1.0)
        block = np.ix_(entries, entries)
        if np.isfinite(change.sd):
            own = _variance(robot, name, prior.information[block])
            prior.mean[entries] = was + (change.mean or 0.0) / (high - low)
            covariance = own * np.eye(len(entries)) + (change.sd / (high - low)) ** 2
            prior.information[block] = np.linalg.inv(covariance)
        else:
            prior.information[block] = 0.0


def _variance(robot: RobotModel, name: str, information: Floats) -> float:
    """Return the variance of a number before it moved, as a share of its range squared."""
    if name in robot.healthy:
        return 0.0
    if robot.prior is not None and name in robot.prior.names:
        i = robot.prior.names.index(name)
        return float(robot.prior.covariance[i, i])
    return float(1.0 / information[0, 0]) if information.any() else 0.0
