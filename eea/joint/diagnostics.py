"""What a posterior tells and what it cannot, in plain sentences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from eea.core.checks import ConfigurationError, real, whole
from eea.joint.posterior import Posterior

Floats = NDArray[np.float64]

MASS = 0.9  # of the intervals that are judged
AT_BOUND = 1e-6  # of a range
DRAWS = 512  # of a mode, for where its body lies
NOTHING = "the data tell next to nothing of the body: each size may be almost any"
FEW = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine")


@dataclass(frozen=True)
class Group:
    """Parameters that belong together, such as a fin's sizes, and what to say of them.

    Examples
    --------
    >>> Group("the tail", ("length", "width"), (0, 1), (0.0, 0.0), (2.0, 1.0), area=(0, 1)).hint
    ''
    """

    name: str  #: As in a sentence: "the tail".
    labels: tuple[str, ...]  #: Of its parameters: "length", "width", "thickness".
    indices: tuple[int, ...]  #: Where each is in the posterior; none circular.
    low: tuple[float, ...]  #: What the least value of each means, in its unit.
    high: tuple[float, ...]  #: And the greatest.
    #: Which two make an area by their product; none for what is no fin.
    area: tuple[int, ...] | None = None
    hint: str = ""  #: What trial would tell them apart: "a faster tail would tell".

    def __post_init__(self) -> None:
        for argument in ("indices", "low", "high"):
            if len(getattr(self, argument)) != len(self.labels):
                raise ConfigurationError(
                    f"{argument} of {self.name} must be one for each of its "
                    f"{len(self.labels)} labels; got {len(getattr(self, argument))}"
                )
        if self.area is not None and len(self.area) != 2:
            raise ConfigurationError(f"area of {self.name} must be two places; got {self.area}")
        for place in self.area or ():
            whole("area", place, 0, len(self.labels) - 1)


def findings(
    posterior: Posterior,
    groups: Sequence[Group],
    *,
    absent: float = 0.02,
    tied: float = 0.8,
    tied_width: float = 0.1,
    untold: float = 0.5,
    least_weight: float = 0.05,
    beyond: float = 4.0,
) -> list[str]:
    """Return sentences on what is absent or larger than can be, trades off, or is not told.

    Parameters
    ----------
    posterior
        What is known.
    groups
        The parameters to speak of; of the others nothing is said.
    absent
        A group is absent if its area's 95% quantile is under this share of the greatest area; of
        its sizes nothing else is said then, as they have no effect.
    tied, tied_width
        Two parameters trade off if they correlate by more than ``tied``, either sign, and the 90%
        interval of each is wider than ``tied_width`` of its range.
    untold
        The data do not tell a parameter whose 90% interval is wider than this share of its range,
        and which trades off with none.
    least_weight
        Bodies of a smaller probability are not told of.
    beyond
        A parameter may be larger than its range allows if the best fit would be so many sd outside.

    Raises
    ------
    ConfigurationError
        If a group names a parameter that is not there, or an angle, or a share is not in [0, 1].

    Examples
    --------
    >>> from eea.joint.posterior import Mode
    >>> mode = Mode([0.0, 0.5], [[1e4, 0.0], [0.0, 0.0]], cost=0.0)
    >>> found = Posterior(("length", "width"), [0, 0], [1, 1], [False, False], [mode])
    >>> tail = Group("the tail", ("length", "width"), (0, 1), (0.0, 0.0), (2.0, 1.0), area=(0, 1))
    >>> findings(found, [tail])
    ['the tail is absent: its area is at most 0.025']
    """
    for name, share in (
        ("absent", absent), ("tied", tied), ("tied_width", tied_width),
        ("untold", untold), ("least_weight", least_weight),
    ):  # fmt: skip
        real(name, share, 0.0, 1.0)
    real("beyond", beyond, 0.0)
    for group in groups:
        for index in group.indices:
            whole(f"indices of {group.name}", index, 0, len(posterior.names) - 1)
            if posterior.circular[index]:
                raise ConfigurationError(
                    f"indices of {group.name} must be of sizes; got {posterior.names[index]}, "
                    "an angle"
                )
    said = []
    speak: list[tuple[Group, int]] = []  # group and place of what may be told
    for group in groups:
        sentence = _absence(posterior, group, absent)
        if sentence:
            said.append(sentence)
        else:
            speak += [(group, place) for place in range(len(group.labels))]
    low, high = posterior.interval(MASS)
    width = (high - low) / (posterior.high - posterior.low)
    if len(speak) > 1 and min(width[_index(one)] for one in speak) > untold:
        return [*said, NOTHING]
    said += [_beyond(posterior, one) for one in speak if _is_beyond(posterior, _index(one), beyond)]
    said += _bodies(posterior, speak, least_weight)
    trading = set()
    for first, second in combinations(speak, 2):
        a, b = _index(first), _index(second)
        if abs(posterior.correlation[a, b]) > tied and min(width[a], width[b]) > tied_width:
            trading |= {a, b}
            hint = (first if width[a] >= width[b] else second)[0].hint
            said.append(f"{_both(first, second)} trade off" + (f"; {hint}" if hint else ""))
    for one in speak:
        index = _index(one)
        if width[index] > untold and index not in trading:
            ends = _value(one, posterior, np.array([low[index], high[index]]))
            said.append(
                f"the data do not tell {_called(one)}: anything from {ends[0]:.2g} to {ends[1]:.2g}"
                + (f"; {one[0].hint}" if one[0].hint else "")
            )
    return said


def _absence(posterior: Posterior, group: Group, absent: float) -> str | None:
    """Return that the group is absent, if it is."""
    if group.area is None:
        return None
    sides = [_value((group, place), posterior, posterior.draws) for place in group.area]
    most = float(np.quantile(sides[0] * sides[1], 0.95))
    if most > absent * np.prod([group.high[place] for place in group.area]):
        return None
    return f"{group.name} is absent: its area is at most {most:.2g}"


def _is_beyond(posterior: Posterior, index: int, beyond: float) -> bool:
    """Return whether the most probable mode is held by a parameter's upper bound, and how hard.

    With the information A and the slope g there, the best fit lies -A^-1 g away.
    """
    mode = posterior.modes[int(np.argmax(posterior.weights))]
    if mode.gradient[index] >= 0.0 or mode.theta[index] < posterior.high[index] - AT_BOUND:
        return False
    spread = np.linalg.pinv(mode.information, hermitian=True)
    return bool(-spread[index] @ mode.gradient > beyond * np.sqrt(spread[index, index]))


def _beyond(posterior: Posterior, one: tuple[Group, int]) -> str:
    end = _value(one, posterior, posterior.high[None])[0]
    return f"{_called(one)} is at the end of its range, {end:.2g}, and may be beyond it"


def _bodies(posterior: Posterior, speak: Sequence[tuple[Group, int]], least: float) -> list[str]:
    """Return that several bodies explain the data, if so: modes that differ in what is spoken of.

    Modes of other angles or nuisances are one body; two are if each size of theirs is within two
    sd, or a hundredth of its range.
    """
    if not speak or len(posterior.modes) == 1:
        return []
    indices = [_index(one) for one in speak]
    reach = 0.01 * (posterior.high - posterior.low)[indices]
    bodies: list[tuple[float, Floats, Floats]] = []  # weight, median, sd
    for place in np.argsort(-posterior.weights, kind="stable"):
        drawn = posterior.components[place].sample(DRAWS, np.random.default_rng(0))[:, indices]
        middle, spread = np.median(drawn, axis=0), drawn.std(axis=0)
        weight = float(posterior.weights[place])
        for k, (known, there, wide) in enumerate(bodies):
            if (np.abs(middle - there) <= np.maximum(2.0 * np.maximum(spread, wide), reach)).all():
                bodies[k] = (known + weight, there, wide)
                break
        else:
            bodies.append((weight, middle, spread))
    bodies = sorted((b for b in bodies if b[0] >= least), key=lambda b: -b[0])
    if len(bodies) < 2:
        return []
    # Only what differs between them is worth saying.
    differ = [
        k for k in range(len(speak))
        if np.ptp([body[1][k] for body in bodies])
        > max(reach[k], 2.0 * max(body[2][k] for body in bodies))
    ]  # fmt: skip
    parts = []
    for weight, middle, _ in bodies:
        whole_body = np.zeros((1, len(posterior.names)))
        whole_body[0, indices] = middle
        sizes = " and ".join(
            f"{_called(speak[k])} {_value(speak[k], posterior, whole_body)[0]:.2g}" for k in differ
        )
        parts.append(f"{weight:.0%} {sizes}")
    count = FEW[len(bodies)] if len(bodies) < len(FEW) else str(len(bodies))
    return [f"{count} bodies explain it: " + ", or ".join(parts)]


def _index(one: tuple[Group, int]) -> int:
    return one[0].indices[one[1]]


def _called(one: tuple[Group, int]) -> str:
    return f"{one[0].name}'s {one[0].labels[one[1]]}"


def _both(first: tuple[Group, int], second: tuple[Group, int]) -> str:
    if first[0] is second[0]:
        return f"{_called(first)} and {second[0].labels[second[1]]}"
    return f"{_called(first)} and {_called(second)}"


def _value(one: tuple[Group, int], posterior: Posterior, points: Floats) -> Floats:
    """Return a parameter in its unit, of points (count, P) or of values of its own (count,)."""
    group, place = one
    index = group.indices[place]
    values = points[:, index] if points.ndim == 2 else points
    share = (values - posterior.low[index]) / (posterior.high[index] - posterior.low[index])
    return np.asarray(group.low[place] + share * (group.high[place] - group.low[place]))
