"""Faults as text.

In text a fault is ``part:word`` or ``part:word=number``, and faults are joined by ``;`` or ``,``:
``left_pectoral:length=0.5; caudal:missing``. ``@onset`` and ``+duration``, in seconds, limit it to
a part of an episode, ``caudal:seized@4+2``; with a dash the onset is random, ``random:mild@2-8``.
"""

from __future__ import annotations

import re
from typing import Any

from aquafish_gym.damage.faults import Fault, kind_of
from aquafish_gym.utils.validation import InvalidArgumentError, brief

MAXIMUM_FAULTS = 100  # that one robot may have
# Numbers may have a sign of their own only behind an e.
_TIME = r"[^-+@]+?(?:[eE][-+]?\d+)?"
_WHEN = re.compile(
    rf"(?P<what>[^@]*)(?:@(?P<onset>{_TIME})(?:-(?P<latest>{_TIME}))?(?:\+(?P<duration>{_TIME}))?)?"
)


def check_count(count: int) -> None:
    """Refuse more faults than ``MAXIMUM_FAULTS``."""
    if count > MAXIMUM_FAULTS:
        raise InvalidArgumentError(
            f"damage must be at most {MAXIMUM_FAULTS} faults of one robot; got {count}"
        )


def faults_from_text(text: str) -> tuple[Fault, ...]:
    """Return the faults of a text; it has none if it is empty or ``none``."""
    if not isinstance(text, str):
        raise InvalidArgumentError(f"damage must be text to be parsed; got {brief(text)}")
    if text.strip().lower() in ("", "none"):
        return ()
    parts = text.replace(",", ";").split(";")
    check_count(len(parts))
    return tuple(map(_fault_from_text, parts))


def _fault_from_text(text: str) -> Fault:
    when = _WHEN.fullmatch(text.strip())
    part, colon, what = (one.strip() for one in (when["what"] if when else "").partition(":"))
    if not when or not colon or not what:
        raise InvalidArgumentError(
            "damage must be written part:word=number, as left_pectoral:length=0.5 or "
            "caudal:missing, with @onset+duration in s where it does not last throughout; got "
            f"{brief(text.strip())}"
        )
    word, equals, digits = (one.strip() for one in what.partition("="))
    kind_of(part, word)  # refuses unknown names before numbers
    number = _number(f"damage {part}:{word}", digits) if equals else None
    times = {
        name: _number(f"damage {name}", when[name])
        for name in ("onset", "latest", "duration")
        if when[name]
    }
    onset: Any = times.get("onset", 0.0)
    if "latest" in times:
        onset = (onset, times["latest"])
    return Fault(part, word, number, onset, times.get("duration"))


def _number(name: str, digits: str) -> float:
    try:
        return float(digits)
    except ValueError:
        got = brief(digits.strip())
        raise InvalidArgumentError(f"{name} needs a number; got {got}") from None
