"""One fault: a word about a part, and when.

``aquafish_gym.damage.words`` has the words, and ``aquafish_gym.damage.breaking`` what they change.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from aquafish_gym.damage.tiers import TIERS, Tier
from aquafish_gym.damage.transmit import MAXIMUM_DELAY_STEPS, STEP_ROUNDING
from aquafish_gym.damage.words import (
    BODY_WORDS,
    CHANNEL_WORDS,
    FIN_WORDS,
    LONGEST_SECONDS,
    PARTS,
    PHRASES,
    RANDOM,
    SHORTEST_SECONDS,
    Range,
    Words,
    can_grow,
    needs_number,
)
from aquafish_gym.plans import KNOWN_FINS
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    finite_array,
    instance,
    one_of,
)

MAXIMUM_GROWTH_STEPS = 1000  # two faults of one number change it in each of them
WEIGHT_TOLERANCE = 1e-8  # by which the weights of a tier may miss 1, as of numpy's choice
_CHANNEL = re.compile(r"(action|observation)(?:_([0-9]{1,9})(?:-([0-9]{1,9}))?)?")


@dataclass(frozen=True)
class Fault:
    """One thing that breaks, and when.

    Attributes
    ----------
    part
        A fin of one of the ``PLANS``, "gyro", one of ``CHANNELS``, or "random"; for
        ``FaultWrapper``, "action" or "observation", with the numbers of its channels: "action_0",
        "observation_3-5".
    word
        What happens to it: a key of ``PARTS[part]`` or ``CHANNEL_WORDS``, or a tier.
    number
        What the word takes, or None.
    onset
        In s; or the earliest and the latest, between which it is drawn.
    duration
        In s; None is until the end.
    growth
        In s; until then from the onset the number grows evenly, from the one that changes nothing.
        None is at once.

    Raises
    ------
    InvalidArgumentError, UnknownNameError
        If there is no such part or word, or a number is missing or out of range, here or in the
        tier.

    Examples
    --------
    >>> str(Fault("caudal", "seized", onset=4, duration=2))
    'caudal:seized@4.0+2.0'
    >>> str(Fault("gyro_z", "bias", 0.2, onset=4, growth=3))
    'gyro_z:bias=0.2@4.0~3.0'
    """

    part: str
    word: str
    number: float | None = None
    onset: float | tuple[float, float] = 0.0
    duration: float | None = None
    growth: float | None = None

    def __post_init__(self) -> None:
        words = words_of(self.part)
        wanted = words[one_of("damage", self.word, words)]
        name = f"damage {self.part}:{self.word}"
        if self.part == RANDOM:
            _check_tier(name, TIERS[self.word])
        if self.number is not None:
            if wanted is None:
                raise InvalidArgumentError(f"{name} takes no number; got {brief(self.number)}")
            self._check("number", name, wanted)
        elif needs_number(wanted):
            raise InvalidArgumentError(
                f"{name} needs a number, for example {self.part}:{self.word}=0.5"
            )
        if isinstance(self.onset, list | tuple):
            early, late = finite_array(
                "damage onset", self.onset, (2,), 0.0, LONGEST_SECONDS, "s"
            ).tolist()
            if early > late:
                raise InvalidArgumentError(
                    f"damage onset must be the earliest and the latest; got {early:g} and {late:g}"
                )
            object.__setattr__(self, "onset", (early, late))
        else:
            self._check("onset", "damage onset", Range(0.0, LONGEST_SECONDS, unit="s"))
        lasting = Range(SHORTEST_SECONDS, LONGEST_SECONDS, unit="s")
        if self.duration is not None:
            self._check("duration", "damage duration", lasting)
        if self.growth is not None:
            self._check(
                "growth", "damage growth", Range(SHORTEST_SECONDS, LONGEST_SECONDS, unit="s")
            )
            if self.part != RANDOM and not can_grow(self.word, wanted):
                growing = [word for word, number in words.items() if can_grow(word, number)]
                raise InvalidArgumentError(
                    f"{name} strikes at once: of {self.part}, {' and '.join(growing)} can grow; "
                    f"got the growth {self.growth:g} s"
                )
        angle = self.word == "seized" and self.number is not None and self.part in KNOWN_FINS
        if angle and self.onset != 0.0:
            raise InvalidArgumentError(
                f"damage {self.part}:seized has an angle only from the beginning, since a fin "
                f"cannot get there later; got {self.number:g} with the onset {self.onset}"
            )

    def _check(self, field: str, name: str, wanted: Range) -> None:
        value = finite_array(name, getattr(self, field), (), wanted.low, wanted.high, wanted.unit)
        object.__setattr__(self, field, float(value))

    @property
    def changes_body(self) -> bool:
        """Whether it changes a fin's sizes, and nothing else."""
        return self.word in BODY_WORDS

    @property
    def is_random(self) -> bool:
        """Whether it must be sampled before it can be applied."""
        return self.part == RANDOM or isinstance(self.onset, tuple)

    @property
    def span(self) -> tuple[float, float]:
        """When it begins and when it ends, in s."""
        if isinstance(self.onset, tuple):
            raise InvalidArgumentError(
                f"damage {self} leaves its onset to chance: sample it first (Damage.sample)"
            )
        return self.onset, self.onset + (np.inf if self.duration is None else self.duration)

    @property
    def is_timed(self) -> bool:
        """Whether it takes the length of a step to say what it does."""
        late = self.word in ("delay", "hold") or self.growth is not None
        return late or self.onset != 0.0 or self.duration is not None

    def check_steps(self, dt: float) -> None:
        """Raise InvalidArgumentError for a delay, hold or growth that fits no steps of ``dt`` s."""
        if self.growth is not None and self.growth / dt > MAXIMUM_GROWTH_STEPS:
            raise InvalidArgumentError(
                f"damage {self} must grow within {MAXIMUM_GROWTH_STEPS} steps of {dt:g} s; "
                f"got {self.growth:g} s"
            )
        if self.word not in ("delay", "hold") or self.number is None:
            return
        steps, wanted = self.number / dt, f"at least a step, {dt:g} s"
        if self.word == "hold":
            wanted = f"longer than a step, {dt:g} s"
        short = (
            steps < 1.0 - STEP_ROUNDING if self.word == "delay" else steps <= 1.0 + STEP_ROUNDING
        )
        if short or steps > MAXIMUM_DELAY_STEPS:
            wanted = wanted if short else f"at most {MAXIMUM_DELAY_STEPS} steps of {dt:g} s"
            raise InvalidArgumentError(
                f"damage {self.part}:{self.word} must be {wanted}; got {self.number:g} s"
            )

    @property
    def is_of_channels(self) -> bool:
        """Whether it is of an environment's channels, and none of the fish."""
        return _CHANNEL.fullmatch(self.part) is not None

    def check_certain(self) -> None:
        """Raise InvalidArgumentError where it is random, or is none of a robot's."""
        if self.part == RANDOM:
            raise InvalidArgumentError(
                f"damage {self} is left to chance: sample it first (Damage.sample)"
            )
        if self.is_of_channels:
            raise InvalidArgumentError(
                f"damage {self} is of an environment's channels: give it to FaultWrapper"
            )

    def __str__(self) -> str:
        text = f"{self.part}:{self.word}" + ("" if self.number is None else f"={self.number!r}")
        onset, lasts = self.onset, "" if self.duration is None else f"+{self.duration!r}"
        lasts += "" if self.growth is None else f"~{self.growth!r}"
        if isinstance(onset, tuple):
            return f"{text}@{onset[0]!r}-{onset[1]!r}{lasts}"
        return text + (f"@{onset!r}{lasts}" if onset or lasts else "")

    def subject(self, whose: str = "the ") -> str:
        """Return what it is about, in words."""
        if self.part == RANDOM:
            return f"something {self.word}"
        words = KNOWN_FINS | {"gyro": "gyroscope"}
        return whose + words[self.part] if self.part in words else self.part

    @property
    def said(self) -> str:
        """What it says of its subject, in words: ``has 50% of its length from 4 s on``."""
        if self.part == RANDOM:
            return f"breaks{self._when}"
        phrase = PHRASES[self.word]
        wanted = words_of(self.part)[self.word]
        if self.number is None or wanted is None:
            return phrase.replace(" at #", "") + self._when
        number = f"{self.number:.3g} {wanted.unit}".rstrip()
        if wanted.neutral == 1.0:
            number = f"{self.number:.0%}"
            if number in ("0%", "100%") and self.number not in (0.0, 1.0):
                number = f"{self.number:.1%}"  # it is not nothing, and not the whole
        return phrase.replace("#", number) + self._when

    @property
    def _when(self) -> str:
        """When it holds, in words; empty if throughout."""
        onset = self.onset
        if isinstance(onset, tuple):
            begins = f" at a time between {onset[0]:g} and {onset[1]:g} s"
        else:
            begins = f" from {onset:g} s on" if onset or self.duration or self.growth else ""
        lasts = "" if self.duration is None else f" for {self.duration:g} s"
        grows = "" if self.growth is None else f", growing for {self.growth:g} s"
        return begins.removesuffix(" on" if lasts else "") + lasts + grows


def words_of(part: object) -> Words:
    """Return the words about a part; UnknownNameError if there is no such part."""
    part = instance("damage part", part, str)
    if part == RANDOM:
        return dict.fromkeys(TIERS)
    if found := _CHANNEL.fullmatch(part):
        side, first, last = found.groups()
        if last is not None and int(first) > int(last):
            raise InvalidArgumentError(
                f"damage part must name its lowest channel first; got {part!r}; "
                f"did you mean '{side}_{last}-{first}'?"
            )
        return CHANNEL_WORDS[side]
    for side in CHANNEL_WORDS:
        if part.lower().startswith(side[:3]):
            raise InvalidArgumentError(
                f"damage part must be {side}, {side}_0 or {side}_0-2 to be of the {side}; "
                f"got {brief(part)}"
            )
    known = {**PARTS, **dict.fromkeys(KNOWN_FINS, FIN_WORDS)}
    return known[one_of("damage part", part, (*known, RANDOM, *CHANNEL_WORDS))]


def channels_of(part: str) -> tuple[str, slice]:
    """Return "action" or "observation", and which channels of that side a part is.

    InvalidArgumentError if it is a part of the fish.
    """
    found = _CHANNEL.fullmatch(part)
    if found is None:
        raise InvalidArgumentError(f"damage part must be of actions or observations; got {part!r}")
    side, first, last = found.groups()
    return side, slice(None) if first is None else slice(int(first), int(last or first) + 1)


def _check_tier(name: str, tier: Tier) -> None:
    """Raise InvalidArgumentError if a tier, such as a user's, has a fault that no part can have.

    Or if its weights are no probabilities.
    """
    weights = finite_array(
        f"the weights of {name}", [one.weight for one in tier.chances], (None,), 0.0
    )
    if abs(weights.sum() - 1.0) > WEIGHT_TOLERANCE:
        raise InvalidArgumentError(f"the weights of {name} must sum to 1; got {weights.sum():g}")
    for chance in tier.chances:
        tables = [words_of(part) for part in chance.parts or (*PARTS, *CHANNEL_WORDS)]
        known = dict.fromkeys(word for words in tables for word in words)
        one_of(f"the word of {name}", chance.word, known)
        numbers = [words[chance.word] for words in tables if chance.word in words]
        ranges = [number for number in numbers if needs_number(number)]
        if ranges and not any(n.low <= chance.low <= chance.high <= n.high for n in ranges):
            raise InvalidArgumentError(
                f"the number of {chance.word} in {name} must be from a low to a high in "
                f"[{ranges[0].low:g}, {ranges[0].high:g}]; got {chance.low:g} to {chance.high:g}"
            )
