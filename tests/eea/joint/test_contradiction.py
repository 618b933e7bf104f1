"""Trials that no one body explains: which of them is not like the others."""

from __future__ import annotations

import pytest

from eea.joint.contradiction import contradiction


def told(bodies: str) -> str:
    """Return what is said of trials of these bodies, one letter each; x is of none."""
    names = [f"trial {i}" for i in range(1, len(bodies) + 1)]

    def fits(some: tuple[int, ...]) -> bool:
        assert len(some) < len(bodies) or len(bodies) == 1
        return len({bodies[trial] for trial in some} | {"x"}) == 2 and all(
            bodies[trial] != "x" for trial in some
        )

    return contradiction(names, fits)


SEVERAL = "each trial alone is explained by a body, but all together by none: they may be of"


@pytest.mark.parametrize(
    ("bodies", "said"),
    [
        ("aba", "trial 2 does not fit with the others, which one body explains"),
        ("aaab", "trial 4 does not fit with the others"),
        ("ab", SEVERAL),
        ("aabb", SEVERAL),
        ("axa", "trial 2 fits no body even alone; one body explains the others"),
        ("xa", "trial 1 fits no body even alone; one body explains the others"),
        ("xaxa", "trial 1 and trial 3 fit no body even alone; one body explains the others"),
        ("axb", "trial 2 fits no body even alone; a body explains each, none all, of the others"),
        ("xx", "no body explains even one of the trials alone"),
        ("x", "no body explains even one of the trials alone"),
    ],
)
def test_the_odd_one_is_named(bodies: str, said: str) -> None:
    assert told(bodies).startswith(said)
