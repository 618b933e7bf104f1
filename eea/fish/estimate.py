"""The body that was inferred, and its words: verdict, sizes, what is uncertain, and what broke."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.bodies import plan_key
from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import AQUAFISH, BodyPlan
from eea.core.angles import Floats
from eea.core.checks import finite, instance
from eea.core.result import Result
from eea.fish.hypotheses import plan_of
from eea.fish.simulator import fish_problem

STATED_MASS = 0.9  # probability of the shown intervals
DIFFERENCE_MASS = 0.99  # probability of the intervals that decide whether a size differs
LEAST_CHANGE = 0.05  # of a size
WIDEST_STATED_INTERVAL = 0.5  # of a size: with a wider interval nothing is said of it


@dataclass(repr=False)
class MorphologyEstimate(Result):
    """The body that was inferred in a run or from logs; ``print`` shows it in words.

    Examples
    --------
    >>> from eea.core.config import PaperConfig
    >>> MorphologyEstimate(PaperConfig(), 0, fish_problem().models)
    MorphologyEstimate(out-of-band, 0 rounds of 256 steps, seed 0)
    """

    #: Changes tried on a log that no body explains: an ``eea.fish.log_checks.LogCheck``.
    check: Any = None
    plan: BodyPlan = AQUAFISH

    @classmethod
    def of(
        cls,
        answer: Any,
        truth: Morphology | ArrayLike | None = None,
        check: Any = None,
        seed: int = 0,
    ) -> Self:
        """Return the body of a posterior of the fish, such as one inferred from logs.

        Parameters
        ----------
        answer
            The posterior, an ``eea.infer.answer.Answer``.
        truth
            The body, if known, for OBJ_FIT.
        check, seed
            Changes tried on the log, and the seed of the inference.

        Raises
        ------
        ConfigurationError, InvalidArgumentError
            If ``answer`` is no posterior of a fish's sizes, or ``truth`` is no body.
        """
        from eea.infer.answer import Answer  # with scipy, which makes `import eea` slow

        instance("answer", answer, Answer)
        plan = plan_of(answer.robot)
        sizes = fish_problem(plan).models
        finite("answer.model", answer.model, (len(sizes),))
        body = None if truth is None else Morphology.coerce(truth, plan).to_array()
        return cls(None, seed, sizes, body, belief=answer, check=check, plan=plan)

    @property
    def morphology(self) -> Morphology:
        """The best model; joint inference rounds it to 1e-4 of each range.

        So the same seed gives the same body, and the same gait, on every processor.
        """
        return Morphology.from_array(self.body, self.plan)

    def interval(self, mass: float = 0.9) -> tuple[Floats, Floats]:
        """Return the ends (S,) of each size's interval, which holds the size in ``morphology``.

        See ``eea.core.result.Result.interval``.
        """
        low, high = super().interval(mass)
        point = self.morphology.to_array()
        return np.minimum(low, point), np.maximum(high, point)

    def to_dict(self) -> dict[str, Any]:
        """Return everything, ready for JSON; see ``eea.core.result.Result.to_dict``."""
        return super().to_dict() | plan_key(self.plan)

    def __str__(self) -> str:
        return "\n".join([*body_lines(self), *end_lines(self)])

    def __repr__(self) -> str:
        found = self.objective_fitness
        text = "logs"
        if self.config is not None:
            done = f"{len(self.rounds)} rounds of {self.config.steps} steps"
            text = f"{self.config.condition}, {done}"
        fitness = "" if found is None else f", OBJ_FIT {found:.3f}"
        return f"MorphologyEstimate({text}, seed {self.seed}{fitness})"


def body_lines(result: Result) -> list[str]:
    """Return a result in lines, from the verdict to the findings, without the last sentence."""
    if not result.complete:
        return ["no round was completed"]
    return [*_verdict_lines(result), *_size_table(result), *_belief_lines(result)]


def _verdict_lines(result: Result) -> list[str]:
    """Return sentences on whether a body explains the trials, and on the sizes if none does."""
    belief = result.belief
    if belief is None:
        return []
    lines = [belief.verdict]
    if not belief.good:
        share = belief.goodness.unexplained
        left = "" if share is None else f", which leave {share:.0%} of the motion unexplained"
        lines.append(
            f"these are the sizes of the best fit{left}; how far they are off is not known, so "
            "there are no intervals"
        )
    return lines


def _size_table(result: Result) -> list[str]:
    """Return the inferred sizes, with the true sizes and OBJ_FIT where known.

    Joint inference gives intervals, unless no body explains the trials.
    """
    columns = [[f" {size:6.3f}" for size in result.model]]
    heading = f"{'in units of 5 cm':26s}  found"
    if _explained(result):
        heading += f"  {STATED_MASS:.0%} interval   "
        columns.append(list(map(_ends, *result.interval(STATED_MASS))))
    if result.truth is not None:
        heading += "    true"
        columns.append([f"  {size:6.3f}" for size in result.truth])
    rows = zip(result.layout.names, *columns, strict=True)
    lines = [heading.rstrip(), *(f"{name:26s}{''.join(cells)}" for name, *cells in rows)]
    if result.truth is not None:
        lines.append(
            f"OBJ_FIT {result.objective_fitness:.2f}; the true body scores 1, "
            f"a random body {result.chance:.2f}, a mid-range body {result.mid_range:.2f}"
        )
    return lines


def _belief_lines(result: Result) -> list[str]:
    """Return the posterior of the nuisances and the findings, without the verdict."""
    belief = result.belief
    if belief is None:
        return []
    lines = []
    rows = belief.table(STATED_MASS)
    parameters = belief.branches[0].parameters
    common = [name for name, one in zip(rows, parameters.common, strict=True) if one]
    others = [name for name in common if name not in result.layout.names]
    heading = f"{'besides the body':26s} {'found':>6s}"
    if _explained(result):
        if result.truth is not None:
            low, high = result.interval(STATED_MASS)
            inside = int(((low <= result.truth) & (result.truth <= high)).sum())
            lines.append(
                f"the {STATED_MASS:.0%} intervals contain {inside} of the {len(low)} true sizes"
            )
        lines += [f"{heading}  {STATED_MASS:.0%} interval"] if others else []
        lines += [f"{name:26s} {rows[name][0]:z6.3f}{_ends(*rows[name][1:])}" for name in others]
    else:
        lines += [heading] if others else []
        lines += [f"{name:26s} {rows[name][0]:z6.3f}" for name in others]
    return [*lines, *(said for said in belief.findings if said != belief.verdict)]


def end_lines(result: Result) -> list[str]:
    """Return the last sentence: the damage, or possible mistakes of the log."""
    if not result.complete:
        return []
    if not _explained(result):
        check = getattr(result, "check", None)
        return [] if check is None else [str(check)]
    return [what_broke(result)]


def what_broke(result: Result) -> str:
    """Return a sentence that compares an inferred body with the undamaged fish."""
    best = result.belief.branches[0]
    robot = result.belief.robot
    clauses = []
    if best.hypothesis.name != robot.nominal.name:
        clauses.append(best.hypothesis.name)
    if robot.prior is not None:
        return f"compared with the body before, {' and '.join(clauses) or 'nothing is broken'}"
    plan = plan_of(robot)
    whole = plan.nominal
    low, high = result.interval(DIFFERENCE_MASS)
    unknown = high - low > WIDEST_STATED_INTERVAL * whole
    for fin, word in plan.words.items():
        own = [i for i, d in enumerate(plan.dimensions) if d.fin == fin]
        if best.hypothesis.part == word and all(result.model[own] == 0.0):
            continue
        absent = f"the {word} is absent"
        if any(said.startswith(absent) for said in result.belief.findings):
            clauses.append(f"the {word} is missing")
            continue
        shares = {plan.dimensions[i].size: _share(i, whole, low, high, result.model) for i in own}
        left = [f"{_percent(x)} of its {size}" for size, x in shares.items() if x is not None]
        if left:
            clauses.append(f"the {word} has {' and '.join(left)}")
    if unknown.all() and not clauses:
        return "the data do not tell what broke"
    known = "" if not unknown.any() else ", as far as the data tell"
    said = " and ".join(clauses) or "nothing is broken"
    return f"compared with the undamaged fish, {said}{known}"


def _share(i: int, whole: Floats, low: Floats, high: Floats, found: Floats) -> float | None:
    """Return a size as a share of the undamaged size; None if the size may be unchanged."""
    if (
        low[i] <= whole[i] <= high[i]
        or high[i] - low[i] > WIDEST_STATED_INTERVAL * whole[i]
        or abs(found[i] - whole[i]) < LEAST_CHANGE * whole[i]
    ):
        return None
    return float(found[i] / whole[i])


def _percent(share: float) -> str:
    """Return a share in percent: with a decimal where it would look like nothing."""
    return f"{share:.1%}" if 0.0 < share < 0.005 else f"{share:.0%}"


def _explained(result: Result) -> bool:
    return result.belief is not None and bool(result.belief.good)


def _ends(low: float, high: float) -> str:
    return f"  {low:z6.3f} to {high:z5.3f}"
