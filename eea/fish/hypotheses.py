"""What may be broken, as hypotheses of joint inference: words of the damage grammar about fins."""

from __future__ import annotations

import numpy as np

from aquafish_gym.damage import Damage, Fault
from aquafish_gym.damage.words import PARTS, SERVO_WORDS, needs_number
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.scenario import Scenario
from eea.infer.statement import Hypothesis, Number

#: The switch of each fin's servo.
SERVO = {fin: f"servo of the {word}" for fin, word in AQUAFISH.words.items()}

ANYWHERE = Number(0.0)  # in the range, as a change
REACTIVE_WATER = "reactive water"
AS_COMMANDED = Hypothesis("every servo does as it is told")

# Sizes are inferred under every hypothesis, so a shorter or an entangled fin needs none. The same
# command holds throughout a trial, so a late or slow servo is refused.
FIN_FAULTS = ("missing", "seized", "dead", "reversed", "weak")


def fault_hypothesis(fin: str, word: str) -> Hypothesis:
    """Return the hypothesis that a fin is missing, or what a word says of its servo.

    It fixes what the fault sets: the fin's sizes, or the servo's speed. If the word takes a number,
    that is inferred. A servo that stands still has one angle in all trials, unless the fault leaves
    its angle to chance.
    """
    subject = SERVO[fin] if word in SERVO_WORDS else AQUAFISH.words[fin]
    name = f"the {subject} is {word}"
    if word in SERVO_WORDS and needs_number(PARTS[fin][word]):
        return Hypothesis(name, moves={SERVO[fin]: ANYWHERE}, part=AQUAFISH.words[fin])
    whole = Scenario.create()
    broken = Damage((Fault(fin, word),)).edit(whole)
    before = whole.body[0].tolist()
    after = broken.body[0].tolist()
    fixed = {d.name: after[i] for i, d in enumerate(AQUAFISH.dimensions) if after[i] != before[i]}
    speed = broken.servo_gain[0, AQUAFISH.names.index(fin)]
    angle = broken.fin_angles[0, AQUAFISH.names.index(fin)]
    if word in SERVO_WORDS:
        fixed[SERVO[fin]] = float(speed)
    stands = speed == 0.0 and np.isfinite(angle)
    moves = {fin: Number.angle(varies=False)} if stands else {}
    return Hypothesis(name, fixed, moves, part=AQUAFISH.words[fin])


#: The tail's sweep is symmetric: reversal only shifts its phase.
HYPOTHESES: tuple[Hypothesis, ...] = (
    *(
        fault_hypothesis(fin, word)
        for word in FIN_FAULTS
        for fin in AQUAFISH.words
        if (fin, word) != ("caudal", "reversed")
    ),
    Hypothesis("the water also resists acceleration", {REACTIVE_WATER: 1.0}),
)
