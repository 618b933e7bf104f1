"""The damage of a robot: its faults, as text, and how they edit its scenario.

In text a fault is ``part:word`` or ``part:word=number``, and faults are joined by ``;`` or ``,``:
``left_pectoral:length=0.5; caudal:missing``. ``@onset`` and ``+duration``, in seconds, limit it to
a part of an episode, ``caudal:seized@4+2``; with a dash the onset is random, ``random:mild@2-8``.
``~growth`` lets its number grow from the onset on: ``gyro_z:bias=0.2@4~3``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from itertools import chain
from typing import Any, Self

import numpy as np

from aquafish_gym.damage.faults import Fault
from aquafish_gym.damage.tiers import TIERS, Chance, Tier
from aquafish_gym.damage.words import LINK_WORDS, PARTS, RANDOM, Words, can_grow, needs_number
from aquafish_gym.morphology import FINS, SIZES, Morphology
from aquafish_gym.scenario import TIMESTEP, Change, Scenario
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.utils.validation import InvalidArgumentError, brief, instance, integer, positive

Parts = Mapping[str, Words]
MAXIMUM_HOLD_STEPS = 10**6  # physics steps in a control step
MAXIMUM_FAULTS = 100  # that one robot may have
CHANCE_SCALES = 0.2, 0.9  # of what a size was, where any fin may break


@dataclass(frozen=True)
class Damage:
    """Everything that is broken, in the order in which it is applied.

    What it cannot be made of raises InvalidArgumentError, an unknown name UnknownNameError.

    Examples
    --------
    >>> damage = Damage.parse("left_pectoral:length=0.5; caudal:missing")
    >>> damage.apply(Morphology.nominal()).left_pectoral
    (0.4, 0.8, 0.1)
    >>> str(damage)
    'left_pectoral:length=0.5;caudal:missing'
    """

    faults: tuple[Fault, ...] = ()

    def __post_init__(self) -> None:
        # Faults have an order, which sets lack, and an end, which generators may lack.
        rows = isinstance(self.faults, list | tuple)
        if not rows or not all(isinstance(fault, Fault) for fault in self.faults):
            raise InvalidArgumentError(f"damage must be a list of faults; got {brief(self.faults)}")
        if len(self.faults) > MAXIMUM_FAULTS:
            raise InvalidArgumentError(
                f"damage must be at most {MAXIMUM_FAULTS} faults of one robot; "
                f"got {len(self.faults)}"
            )
        object.__setattr__(self, "faults", tuple(self.faults))

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the damage of faults joined by ``;`` or ``,``; empty text or ``none`` is none."""
        if not isinstance(text, str):
            raise InvalidArgumentError(f"damage must be text to be parsed; got {brief(text)}")
        if text.strip().lower() in ("", "none"):
            return cls()
        return cls(tuple(map(_fault_from_text, text.replace(",", ";").split(";"))))

    @classmethod
    def coerce(cls, value: object) -> Damage:
        """Return damage from text, a list of faults or what ``to_list`` returns; None is none.

        A list of texts or of damages is refused, as it might be of several robots.
        """
        match value:
            case None:
                return cls()
            case Damage():
                return value
            case str():
                return cls.parse(value)
            case list() | tuple() if is_list_of_faults(value):
                return cls(tuple(map(_fault_from, value)))
            case {"faults": faults}:  # as Gymnasium writes a dataclass in a specification
                return cls.coerce(faults)
        texts = isinstance(value, list | tuple) and all(isinstance(one, str) for one in value)
        raise InvalidArgumentError(
            "damage must be one text, such as 'left_pectoral:length=0.5; caudal:missing' or "
            "'action_0:dead', a Damage, or a list of faults of one robot; "
            f"got {brief(value)}{': join texts of one robot by ;' if texts else ''}"
        )

    @classmethod
    def random(cls, rng: np.random.Generator) -> Self:
        """Return one or two broken fins, equally likely, each with one fault.

        A fin is missing one time in four; else its length, width or thickness is multiplied by 0.2
        to 0.9, uniformly. (``Damage.parse("random:moderate").sample(rng)`` breaks servos, too.)
        """
        instance("rng", rng, np.random.Generator)
        faults = []
        for fin in rng.permutation(FINS)[: rng.integers(1, 3)].tolist():
            missing = rng.random() < 0.25
            size = rng.choice(SIZES)
            factor = rng.uniform(*CHANCE_SCALES)
            faults.append(Fault(fin, "missing") if missing else Fault(fin, str(size), factor))
        return cls(tuple(faults))

    @property
    def is_random(self) -> bool:
        """Whether it must be sampled before it can be applied."""
        return any(fault.is_random for fault in self.faults)

    @property
    def may_be_late(self) -> bool:
        """Whether it makes channels late, slow or scaled, or may by chance."""
        words = {fault.word for fault in self.faults if fault.part != RANDOM}
        tiers = [TIERS[fault.word] for fault in self.faults if fault.part == RANDOM]
        words |= {chance.word for tier in tiers for chance in tier.chances}
        return not words.isdisjoint(LINK_WORDS)

    @property
    def certain(self) -> Self:
        """The faults that are not drawn."""
        return type(self)(tuple(fault for fault in self.faults if not fault.is_random))

    def sample(self, rng: np.random.Generator, parts: Parts = PARTS) -> Self:
        """Return the damage of one episode, with random faults, of ``parts``, and onsets drawn.

        Faults of a tier that need a part outside ``parts`` are left out.
        """
        instance("rng", rng, np.random.Generator)
        instance("parts", parts, Mapping)  # type: ignore[type-abstract]
        if not self.is_random:
            return self
        return type(self)(tuple(chain.from_iterable(_sample(f, rng, parts) for f in self.faults)))

    def check_onsets(self, seconds: float) -> None:
        """Raise InvalidArgumentError if a fault begins after an episode of ``seconds``."""
        positive("seconds", seconds)
        for fault in self.faults:
            latest = fault.onset[1] if isinstance(fault.onset, tuple) else fault.onset
            if latest >= seconds:
                raise InvalidArgumentError(
                    f"damage must strike before the episode ends at {seconds:g} s; got {fault}"
                )

    def check_fits(self, morphology: Morphology, dt: float = TIMESTEP) -> None:
        """Raise InvalidArgumentError if a fault is random, or at any time does not fit a robot.

        ``dt`` is the length of a control step, s.
        """
        for _, active in self.stages(dt):
            _resized(morphology, active)

    def check_steps(self, dt: float) -> None:
        """Raise InvalidArgumentError if a delay, hold or growth fits no steps of ``dt`` s."""
        positive("dt", dt)
        for fault in self.faults:
            fault.check_steps(dt)

    def edit(self, scenario: Scenario, hold: int = 1) -> Scenario:
        """Return a scenario with this damage: faults at the start, the others in its schedule.

        Parameters
        ----------
        scenario
            B robots without a schedule. All are damaged alike.
        hold
            Physics steps of 0.01 s in a control step. A fault holds in the control steps that begin
            at its onset or later, and in one at least.

        Raises
        ------
        InvalidArgumentError
            If a fault does not fit a body, or is random, or the scenario has a schedule.
        """
        instance("scenario", scenario, Scenario)
        integer("hold", hold, 1, MAXIMUM_HOLD_STEPS)
        if not self.faults:
            return scenario
        if scenario.schedule:
            raise InvalidArgumentError(
                "scenario must have no schedule yet, which its damage sets: put all faults of a "
                f"robot into one Damage; got {scenario!r}"
            )
        rows = np.arange(len(scenario))
        self.check_steps(TIMESTEP * hold)
        (_, start), *later = (
            (step, _break(scenario, active)) for step, active in self.stages(TIMESTEP * hold)
        )
        schedule = tuple(Change(step * hold, rows, stage) for step, stage in later)
        return replace(start, schedule=schedule)

    def stages(self, dt: float) -> list[tuple[int, tuple[Fault, ...]]]:
        """Return the active faults at step 0, and at each later one where they begin or end.

        Steps are of ``dt`` s. A fault holds in the steps that begin at its onset or later, and in
        one at least. One that grows changes in each step until it has its full size.
        InvalidArgumentError if an onset is random, or a growth takes too many steps.
        """
        positive("dt", dt)
        spans = [(fault, *fault.steps(dt)) for fault in self.faults]

        def active(now: int) -> tuple[Fault, ...]:
            return tuple(
                f.grown(now - first, dt)
                for f, first, end in spans
                if first <= now and (end is None or now < end)
            )

        changes = {step for _, *span in spans for step in span if step is not None}
        for fault, first, end in spans:
            grown = first + fault.growing_steps(dt)
            changes |= set(range(first, grown if end is None else min(grown, end)))
        return [(now, active(now)) for now in sorted({0, *changes})]

    def body(self, morphology: Morphology) -> Morphology:
        """Return a body with every fault of its fins, whenever they begin.

        InvalidArgumentError if a fault does not fit the body, or is random.
        """
        instance("morphology", morphology, Morphology)
        return Morphology.from_array(_resized(morphology, self.faults))

    def apply(self, morphology: Morphology) -> Morphology:
        """Return :meth:`body`; InvalidArgumentError if something else is broken, or not always."""
        body = self.body(morphology)
        for fault in self.split()[1]:
            raise InvalidArgumentError(
                "damage of a body must be of its fins' sizes, and last throughout; got "
                f"{fault}, which environments and an eea.EngineTarget can have"
            )
        return body

    def split(self) -> tuple[Self, Self]:
        """Return the damage that only changes the body, throughout, and the rest."""
        parts: tuple[list[Fault], list[Fault]] = ([], [])
        for fault in self.faults:
            lasting = fault.changes_body and not fault.is_timed
            parts[0 if lasting else 1].append(fault)
        return type(self)(tuple(parts[0])), type(self)(tuple(parts[1]))

    def __iter__(self) -> Iterator[Fault]:
        return iter(self.faults)

    def __len__(self) -> int:
        return len(self.faults)

    def __str__(self) -> str:
        return ";".join(map(str, self.faults)) or "none"

    def to_list(self) -> list[dict[str, Any]]:
        """Return the faults as objects ready for JSON; ``growth`` is that of those which grow."""
        listed = [asdict(fault) for fault in self.faults]
        for fault in listed:
            if fault["growth"] is None:
                del fault["growth"]
        return listed


def edit_each(scenario: Scenario, damages: Sequence[Damage], hold: int = 1) -> Scenario:
    """Return a scenario in which robot i has ``damages[i]``; see :meth:`Damage.edit`.

    Robots with the same ``Damage`` object are edited together.
    """
    alike: dict[int, list[int]] = {}
    for i, damage in enumerate(damages):
        alike.setdefault(id(damage), []).append(i)
    if len(alike) == 1:
        return damages[0].edit(scenario, hold)
    edited = [damages[rows[0]].edit(scenario.take(rows), hold) for rows in alike.values()]
    return Scenario.concatenate(edited).take(np.argsort(np.concatenate([*alike.values()])))


def _break(scenario: Scenario, faults: list[Fault] | tuple[Fault, ...]) -> Scenario:
    """Return a scenario in which faults are active from the start."""
    broken = scenario.copy()
    for fault in faults:
        fault.edit(broken)
    broken.faults[:] += len(faults)
    return broken


def _resized(morphology: Morphology, faults: Sequence[Fault]) -> Floats:
    """Return the sizes (9,) of a body with the faults of its fins."""
    body = morphology.to_array()[None]
    for fault in faults:
        fault.edit_sizes(body)
    sizes: Floats = body[0]
    return sizes


def _sample(fault: Fault, rng: np.random.Generator, parts: Parts) -> list[Fault]:
    """Return a fault with its onset drawn; of a tier, faults of different parts that begin then."""
    onset = fault.onset
    if isinstance(onset, tuple):
        onset = float(rng.uniform(*onset))
    if fault.part != RANDOM:
        return [replace(fault, onset=onset)]
    tier = TIERS[fault.word]
    whole = dict(parts)
    found = []
    for _ in range(tier.parts):
        ways = ways_to_break(tier, whole)
        if not ways:
            break
        weights = np.array([chance.weight for chance, _ in ways])
        if len(ways) < len(tier.chances):
            weights /= weights.sum()
        chance, fitting = ways[rng.choice(len(ways), p=weights)]
        word, part = chance.word, str(rng.choice(fitting))
        number = float(rng.uniform(chance.low, chance.high))
        number *= int(rng.choice((-1, 1))) if word == "bias" else 1
        taken = number if needs_number(whole.pop(part)[word]) else None
        grows = fault.growth if can_grow(word, parts[part][word]) else None
        found.append(replace(fault, part=part, word=word, number=taken, onset=onset, growth=grows))
    return found


def ways_to_break(tier: Tier, parts: Parts) -> list[tuple[Chance, list[str]]]:
    """Return a tier's chances that fit any of the parts, each with those it fits."""
    fitting = (
        [part for part in parts if chance.word in parts[part] and part in (chance.parts or parts)]
        for chance in tier.chances
    )
    return [(chance, fits) for chance, fits in zip(tier.chances, fitting, strict=True) if fits]


def is_list_of_faults(value: object) -> bool:
    """Return whether a value lists one robot's faults, and not damages of several robots."""
    return isinstance(value, list | tuple) and all(
        isinstance(one, Fault) or (isinstance(one, Mapping) and "part" in one) for one in value
    )


def _fault_from(value: Fault | Mapping[str, Any]) -> Fault:
    """Return a fault, or that of ``Damage.to_list``."""
    if isinstance(value, Fault):
        return value
    try:
        return Fault(**value)
    except TypeError:
        names = ", ".join(one.name for one in fields(Fault))
        raise InvalidArgumentError(
            f"a fault must have the fields {names}; got {brief(dict(value))}"
        ) from None


_TIME = r"\s*(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?\s*"
_FAULT = re.compile(
    r"(?P<part>[^:=@]+):(?P<word>[^:=@+]+)(?:=(?P<number>[^:=@]*))?"
    rf"(?:@(?P<onset>{_TIME})(?:-(?P<latest>{_TIME}))?(?:\+(?P<duration>{_TIME}))?"
    rf"(?:~(?P<growth>{_TIME}))?)?"
)


def _fault_from_text(text: str) -> Fault:
    found = _FAULT.fullmatch(text)
    try:
        if found is None:
            raise ValueError
        number, onset, latest, duration, growth = (
            None if digits is None else float(digits)
            for digits in found.group("number", "onset", "latest", "duration", "growth")
        )
    except ValueError:
        said = text.strip()
        timed = re.sub(r"(?=[+~][^+@]*$)", "@0", said)  # a duration needs its onset
        hint = (
            f"; did you mean {brief(timed)}?" if timed != said and _FAULT.fullmatch(timed) else ""
        )
        raise InvalidArgumentError(
            "damage must be written part:word=number, as left_pectoral:length=0.5, caudal:missing "
            "or action_0:dead, with @onset+duration in s where it does not last throughout, and "
            "~growth in s where it grows; got "
            f"{brief(said)}{hint}"
        ) from None
    begin = onset or 0.0
    return Fault(
        found["part"].strip(),
        found["word"].strip(),
        number,
        begin if latest is None else (begin, latest),
        duration,
        growth,
    )
