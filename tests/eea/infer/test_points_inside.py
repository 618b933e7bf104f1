"""An estimate lies inside its own interval, or there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eea.infer.answer import Answer
from eea.infer.mixture import Mixture, Mode
from swing import infer

MASSES = (0.05, 0.3, 0.5, 0.9, 0.999)


def random_posterior(rng, names=("a", "b", "c", "phase", "turn")):
    """Return a mixture of modes of any shape, some at bounds, some without information."""
    circular = np.array([False, False, False, True, True])
    size, modes = len(names), []
    for _ in range(rng.integers(1, 4)):
        theta = np.where(circular, rng.uniform(-np.pi, np.pi, size), rng.random(size))
        theta = np.where(~circular & (rng.random(size) < 0.3), rng.integers(0, 2), theta)
        root = rng.normal(size=(size, size)) * 10.0 ** rng.uniform(-1.0, 2.0, size)
        held = ~circular & ((theta == 0.0) | (theta == 1.0))
        gradient = np.where(held, (1.0 - 2.0 * theta) * rng.exponential(20.0, size), 0.0)
        cost = float(rng.exponential(2.0))
        modes.append(Mode(theta, root.T @ root, gradient, cost))
    return Mixture(names, np.zeros(size), np.ones(size), circular, modes)


@pytest.mark.parametrize("seed", range(40))
def test_the_median_lies_inside_the_interval_of_any_mass(seed):
    found = random_posterior(np.random.default_rng(seed))
    middle = found.median()
    for mass in MASSES:
        low, high = found.interval(mass)
        turn = (middle - low) % (2 * np.pi)
        turn[turn > 2 * np.pi - 1e-9] = 0.0
        inside = np.where(found.circular, turn <= high - low + 1e-9, low <= middle)
        assert inside.all()
        assert (found.circular | (middle <= high)).all()


def doubted_elsewhere(belief, shift):
    """Return a posterior whose intervals, if the simulator is wrong, lie elsewhere."""
    branches = []
    for branch in belief.branches:
        own = branch.parameters.circular
        modes = [
            replace(m, theta=np.where(own, m.theta + shift, np.clip(m.theta + shift, 0.0, 1.0)))
            for m in branch.posterior.modes
        ]
        branches.append(replace(branch, doubted=replace(branch.posterior, modes=modes)))
    return Answer(tuple(branches), belief.goodness, belief.sigma, belief.samples)


@pytest.mark.parametrize("shift", [-0.3, 0.0, 0.2])
def test_estimates_lie_inside_intervals_of_another_posterior(shift):
    result = infer()
    belief = doubted_elsewhere(result.belief, shift)
    moved = replace(result, belief=belief)
    for mass in MASSES:
        for low, high in (belief.interval(mass), moved.interval(mass)):
            assert (low <= belief.model).all()
            assert (belief.model <= high).all()
        assert all(low <= middle <= high for middle, low, high in belief.table(mass).values())
    for rows in belief.to_dict()["intervals"].values():
        assert all(low <= middle <= high for middle, low, high in rows.values())


def test_where_no_body_explains_the_trials_nothing_is_known():
    result = infer()
    goodness = replace(result.belief.goodness, good=False, verdict="no body explains the log: so")
    bad = replace(result, belief=replace(result.belief, goodness=goodness))
    low, high = bad.interval(0.5)
    assert np.array_equal(low, result.layout.low)
    assert np.array_equal(high, result.layout.high)
    assert bad.to_dict()["belief"]["intervals"] == {}
    assert bad.belief.findings == ["no body explains the log: so"]
