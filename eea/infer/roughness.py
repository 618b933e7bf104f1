"""How far a simulator is from a smooth function of its numbers near a best fit.

An adaptive solver, single precision, contacts and tables make a signal rough: a small step of a
number changes it by more, or by less, than a large step says. A difference over a step t of a
signal with roughness e has an error of e / t, which passes for information. A table of differences
at five even steps tells roughness from curvature (J. J. More and S. M. Wild, "Estimating
computational noise", 2011): with white roughness e the fourth differences have the variance
70 e^2 at any step, and those of a smooth signal fall with the step. The derivative of a rough
number takes the step above which they begin to fall.

A number that acts in steps, such as a delay in samples, has a plateau: within it the signal is the
same to the bit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats
from eea.infer.misfit import FINE, Regression, Roughness
from eea.infer.unknowns import FIXED_SLOT

SHARE_OF_SIGNAL = 0.05  # by which one step changes the signal at most
SDS_OF_STEP = 5.0  # of a number: the most of one step
LARGEST_STEP = 0.05  # of a range or in rad
SHRINK = 8.0  # times smaller is the next step that tells roughness from a bend
STAYS = 0.3  # of the fourth differences: a bend or a kink leaves an eighth at most
NEARLY_FLOOR = 3.0  # times the differences of roughness alone: those of a step that will do
ROUNDING = 1e-6  # of the noise: differences of less are no roughness
DERIVATIVE_ERROR = 0.01  # of a number's precision: a smaller squared error changes nothing
FLAT_SHARE = 1e-3  # of the slope over a large step: a slope of less is that of a plateau
JUMP_COST = 10.0  # of half the sum of squares: a step that changes it by more is no flat one
LEAST_JUMP = 1.0  # of the signal at the end of a plateau, in sds; smaller steps are roughness
TENTH = 0.1  # of a range: the first step past the end of a plateau
HALVINGS = 20  # that find the end of a plateau
SAME_SHARE = 1e-6  # of the change by a tenth of the range: by less a signal is the same
LEAST_PLATEAU = 1e-4  # of a range; narrower ones are roughness
TOO_ROUGH = 1.0  # of the noise: a solver is not as rough, within a number's sds
REPEATED_SHARE = 1e-6  # of the noise: numbers that differ by less are the same


class Near:
    """A simulator near a vector theta (P,)."""

    def __init__(self, regression: Regression, theta: Floats, weight: float) -> None:
        self.parameters = regression.parameters
        self.misfit = regression.misfit(FINE)
        self.theta = theta
        self.scale = weight**0.5

    def signals(self, vectors: Floats) -> Floats:
        """Return the residuals (S, N) of vectors (S, P), in sds of the noise."""
        found = self.misfit.residuals(vectors).reshape(len(vectors), -1)
        return np.asarray(found * self.scale, np.float64)

    def entries(self, slot: int) -> NDArray[np.intp]:
        """Return the entries of a slot, of all trials."""
        found: NDArray[np.intp] = np.unique(self.parameters.slots[:, slot])
        return np.asarray(found[found != FIXED_SLOT])

    def line(self, slot: int, step: float) -> Floats:
        """Return vectors (5, P) about theta, even steps apart in a slot, within the bounds."""
        entries = self.entries(slot)
        low = self.parameters.low[entries]
        high = self.parameters.high[entries]
        reach = 2.0 * step
        middle = np.clip(self.theta[entries], low + reach, np.maximum(high - reach, low + reach))
        vectors = np.tile(self.theta, (5, 1))
        vectors[:, entries] = middle + step * np.arange(-2.0, 3.0)[:, None]
        return vectors

    def rough_step(self, slot: int, step: float, fourth: float) -> tuple[float, float] | None:
        """Return the step that a rough slot's derivative takes, and the differences there.

        None where the signal is only bent: its ``fourth`` differences fall with the step, even at
        a kink. Those of a rough signal stay. Two steps are taken together, since one may happen to
        be a period of what is rough.
        """
        steps = step / SHRINK ** np.arange(6.0)
        lines = self.signals(np.concatenate([self.line(slot, each) for each in steps[1:]]))
        each = np.diff(lines.reshape(5, 5, -1), 4, axis=1)
        found = np.append(fourth, np.linalg.norm(each, axis=(1, 2)))
        before = found[2:4].max()
        after = float(found[4:].max())
        rounding = ROUNDING * (70.0 * lines.shape[1]) ** 0.5
        if not (after > STAYS * before and after > rounding):
            return None
        return float(steps[found <= NEARLY_FLOOR * after].max(initial=steps[3])), after


def look(regression: Regression, theta: Floats, weight: float) -> Roughness:
    """Return the roughness at a vector (P,) of the slots that were not looked at before.

    It takes five simulations of each trial for a slot. ``weight`` is the precision of the
    residuals.
    """
    near = Near(regression, theta, weight)
    parameters = regression.parameters
    misfit = near.misfit
    before = regression.roughness
    slots = misfit.free if before is None else misfit.free[~before.looked[misfit.free]]
    looked = np.zeros(parameters.slots.shape[1], np.bool_)
    looked[slots] = True
    steps = np.zeros(len(looked))
    widths = np.zeros(len(looked))
    if not len(slots):
        return Roughness(looked, steps, widths)
    linear = misfit.linearise(theta[None])
    posterior = misfit.laplace(theta[None], linear, weight)[0]
    variances = np.diag(posterior.covariance(parameters.uniform_precision))
    slopes = linear.slopes[0] * near.scale  # (E, F, M)
    usual = {slot: slopes[:, f].ravel() for f, slot in enumerate(misfit.free)}
    loud = SHARE_OF_SIGNAL * regression.loudness * near.scale
    tried = []
    too_wide = set()
    shortest = 2.0 * FINE.difference
    for slot in slots:
        sd = float(np.sqrt(variances[near.entries(slot)].max()))
        change = max(float(np.linalg.norm(usual[slot])), 1e-300)
        tried.append(max(min(SDS_OF_STEP * sd, LARGEST_STEP, loud / change), shortest))
    lines = [near.line(slot, step) for slot, step in zip(slots, tried, strict=True)]
    signals = near.signals(np.concatenate([theta[None], *lines]))
    unrepeated = rms(signals[0] - linear.residuals[0].ravel() * near.scale) / 2.0**0.5
    jitter = 0.0
    for slot, step, line in zip(slots, tried, signals[1:].reshape(len(slots), 5, -1), strict=True):
        entries = near.entries(slot)
        least = DERIVATIVE_ERROR * float((1.0 / np.maximum(variances[entries], 1e-300)).sum())
        slope = (8.0 * (line[3] - line[1]) - (line[4] - line[0])) / (12.0 * step)
        error = slope - usual[slot]
        if not np.isfinite(slope).all() or error @ error <= least:
            continue
        flat = np.linalg.norm(usual[slot]) <= FLAT_SHARE * np.linalg.norm(slope)
        if flat and len(entries) == 1 and not parameters.circular[entries[0]]:
            found = plateau(near, int(entries[0]))
            if found is not None:
                widths[slot] = found[1] - found[0]
                continue
        fourth = float(np.linalg.norm(np.diff(line, 4, axis=0)))
        unit = (70.0 * slope.size) ** 0.5
        rough = near.rough_step(slot, step, fourth)
        if rough is not None:
            steps[slot], fourth = rough
        if step == shortest and fourth > TOO_ROUGH * unit:
            too_wide.add(int(slot))
        if rough is not None or step < LARGEST_STEP:  # a number that is known, within its sds
            jitter = max(jitter, fourth / unit)
    unrepeated = unrepeated if unrepeated > REPEATED_SHARE else 0.0
    return Roughness(looked, steps, widths, jitter, unrepeated, frozenset(too_wide))


def rms(signal: Floats) -> float:
    """Return the root mean square of a signal."""
    return float(np.sqrt((signal**2).mean()))


def plateau(near: Near, entry: int) -> tuple[float, float] | None:
    """Return the ends of the plateau on which an entry's value is; None where it is on none."""
    at = float(near.theta[entry])
    box = near.parameters.low[entry], near.parameters.high[entry]

    def changed(values: Floats) -> Floats:
        """Return how far the signal is from that at theta for each of some values (n,)."""
        vectors = np.tile(near.theta, (len(values) + 1, 1))
        vectors[1:, entry] = values
        signals = near.signals(vectors)
        return np.asarray(np.linalg.norm(signals[1:] - signals[0], axis=1))

    tried = np.clip(at + np.array([-TENTH, TENTH]), *box)
    vectors = np.tile(near.theta, (3, 1))
    vectors[1:, entry] = tried
    costs = 0.5 * (near.signals(vectors) ** 2).sum(axis=1)
    if not np.isfinite(costs).all() or np.abs(costs[1:] - costs[0]).max() < JUMP_COST:
        return None
    apart = changed(np.array([at, *tried]))
    same = max(SAME_SHARE * float(apart[1:].max()), 5.0 * float(apart[0]))
    outer = np.where(apart[1:] > same, tried, box)
    inner = np.array([at, at])
    for _ in range(HALVINGS):
        middle = 0.5 * (inner + outer)
        moved = changed(middle) > same
        outer = np.where(moved, middle, outer)
        inner = np.where(moved, inner, middle)
    steps = np.concatenate([inner, outer])
    left = changed(steps)
    inside = left[:2]
    outside = left[2:]
    reached = outer == box  # or the end of the range, where nothing has changed
    jump = reached | ((outside - inside > 0.5 * outside) & (outside > LEAST_JUMP))
    if not jump.all() or reached.all() or outer[1] - outer[0] < LEAST_PLATEAU:
        return None
    return float(outer[0]), float(outer[1])
