"""Something that breaks, and when, in seconds of an episode.

When a fault ends, what was broken is whole again.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from aquafish_gym.damage.effect import Effect
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array

SHORTEST, LONGEST = 1e-3, 1e6  # s


@dataclass(frozen=True, kw_only=True)
class Fault:
    """Something that breaks, and when.

    Attributes
    ----------
    onset
        In s; or the earliest and the latest, between which chance decides.
    duration
        In s; None is for good.
    """

    onset: float | tuple[float, float] = 0.0
    duration: float | None = None

    def __post_init__(self) -> None:
        if isinstance(self.onset, list | tuple):
            row = finite_array("damage onset", self.onset, (2,), 0.0, LONGEST, "s")
            early, late = row.tolist()
            if early > late:
                raise InvalidArgumentError(
                    f"damage onset must be the earliest and the latest; got {early:g} and {late:g}"
                )
            object.__setattr__(self, "onset", (early, late))
        else:
            set_number(self, "onset", 0.0, LONGEST, "s")
        if self.duration is not None:
            set_number(self, "duration", SHORTEST, LONGEST, "s")

    @property
    def what(self) -> str:
        """What breaks, in text."""
        raise NotImplementedError

    @property
    def words(self) -> str:
        """What breaks, in words; nothing where the body that is left says it."""
        return self.what

    @property
    def when(self) -> str:
        """When it is there, in words; nothing if it always is."""
        onset, lasts = self.onset, self.duration
        if isinstance(onset, tuple):
            since = f"from some time between {onset[0]:g} and {onset[1]:g} s on"
            return since if lasts is None else f"{since}, for {lasts:g} s"
        if lasts is not None:
            return f"from {onset:g} to {onset + lasts:g} s"
        return f"from {onset:g} s on" if onset else ""

    def strike(self, robot: Effect) -> Effect:
        """Return the robot with this fault."""
        raise NotImplementedError

    def drawn(self, rng: np.random.Generator) -> tuple[Fault, ...]:
        """Return what it comes to: itself, unless it leaves something to chance."""
        return (self.at(rng),)

    def at(self, rng: np.random.Generator) -> Self:
        """Return it with an onset that chance has decided."""
        if not isinstance(self.onset, tuple):
            return self
        return replace(self, onset=float(rng.uniform(*self.onset)))

    @property
    def is_random(self) -> bool:
        """Whether it leaves something to chance."""
        return isinstance(self.onset, tuple)

    @property
    def span(self) -> tuple[float, float]:
        """When it begins and when it ends, in s."""
        if isinstance(self.onset, tuple):
            raise InvalidArgumentError(
                f"damage {self} leaves its onset to chance: draw it first (Damage.drawn)"
            )
        return self.onset, self.onset + (np.inf if self.duration is None else self.duration)

    def __str__(self) -> str:
        onset, lasts = self.onset, "" if self.duration is None else f"+{self.duration!r}"
        if isinstance(onset, tuple):
            return f"{self.what}@{onset[0]!r}-{onset[1]!r}{lasts}"
        return self.what + (f"@{onset!r}{lasts}" if onset or lasts else "")


def set_number(
    fault: Fault, name: str, low: float, high: float = np.inf, unit: str = "", of: str = ""
) -> None:
    value = finite_array(f"damage {of or name}", getattr(fault, name), (), low, high, unit)
    object.__setattr__(fault, name, float(value))


def named(name: str) -> Any:
    """Return a field that says what kind of fault it is.

    So that ``asdict``, and with it an environment's ``spec.to_json()``, can be read back.
    """
    return field(default=name, init=False, repr=False)
