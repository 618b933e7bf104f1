"""Strategies of values that are not what an argument asks for.

Each ``no_...`` function answers one of the questions of ``aquafish_gym.utils.validation``
wrongly, in every way that we could think of: another type, another shape, a bad entry among
good ones, just beyond a bound and far beyond it, and names that are nearly right.
"""

from __future__ import annotations

import datetime
import math
from collections.abc import Callable, Iterable, Sequence
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

Values = st.SearchStrategy[Any]

# The same examples on every machine and in every run; time is no property under test.
CALM = settings(
    derandomize=True,
    database=None,
    deadline=None,
    max_examples=25,
    suppress_health_check=[HealthCheck.too_slow],
)


class Text(str):
    """Text of a class of its own."""


def _deep(depth: int) -> list[Any]:
    nested: list[Any] = []
    for _ in range(depth):
        nested = [nested]
    return nested


def _circle() -> list[Any]:
    circle: list[Any] = []
    circle.append(circle)
    return circle


# Made anew for every example: generators are used up, and lists may be written to.
STRANGERS: tuple[Callable[[], Any], ...] = (
    object,
    lambda: (i for i in range(3)),
    lambda: iter([0.1, 0.2, 0.3]),
    lambda: len,
    lambda: int,
    lambda: ...,
    lambda: NotImplemented,
    lambda: 1j,
    lambda: np.complex64(1),
    lambda: b"1",
    lambda: bytearray(b"123"),
    lambda: memoryview(b"123"),
    lambda: datetime.date(2020, 1, 1),
    lambda: datetime.timedelta(1),
    lambda: np.datetime64("2020-01-01"),
    lambda: np.timedelta64(1, "s"),
    lambda: np.ma.masked,
    lambda: {"a": 1.0},
    lambda: {0.0, 1.0},
    lambda: frozenset({0.5}),
    lambda: Exception("x"),
    lambda: np.dtype(float),
    lambda: np.zeros(3, [("a", "f8")]),
    lambda: np.array([1, 2, 3], "M8[s]"),
    lambda: np.array(["0", "1", "0"]),
    lambda: np.array([0, 1, 0], complex),
    lambda: np.array([None, 0.1, 0.2], object),
    lambda: np.array([object(), object(), object()], object),
    lambda: np.array([np.timedelta64(0, "s"), 0, 0], object),
    lambda: [[0.0, 0.1], [0.2]],
    lambda: _deep(20_000),
    _circle,
)
strangers: Values = st.sampled_from(STRANGERS).map(lambda make: make()) | st.one_of(
    st.binary(max_size=9),
    st.dictionaries(st.text(max_size=3), st.floats(), min_size=1, max_size=3),
    st.complex_numbers(allow_nan=True),
    st.datetimes(),
)
"""Neither a number, nor an array of any, nor a name."""

flags: Values = st.sampled_from([True, False, np.True_, np.False_])
digits: Values = st.sampled_from(["1", "0", "0.5", Text("1"), np.str_("0.5"), "½", "٣", "1_0"])


def _but(values: Values, valid: Sequence[object]) -> Values:
    """Leave out what happens to be valid, compared by identity and by type and value."""

    def is_valid(value: object) -> bool:
        return any(
            value is v or (type(value) is type(v) and isinstance(v, str | dict) and value == v)
            for v in valid
        )

    return values.filter(lambda value: not is_valid(value))


def spoiled(shape: tuple[int, ...], poison: Values, good: float = 0.0) -> Values:
    """Nested lists of ``shape`` that are ``good`` but for one entry."""
    size = math.prod(shape)

    def put(at: int, what: object) -> Any:
        flat = np.full(size, good, object)
        flat[at] = what
        return flat.reshape(shape).tolist()

    return st.builds(put, st.integers(0, size - 1), poison)


def beyond(low: float, high: float) -> Values:
    """Numbers just outside [low, high] and far outside it."""
    found: list[Any] = []
    if math.isfinite(low):
        found += [math.nextafter(low, -math.inf), low - 1, -1e300, -(10**30), Fraction(-(10**9))]
    if math.isfinite(high):
        found += [math.nextafter(high, math.inf), high + 1, 1e300, 10**30, Decimal(10**9)]
        found += [np.float32(high * 1.001 + 1), np.uint64(2**64 - 1)]
    return st.sampled_from(found)


_NOT_FINITE = st.sampled_from(
    [math.nan, math.inf, -math.inf, np.float32("nan"), np.longdouble("1e4000"), Decimal("NaN")]
)
_NOT_A_NUMBER = st.one_of(
    flags,
    digits,
    st.sampled_from([None, "", "nan", b"0", 1j, np.ma.masked, 10**400, np.timedelta64(0, "s"), {}]),
    st.builds(object),
)


def no_array(
    shape: tuple[int, ...],
    low: float = -math.inf,
    high: float = math.inf,
    good: float = 0.0,
    rows_too: bool = False,
) -> Values:
    """What is no array of ``shape`` with numbers from ``low`` to ``high``.

    With ``rows_too``, any number of rows of that shape would do as well.
    """
    other_shapes = hnp.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=4).filter(
        lambda s: s != shape and not (rows_too and s[1:] == shape)
    )
    wrong = [
        strangers,
        digits,
        st.none(),
        st.text(max_size=5),
        hnp.arrays(hnp.floating_dtypes(), other_shapes, elements=st.just(good)),
        hnp.arrays(
            st.one_of(hnp.boolean_dtypes(), hnp.complex_number_dtypes(), hnp.datetime64_dtypes()),
            shape,
        ),
        st.builds(lambda at: _masked(shape, good, at), st.integers(0)),
    ]
    if shape == ():
        wrong += [flags, _NOT_FINITE, st.just([0.0])]
        bounded: Callable[[Values], Values] = lambda v: v  # noqa: E731
    else:
        wrong += [spoiled(shape, _NOT_A_NUMBER, good), spoiled(shape, _NOT_FINITE, good)]
        wrong += [hnp.arrays(float, shape, elements=st.just(good)).map(lambda a: [*a.tolist(), 0])]
        bounded = lambda v: spoiled(shape, v, good)  # noqa: E731
    if math.isfinite(low) or math.isfinite(high):
        wrong += [bounded(beyond(low, high)), bounded(beyond(low, high)).map(np.array)]
    return st.one_of(wrong)


def _masked(shape: tuple[int, ...], good: float, at: int) -> Any:
    array = np.ma.masked_array(np.full(shape, good), np.zeros(shape, bool))
    array[np.unravel_index(at % array.size, shape) if shape else ()] = np.ma.masked
    return array


def no_whole(low: int, high: int | None = None, valid: Sequence[object] = ()) -> Values:
    """What is no whole number of at least ``low`` and at most ``high``."""
    inside = low + 1
    return _but(
        st.one_of(
            strangers,
            flags,
            digits,
            st.text(max_size=5),
            st.floats(),
            st.sampled_from(
                [
                    None,
                    float(inside),
                    np.float64(inside),
                    np.float16(inside),
                    Decimal(inside),
                    Fraction(inside),
                    np.array(inside),
                    np.array([inside]),
                    [inside],
                    (inside,),
                    math.nan,
                ]
            ),
            st.integers(max_value=low - 1),
            st.sampled_from([-(10**5000), -(10**20), low - 1, np.int64(low - 1)]),
            *([] if high is None else [st.integers(min_value=high + 1)]),
            *([] if high is None else [st.sampled_from([high + 1, 10**20, 10**5000])]),
        ),
        valid,
    )


def no_flag() -> Values:
    """What is neither True nor False, though it may count as one."""
    return st.one_of(
        strangers,
        digits,
        st.sampled_from([None, 0, 1, 1.0, "yes", "no", "True", "", [], [True], np.int8(1)]),
        st.just(np.array(True)),
        st.integers(),
    )


def near(names: Iterable[str]) -> Values:
    """Names that are nearly right: a slip of the finger, of the case, of the space bar."""
    slips: tuple[Callable[[str], str], ...] = (
        lambda n: n[1:],
        lambda n: n[:-1],
        lambda n: n[1] + n[0] + n[2:],
        lambda n: n + n[-1],
        lambda n: n.swapcase(),
        lambda n: f" {n}",
        lambda n: f"{n}\n",
        lambda n: f"{n}\0",
        lambda n: n.replace("a", "а").replace("e", "е"),  # noqa: RUF001  # Cyrillic
        lambda n: n.replace("_", "-"),
        lambda n: n * 10_000,
    )
    known = list(names)
    wrong = {slip(name) for slip in slips for name in known} - set(known)
    return st.sampled_from(sorted(wrong)).flatmap(
        lambda name: st.sampled_from([name, Text(name), np.str_(name)])
    )


def no_name(names: Iterable[str], valid: Sequence[object] = ()) -> Values:
    """What is not one of ``names``."""
    known = list(names)
    return _but(
        st.one_of(
            near(known),
            st.text(max_size=20).filter(lambda text: text not in known),
            strangers,
            digits,
            st.sampled_from([None, 0, 1, 0.5, math.nan, True, "", "\ud800", [known[0]], (known,)]),
            st.just(np.array(known)),
            st.integers().map(lambda n: 10 ** abs(n % 6000)),
        ),
        valid,
    )
