"""The vector of all unknowns, and the numbers that each trial takes from it."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats, wrap
from eea.joint.problem import AS_COMMANDED, Hypothesis, JointProblem

FIXED = -1  # in ``slots``: a constant instead of a parameter
SURE = 1e12  # the prior's precision of a dimension that a hypothesis fixes, which stays an entry


class Inputs(NamedTuple):
    """The simulator's inputs, (S, E, width) each, for S vectors and E trials."""

    bodies: Floats
    nuisances: Floats
    angles: Floats


@dataclass(frozen=True, eq=False)
class Parameters:
    """The unknowns of E trials as one vector theta (P,).

    First come the body's dimensions and the nuisances common to all trials, as shares of their
    ranges in [0, 1], then each trial's own nuisances (shares) and hidden angles (rad). A **slot**
    is one of the W numbers that a trial is simulated with: body, nuisances, angles.

    Attributes
    ----------
    names
        Of the entries; those of trial e end in ``@e``, from 1.
    low, high
        Bounds (P,); infinite for angles.
    circular
        Whether each entry (P,) is an angle.
    prior_mean, prior_precision
        The normal prior of each entry (P,); precision 0 is uniform.
    prior_information
        (P, P), the prior's inverse covariance.
    slots
        (E, W) the entry of which each trial's slot takes the value, or ``FIXED``.
    """

    joint: JointProblem
    names: tuple[str, ...]
    low: Floats
    high: Floats
    circular: NDArray[np.bool_]
    prior_mean: Floats
    prior_precision: Floats
    prior_information: Floats
    slots: NDArray[np.intp]
    _places: NDArray[np.intp]  # (P,) the slot that takes each entry
    _constants: Floats  # (W,) and the following: of the slots
    _offset: Floats
    _span: Floats

    @classmethod
    def of(
        cls,
        joint: JointProblem,
        trials: int,
        groups: Collection[str],
        hypothesis: Hypothesis = AS_COMMANDED,
        per_trial: Collection[str] = (),
    ) -> Parameters:
        """Return the unknowns of a number of trials.

        Nuisances outside ``groups`` are nominal; those in ``per_trial`` groups vary by trial.
        """
        models, hidden = joint.problem.models, joint.problem.hidden
        angles = np.zeros(len(hidden))
        low = np.concatenate([models.low, [n.low for n in joint.nuisances], angles])
        span = np.concatenate(
            [models.span, [n.high - n.low for n in joint.nuisances], angles + 1.0]
        )
        slots = np.full((trials, len(low)), FIXED, dtype=np.intp)
        constants = np.zeros(len(low))
        entries: list[tuple[str, int, float, float]] = []  # name, slot, prior mean and precision
        own: list[tuple[str, int, float, float]] = []  # the same, of every trial

        def enter(name: str, slot: int, mean: float, precision: float) -> int:
            entries.append((name, slot, mean, precision))
            return len(entries) - 1

        for i, name in enumerate(models.names):
            if name in hypothesis.fixed:
                constants[i] = (hypothesis.fixed[name] - low[i]) / span[i]
                enter(name, i, constants[i], SURE)
            else:
                slots[:, i] = enter(name, i, 0.5, 0.0)
        for i, nuisance in enumerate(joint.nuisances, len(models)):
            name = nuisance.name
            constants[i] = mean = (nuisance.nominal - low[i]) / span[i]
            precision = (span[i] / nuisance.sd) ** 2
            inferred = nuisance.start or (nuisance.group in groups and not nuisance.switch)
            by_trial = nuisance.start or nuisance.group in per_trial
            if name in hypothesis.fixed:
                constants[i] = (hypothesis.fixed[name] - low[i]) / span[i]
            elif name in hypothesis.freed or (inferred and not by_trial):
                slots[:, i] = enter(name, i, mean, precision)
            elif inferred:
                own.append((name, i, mean, precision))
        for i, name in enumerate(hidden, len(models) + len(joint.nuisances)):
            if name in hypothesis.shared_angles:
                slots[:, i] = enter(name, i, 0.0, 0.0)
            else:
                own.append((name, i, 0.0, 0.0))
        for e in range(trials):
            for name, i, mean, precision in own:
                slots[e, i] = enter(f"{name}@{e + 1}", i, mean, precision)
        names, places, means, precisions = zip(*entries, strict=True)
        turning = np.array(places) >= len(models) + len(joint.nuisances)
        return cls(
            joint,
            names,
            low=np.where(turning, -np.inf, 0.0),
            high=np.where(turning, np.inf, 1.0),
            circular=turning,
            prior_mean=np.array(means),
            prior_precision=np.array(precisions),
            prior_information=np.diag(precisions),
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

    def local(self, theta: Floats) -> Floats:
        """Return the slots' values (S, E, W) of vectors (S, P), in the same units."""
        values: Floats = np.where(self.slots == FIXED, self._constants, theta[:, self.slots])
        return values

    def inputs(self, local: Floats) -> Inputs:
        """Return the simulator's inputs for slots (..., W), in natural units."""
        natural = self._offset + self._span * local
        edges = np.cumsum([self.body, len(self.joint.nuisances)])
        return Inputs(*np.split(natural, edges, axis=-1))

    def natural(self, theta: Floats) -> Floats:
        """Return vectors (..., P) in natural units; angles stay rad."""
        values: Floats = self._offset[self._places] + self._span[self._places] * theta
        return values

    def models(self, theta: Floats) -> Floats:
        """Return the bodies (..., n) of vectors (..., P), in natural units."""
        layout = self.joint.problem.models
        return np.clip(layout.low + layout.span * theta[..., : self.body], layout.low, layout.high)

    def typical(self, bodies: Floats) -> Floats:
        """Return vectors (S, P) of bodies (S, n), shares: nominal nuisances, angles zero."""
        theta: Floats = np.tile(self.prior_mean, (len(bodies), 1))
        sought = self.prior_precision[: self.body] < SURE
        theta[:, : self.body] = np.where(sought, bodies, theta[:, : self.body])
        return theta

    def angle_entries(self, trial: int) -> NDArray[np.intp]:
        """Return which entries (h,) are a trial's hidden angles."""
        return self.slots[trial, self.slots.shape[1] - len(self.joint.problem.hidden) :]

    def freed_entries(self) -> NDArray[np.intp]:
        """Return which entries are switches that the hypothesis has freed."""
        switches = {n.name for n in self.joint.nuisances if n.switch}
        return np.flatnonzero([name in switches for name in self.names])

    def start_slots(self) -> NDArray[np.intp]:
        """Return which slots are a trial's initial state, except the angles."""
        starts = (n.start for n in self.joint.nuisances)
        return self.body + np.flatnonzero(np.fromiter(starts, dtype=np.bool_))

    def own_entries(self, trial: int) -> NDArray[np.intp]:
        """Return which entries are a trial's alone."""
        entries: NDArray[np.intp] = self.slots[trial]
        own = [entry for entry in entries if entry != FIXED and "@" in self.names[entry]]
        return np.array(own, dtype=np.intp)

    def into_bounds(self, theta: Floats) -> Floats:
        """Return vectors (..., P) brought into the box, and their angles into [-pi, pi)."""
        return np.where(self.circular, wrap(theta), np.clip(theta, self.low, self.high))

    def prior_cost(self, theta: Floats) -> Floats:
        """Return -log prior (S,) of vectors (S, P), up to a constant."""
        away = theta - self.prior_mean
        cost: Floats = 0.5 * ((away @ self.prior_information) * away).sum(axis=-1)
        return cost
