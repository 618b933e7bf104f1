"""What may be broken, as hypotheses of joint inference: words of the damage grammar about fins."""

from __future__ import annotations

import functools

import numpy as np

from aquafish_gym.damage.breaking import break_part
from aquafish_gym.damage.words import BODY_WORDS, FIN_WORDS, needs_number
from aquafish_gym.plans import AQUAFISH, BodyPlan, check_plan
from aquafish_gym.scenario import Scenario
from eea.infer.statement import Hypothesis, Number, RobotModel

ANYWHERE = Number(0.0)  # in the range, as a change
REACTIVE_WATER = "reactive water"
AS_COMMANDED = Hypothesis("every servo does as it is told")

# Sizes are inferred under every hypothesis, so a shorter or an entangled fin needs none. The same
# command holds throughout a trial, so a late or slow servo is refused.
FIN_FAULTS = ("missing", "seized", "dead", "reversed", "weak")


def plan_of(robot: RobotModel) -> BodyPlan:
    """Return the body plan of a fish as joint inference knows it."""
    return AQUAFISH if robot.plan is None else check_plan(robot.plan)


def is_reactive(robot: RobotModel) -> bool:
    """Return whether the water resists acceleration, unless the trials tell otherwise."""
    water = robot.table.get(REACTIVE_WATER)
    return water is not None and water.mean == 1.0


@functools.cache
def servo_names(plan: BodyPlan) -> dict[str, str]:
    """Return the name of the switch of each fin's servo."""
    return {fin: f"servo of the {word}" for fin, word in plan.words.items()}


def fault_hypothesis(plan: BodyPlan, fin: str, word: str) -> Hypothesis:
    """Return the hypothesis that a fin is missing, or what a word says of its servo.

    It fixes what the fault sets: the fin's sizes, or the servo's speed. If the word takes a number,
    that is inferred. A seized servo has one angle in all trials; a dead one's is left to chance.
    """
    servo = servo_names(plan)[fin]
    part = plan.words[fin]
    name = f"the {part if word in BODY_WORDS else servo} is {word}"
    if needs_number(FIN_WORDS[word]):
        return Hypothesis(name, moves={servo: ANYWHERE}, part=part)
    broken = Scenario.create(plan=plan).copy()
    break_part(plan, broken.columns(), slice(None), fin, word, np.nan)
    if word in BODY_WORDS:
        sizes = zip(plan.dimensions, broken.body[0].tolist(), strict=True)
        return Hypothesis(name, {d.name: size for d, size in sizes if d.fin == fin}, part=part)
    speed = float(broken.servo_gain[0, plan.names.index(fin)])
    moves = {fin: Number.angle(varies=False)} if word == "seized" else {}
    return Hypothesis(name, {servo: speed}, moves, part=part)


@functools.cache
def fault_hypotheses(plan: BodyPlan, reactive: bool = False) -> tuple[Hypothesis, ...]:
    """Return what may be broken, but the sizes of fins, and that the water is of the other kind.

    A sweep is symmetric: reversal only shifts its phase.
    """
    broken = [
        fault_hypothesis(plan, fin.name, word)
        for word in FIN_FAULTS
        for fin in plan.fins
        if fin.turns or word != "reversed"
    ]
    other = "does not resist" if reactive else "also resists"
    fixed = {REACTIVE_WATER: 0.0 if reactive else 1.0}
    return (*broken, Hypothesis(f"the water {other} acceleration", fixed))
