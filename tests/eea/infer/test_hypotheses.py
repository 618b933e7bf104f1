"""Which hypotheses are weighed, and when."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eea.core.experiment import RecordedLog
from eea.infer import fit as inference
from eea.infer.answer import Answer
from eea.infer.descent import Fitted
from eea.infer.misfit import Regression
from eea.infer.optima import Optima
from eea.infer.search import search
from eea.infer.session import JointInference
from eea.infer.statement import NOTHING_BROKEN, Hypothesis, Part
from eea.infer.unknowns import FIXED_PRECISION
from tests.eea.infer.swing import CONFIG, PROBLEM, SIGMA, SWING, infer, simulate

SLIPPERY = "the arm has no friction"
ARM = Part(
    {"arm.length": "length", "arm.friction": "friction"}, area=("arm.length", "arm.friction")
)
ROBOT = replace(
    SWING,
    hypotheses=(*SWING.alternatives, Hypothesis(SLIPPERY, {"arm.friction": 0.0}, part="arm")),
    parts={"arm": ARM},
)


class Slippery:
    """A robot of which a part does nothing."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)

    def perform(self, command):
        numbers = {"arm.length": 1.3, "arm.friction": 0.0, "bias": 0.0, "motor": 1.0, "angle": 0.5}
        values = {name: np.array([value]) for name, value in numbers.items()}
        felt = simulate(values, command[None])[0]
        return RecordedLog(gyro=felt + SIGMA * self._rng.normal(size=felt.shape))


def weighed(method: JointInference) -> set[str]:
    belief = method.result.belief
    assert isinstance(belief, Answer)
    return {branch.hypothesis.name for branch in belief.branches}


def optima_of(method: JointInference) -> dict[str, Optima]:
    belief = method.result.belief
    assert isinstance(belief, Answer)
    return dict(belief.warm_start.optima)


def test_what_was_probable_is_weighed_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """A sliver explains a missing part a little better than none: that is no reason to forget."""
    method = JointInference(Slippery(2), ROBOT, PROBLEM, CONFIG)
    rounds = iter(method)
    next(rounds)
    assert SLIPPERY in weighed(method)
    monkeypatch.setattr(
        inference, "ABSENT_SIZE_SHARE", -1.0
    )  # from now on nothing seems to be absent
    next(rounds)
    assert SLIPPERY in weighed(method)
    assert method.result.belief.branches[0].hypothesis.name == SLIPPERY


def test_a_part_may_be_absent_though_the_best_has_some_of_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(inference, "ABSENT_SIZE_SHARE", 1e-9)
    method = JointInference(Slippery(2), ROBOT, PROBLEM, CONFIG)
    next(iter(method))
    assert optima_of(method)[NOTHING_BROKEN.name].fits.theta[0, 1] > 1e-9
    assert SLIPPERY in weighed(method)


def test_optimum_of_another_hypothesis_starts_the_search_without_fault(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Or a better search would pass for evidence."""

    def worse(regression: Regression, *args: Any, **settings: Any) -> Optima:
        found = search(regression, *args, **settings)
        if regression.parameters.prior_precision[1] == FIXED_PRECISION:  # the arm has no friction
            return found
        missed = found.fits.theta[:1].copy()
        missed[:, 0] = 0.1
        return replace(found, fits=Fitted(missed, np.array([1e3]), np.array([1e6])))

    monkeypatch.setattr(inference, "search", worse)
    method = JointInference(Slippery(2), ROBOT, PROBLEM, CONFIG)
    next(iter(method))
    assert optima_of(method)[SLIPPERY].fits.theta[0, 0] == pytest.approx(0.65, abs=0.01)
    assert optima_of(method)[NOTHING_BROKEN.name].fits.theta[0, 0] == pytest.approx(0.65, abs=0.01)


def test_hypotheses_that_fail_have_no_probability_in_the_findings() -> None:
    belief = infer(motor=0.0, alternatives="always").belief
    assert belief.good
    assert belief.findings[0].startswith("the motor is dead (")
    wrong = replace(belief.goodness, good=False, verdict="no body explains the log")
    assert replace(belief, goodness=wrong).findings[:2] == [
        "no body explains the log",
        "the best of the hypotheses that fail: the motor is dead",
    ]
