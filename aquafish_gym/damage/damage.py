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
from functools import partial
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.damage.breaking import break_part, break_sizes
from aquafish_gym.damage.draws import Draws, Parts, Spans, draw, make_stages, uniforms_of
from aquafish_gym.damage.draws import ways_to_break as ways_to_break
from aquafish_gym.damage.faults import Fault
from aquafish_gym.damage.tiers import TIERS
from aquafish_gym.damage.words import LINK_WORDS, PARTS, RANDOM, parts_of
from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import AQUAFISH, BodyPlan, PlanLike, check_plan
from aquafish_gym.plans.plan import SIZES
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.stages import NEVER
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    instance,
    integer,
    one_of,
    positive,
)

UNUSED = np.random.default_rng(0)  # the generator of a damage that draws nothing
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
    def random(cls, rng: np.random.Generator, plan: PlanLike = AQUAFISH) -> Self:
        """Return one or two broken fins of a plan, equally likely, each with one fault.

        A fin is missing one time in four; else its length, width or thickness is multiplied by 0.2
        to 0.9, uniformly. (``Damage.parse("random:moderate").sample(rng)`` breaks servos, too.)
        """
        instance("rng", rng, np.random.Generator)
        faults = []
        for fin in rng.permutation(check_plan(plan).names)[: rng.integers(1, 3)].tolist():
            missing = rng.random() < 0.25
            size = rng.choice(SIZES)
            factor = rng.uniform(*CHANCE_SCALES)
            faults.append(Fault(fin, "missing") if missing else Fault(fin, str(size), factor))
        return cls(tuple(faults))

    def said(self, whose: str = "the ") -> str:
        """Return what is broken in words, for people; ``str`` is for programs.

        ``whose`` is what stands before the name of a fin, with a space: "my ".

        Examples
        --------
        >>> Damage.parse("caudal:length=0.6;caudal:width=0.5;left_pectoral:missing").said()
        'the tail has 60% of its length and 50% of its width and the left flipper is missing'
        >>> Damage().said()
        'nothing is broken'
        """
        clauses: dict[str, list[str]] = {}
        for fault in self.faults:
            clauses.setdefault(fault.subject(whose), []).append(fault.said)
        said = [f"{part} {' and '.join(_without_has(all_of))}" for part, all_of in clauses.items()]
        return " and ".join(said) or "nothing is broken"

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
        return type(self)(tuple(self.draw([rng], parts).faults(0)))

    def draw(self, rngs: Sequence[np.random.Generator], parts: Parts = PARTS) -> Draws:
        """Return the damages of P episodes as arrays; :meth:`sample` returns one of them.

        Each of P generators draws one block of uniform numbers.
        """
        uniforms = np.empty((len(rngs), uniforms_of(self.faults)))
        if uniforms.shape[1]:
            for rng, row in zip(rngs, uniforms, strict=True):
                rng.random(out=row)
        return draw(self.faults, uniforms, parts)

    def check_onsets(self, seconds: float) -> None:
        """Raise InvalidArgumentError if a fault begins after an episode of ``seconds``."""
        positive("seconds", seconds)
        for fault in self.faults:
            latest = fault.onset[1] if isinstance(fault.onset, tuple) else fault.onset
            if latest >= seconds:
                raise InvalidArgumentError(
                    f"damage must strike before the episode ends at {seconds:g} s; got {fault}"
                )

    def check_parts(self, plan: BodyPlan) -> None:
        """Raise UnknownNameError if a fault is of a part that a plan's robot lacks."""
        for fault in self.faults:
            if fault.part != RANDOM and not fault.is_of_channels:
                one_of("damage part", fault.part, parts_of(plan))

    def check_fits(self, morphology: Morphology, dt: float = TIMESTEP) -> None:
        """Raise InvalidArgumentError if a fault is random, or at any time does not fit a robot.

        ``dt`` is the length of a control step, s.
        """
        self._check_certain(timed=True)
        intact = {"body": morphology.to_array()[None], "faults": np.zeros(1, np.int64)}
        make_stages(self.draw([UNUSED]), dt, intact, partial(_break_body, morphology.plan))

    def check_steps(self, dt: float) -> None:
        """Raise InvalidArgumentError if a delay, hold or growth fits no steps of ``dt`` s."""
        positive("dt", dt)
        for fault in self.faults:
            fault.check_steps(dt)

    def edit(self, scenario: Scenario, hold: int = 1) -> Scenario:
        """Return a scenario with this damage: faults at the start, and those that come later.

        Parameters
        ----------
        scenario
            B robots without changes. All are damaged alike.
        hold
            Physics steps of 0.01 s in a control step. A fault holds in the control steps that begin
            at its onset or later, and in one at least.

        Raises
        ------
        InvalidArgumentError
            If a fault does not fit a body, or is random, or the scenario has changes.
        """
        instance("scenario", scenario, Scenario)
        return edit_each(scenario, [self] * len(scenario), hold)

    def body(self, morphology: Morphology) -> Morphology:
        """Return a body with every fault of its fins, whenever they begin.

        InvalidArgumentError if a fault does not fit the body, or is random.
        """
        instance("morphology", morphology, Morphology)
        self._check_certain()
        sizes = morphology.to_array()[None]
        for fault in self.faults:
            number = np.nan if fault.number is None else fault.number
            columns = {"body": sizes}
            _break_body(morphology.plan, columns, slice(None), fault.part, fault.word, number)
        return Morphology.from_array(sizes[0], morphology.plan)

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

    def _check_certain(self, timed: bool = False) -> None:
        for fault in self.faults:
            fault.check_certain()
            if timed:
                _ = fault.span  # raises if it is random

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


def _without_has(clauses: Sequence[str]) -> list[str]:
    """Return what is said of one part, with one "has" for what follows each other."""
    before = ["", *clauses]
    return [
        clause.removeprefix("has ") if last.startswith("has ") else clause
        for last, clause in zip(before, clauses, strict=False)
    ]


def edit_each(
    scenario: Scenario,
    damages: Sequence[Damage],
    hold: int = 1,
    rngs: Sequence[np.random.Generator] | None = None,
) -> Scenario:
    """Return a scenario in which robot i has ``damages[i]``; see :meth:`Damage.edit`.

    With ``rngs``, a generator for each robot, random damages are drawn.
    """
    integer("hold", hold, 1, MAXIMUM_HOLD_STEPS)
    alike: dict[int, list[int]] = {}
    for i, damage in enumerate(damages):
        alike.setdefault(id(damage), []).append(i)
    distinct = [damages[rows[0]] for rows in alike.values()]
    if not any(damage.faults for damage in distinct):
        return scenario
    if len(scenario.until) > len(scenario):
        raise InvalidArgumentError(
            "scenario must have no changes yet, which its damage sets: put all faults of a "
            f"robot into one Damage; got {scenario!r}"
        )
    drawn = []
    for damage, rows in zip(distinct, alike.values(), strict=True):
        damage.check_steps(TIMESTEP * hold)
        if rngs is None:
            damage._check_certain(timed=True)
        own = [UNUSED if rngs is None else rngs[i] for i in rows]
        drawn.append(damage.draw(own, parts_of(scenario.plan)))
    draws = Draws.join(drawn, np.argsort(np.concatenate([*alike.values()])))
    stages = make_stages(
        draws, TIMESTEP * hold, scenario.columns(), partial(break_part, scenario.plan)
    )
    found = scenario.with_stages(
        stages._replace(
            since=stages.since * hold,
            until=np.where(stages.until == NEVER, NEVER, stages.until * hold),
            stride=hold,
        )
    )
    return replace(found, fin_angles=_first_angles(scenario, draws, TIMESTEP * hold))


def _first_angles(scenario: Scenario, draws: Draws, dt: float) -> Floats:
    """Return where fins (P, F) begin: those of dead servos anywhere, which is NaN."""
    found = scenario.fin_angles.copy()
    fins = scenario.plan.names
    active = Spans.of(draws, dt).first == 0
    for kind, (part, word) in draws.used:
        if word not in ("seized", "dead") or part not in fins:
            continue
        for i in range(draws.kind.shape[1]):
            rows = np.flatnonzero(active[:, i] & (draws.kind[:, i] == kind))
            number = draws.number[rows, i]
            kept = found[rows, fins.index(part)]
            held = np.where(np.isnan(number), kept, number)
            found[rows, fins.index(part)] = np.nan if word == "dead" else held
    return found


def _break_body(
    plan: BodyPlan,
    columns: Mapping[str, NDArray[Any]],
    rows: Any,
    part: str,
    word: str,
    number: Any,
) -> None:
    one_of("damage part", part, parts_of(plan))
    if part in plan.names:
        break_sizes(plan, columns["body"], rows, part, word, number)


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
