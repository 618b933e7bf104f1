"""The vector of all unknowns, and the numbers that each trial takes from it."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats, wrap
from eea.joint.problem import Hypothesis, JointProblem, Prior

FIXED_SLOT = -1  # an entry of ``slots`` that is a constant, not a parameter
# Prior precision of a dimension that a hypothesis fixes. The dimension stays an entry.
FIXED_PRECISION = 1e12


@dataclass(frozen=True, eq=False)
class Parameters:
    """The unknowns of E trials as one vector theta (P,).

    First come the body's dimensions and the nuisances common to all trials, as shares of their
    ranges in [0, 1], then each trial's own nuisances (shares) and hidden angles (rad). A **slot**
    is one of the W numbers that a trial is simulated with: body, nuisances, angles.
    """

    joint: JointProblem
    names: tuple[str, ...]  #: Names of the entries; names of trial e end in ``@e``, counted from 1.
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
        joint: JointProblem,
        trials: int,
        groups: Collection[str],
        hypothesis: Hypothesis | None = None,
        per_trial: Collection[str] = (),
    ) -> Parameters:
        """Return the unknowns of a number of trials.

        Nuisances outside ``groups`` are nominal; those in ``per_trial`` groups vary by trial.
        """
        hypothesis = joint.nominal if hypothesis is None else hypothesis
        models = joint.problem.models
        nuisances = joint.nuisances
        hidden = joint.hidden
        assert hidden is not None
        angles = np.zeros(len(hidden))
        low = np.concatenate([models.low, [n.low for n in nuisances], angles])
        span = np.concatenate([models.span, [n.high - n.low for n in nuisances], angles + 1.0])
        constants = np.zeros(len(low))
        # Entries common to all trials, and entries of each: name, slot, prior mean and precision.
        shared: list[tuple[str, int, float, float]] = []
        own: list[tuple[str, int, float, float]] = []
        for i, name in enumerate(models.names):
            if name in hypothesis.fixed:
                constants[i] = (hypothesis.fixed[name] - low[i]) / span[i]
                shared.append((name, i, constants[i], FIXED_PRECISION))
            else:
                shared.append((name, i, 0.5, 0.0))
        for i, nuisance in enumerate(nuisances, len(models)):
            name = nuisance.name
            constants[i] = mean = (nuisance.nominal - low[i]) / span[i]
            precision = (span[i] / nuisance.sd) ** 2
            inferred = nuisance.start or (nuisance.group in groups and not nuisance.switch)
            by_trial = nuisance.start or nuisance.group in per_trial
            if name in hypothesis.fixed:
                constants[i] = (hypothesis.fixed[name] - low[i]) / span[i]
            elif name in hypothesis.freed or (inferred and not by_trial):
                shared.append((name, i, mean, precision))
            elif inferred:
                own.append((name, i, mean, precision))
        for i, name in enumerate(hidden, len(models) + len(nuisances)):
            (shared if name in hypothesis.shared_angles else own).append((name, i, 0.0, 0.0))
        slots = np.full((trials, len(low)), FIXED_SLOT, dtype=np.intp)
        for entry, (name, i, _, _) in enumerate(shared):
            if name not in hypothesis.fixed:
                slots[:, i] = entry
        by_trial_slots = [i for _, i, _, _ in own]
        count = len(shared) + trials * len(own)
        slots[:, by_trial_slots] = np.arange(len(shared), count).reshape(trials, len(own))
        rows = shared + [(f"{name}@{e + 1}", *row) for e in range(trials) for name, *row in own]
        names, places, means, precisions = zip(*rows, strict=True)
        turning = np.array(places) >= len(models) + len(nuisances)
        mean, information = _informed(joint.prior, hypothesis, names, means, precisions)
        return cls(
            joint,
            names,
            low=np.where(turning, -np.inf, 0.0),
            high=np.where(turning, np.inf, 1.0),
            circular=turning,
            prior_mean=mean,
            prior_information=information,
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
        """Number of the body's entries, which come first."""
        return len(self.joint.problem.models)

    @property
    def unknowns(self) -> int:
        """Number of entries that are not constant."""
        return len(np.unique(self.slots[self.slots != FIXED_SLOT]))

    @property
    def prior_precision(self) -> Floats:
        """The prior's precision of each entry (P,); 0 is uniform."""
        return np.diag(self.prior_information)

    def local(self, theta: Floats) -> Floats:
        """Return the slots' values (S, E, W) of vectors (S, P), in the same units."""
        values: Floats = np.where(self.slots == FIXED_SLOT, self._constants, theta[:, self.slots])
        return values

    def inputs(self, local: Floats) -> list[Floats]:
        """Return bodies, nuisances and angles, (..., width), of slots (..., W), for a simulator."""
        natural = self._offset + self._span * local
        return np.split(natural, np.cumsum([self.body, len(self.joint.nuisances)]), axis=-1)

    def natural(self, theta: Floats) -> Floats:
        """Return vectors (..., P) in natural units; angles stay rad."""
        values: Floats = self._offset[self._places] + self._span[self._places] * theta
        return values

    def models(self, theta: Floats) -> Floats:
        """Return the bodies (..., n) of vectors (..., P), in natural units."""
        layout = self.joint.problem.models
        return np.clip(layout.low + layout.span * theta[..., : self.body], layout.low, layout.high)

    def typical(self, bodies: Floats) -> Floats:
        """Return vectors (S, P) of bodies (S, n), shares: nominal nuisances, angles zero.

        Sizes with a prior are at its mean.
        """
        theta: Floats = np.tile(self.prior_mean, (len(bodies), 1))
        sought = self.prior_precision[: self.body] == 0.0
        theta[:, : self.body] = np.where(sought, bodies, theta[:, : self.body])
        return theta

    def angle_entries(self, trial: int) -> NDArray[np.intp]:
        """Return which entries (h,) are a trial's hidden angles."""
        assert self.joint.hidden is not None
        return self.slots[trial, self.slots.shape[1] - len(self.joint.hidden) :]

    def own_entries(self, trial: int) -> NDArray[np.intp]:
        """Return which entries are a trial's alone."""
        own = [
            entry for entry in self.slots[trial] if entry != FIXED_SLOT and "@" in self.names[entry]
        ]
        return np.array(own, dtype=np.intp)

    def freed_entries(self) -> NDArray[np.intp]:
        """Return which entries are switches that the hypothesis frees."""
        switches = {n.name for n in self.joint.nuisances if n.switch}
        return np.flatnonzero([name in switches for name in self.names])

    def start_slots(self) -> NDArray[np.intp]:
        """Return which slots are a trial's initial state, except the angles."""
        starts = [n.start for n in self.joint.nuisances]
        return self.body + np.flatnonzero(np.array(starts, dtype=np.bool_))

    def into_bounds(self, theta: Floats) -> Floats:
        """Return vectors (..., P) brought into the box, and their angles into [-pi, pi)."""
        return np.where(self.circular, wrap(theta), np.clip(theta, self.low, self.high))

    def prior_cost(self, theta: Floats) -> Floats:
        """Return -log prior (S,) of vectors (S, P), up to a constant."""
        away = theta - self.prior_mean
        cost: Floats = 0.5 * ((away @ self.prior_information) * away).sum(axis=-1)
        return cost


def _informed(
    prior: Prior | None,
    hypothesis: Hypothesis,
    names: tuple[str, ...],
    means: tuple[float, ...],
    precisions: tuple[float, ...],
) -> tuple[Floats, Floats]:
    """Return the mean (P,) and information (P, P) of the prior of entries, 0 without a prior."""
    mean = np.array(means)
    information = np.diag(precisions)
    if prior is not None:
        silent = {*hypothesis.changed, *hypothesis.fixed}
        said = [n for n in prior.names if n in names and n not in silent]
        entries = [names.index(n) for n in said]
        which = [prior.names.index(n) for n in said]
        mean[entries] = prior.mean[which]
        covariance = prior.covariance[np.ix_(which, which)]
        information[entries] = 0.0
        information[np.ix_(entries, entries)] = np.linalg.inv(covariance)
    return mean, information
