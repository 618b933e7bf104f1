"""Swims side by side from one start line, for films and replays."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle, islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.plans import AQUAFISH, BodyPlan
from aquafish_gym.rendering.scene import CM_PER_UNIT, Colour, fish_room, floor_below
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    fits,
    instance,
    sequence,
    spelled,
    utf8_text,
)

_GAP = 1.1  # least distance between the rooms of two fish, units
# Blue, vermilion, green, purple, orange: distinct for the colour-blind (Okabe and Ito).
TRAILS = ((0, 114, 178), (213, 94, 0), (0, 130, 95), (150, 60, 120), (180, 120, 0))


class FilmedSwim(NamedTuple):
    """A swim for a film: a label and T samples. It is shown until it diverges.

    Examples
    --------
    >>> bodies, broken = np.ones((2, 9)), np.zeros((2, 3), bool)
    >>> still = np.zeros((2, 3)), np.tile((0, 0, 0, 1), (2, 1)), np.zeros((2, 3))
    >>> FilmedSwim("at rest", np.array([0.0, 1.0]), bodies, broken, *still).label
    'at rest'
    """

    label: str
    time: Floats  #: (T,) s
    bodies: Floats  #: (T, S) sizes
    broken: NDArray[np.bool_]  #: (T, F) which fins are broken
    position: Floats  #: (T, 3)
    quaternion: Floats  #: (T, 4)
    fin_angles: Floats  #: (T, F)
    plan: BodyPlan = AQUAFISH


def _widths(plan: BodyPlan) -> dict[str, tuple[int, ...]]:
    """Return the shape of a sample in each column."""
    return {
        "time": (),
        "bodies": (len(plan.dimensions),),
        "broken": (len(plan.fins),),
        "position": (3,),
        "quaternion": (4,),
        "fin_angles": (len(plan.fins),),
    }


class Course(NamedTuple):
    """Swims in lanes along y, the first the farthest to the left."""

    lanes: list[FilmedSwim]
    colours: list[Colour]  #: Colours of the trails.
    floor: float  #: Height of the floor.
    ends: tuple[float, float]  #: Ends of the start line, x.
    marks: list[tuple[float, str]]  #: Distances along y, with labels.


def lay_out(swims: Sequence[FilmedSwim]) -> Course:
    """Return the course of one swim or more."""
    if not len(sequence("swims", swims)):
        raise InvalidArgumentError("swims must be at least one; got none")
    for i, swim in enumerate(swims):
        _check(f"swims[{i}]", swim)
    lanes: list[FilmedSwim] = []
    rooms = [fish_room(swim.plan) for swim in swims]
    x = 0.0
    for i, swim in enumerate(swims):
        good = np.logical_and.accumulate(np.isfinite(swim.position).all(axis=1))
        lane = swim._replace(**{name: getattr(swim, name)[good] for name in _widths(swim.plan)})
        if lanes:
            x += (rooms[i - 1] + rooms[i]) / 2 + _GAP
        shift = x - lane.position[:, 0].min()
        lanes.append(lane._replace(position=lane.position + np.array([shift, 0.0, 0.0])))
        x = lanes[-1].position[:, 0].max()
    everywhere = np.concatenate([lane.position for lane in lanes])
    furthest = float(everywhere[:, 1].max())
    spacing = next((one for one in (2, 4, 10) if furthest < 4.5 * one), 20)  # 10 cm to 1 m
    places = [float(y) for y in np.arange(0.0, max(furthest, spacing / 2), spacing)]
    return Course(
        lanes,
        list(islice(cycle(TRAILS), len(lanes))),
        floor_below(everywhere, max(rooms)),
        (-rooms[0], x + rooms[-1]),
        [(y, f"{CM_PER_UNIT * y:z.0f} cm" if y else "start") for y in places],
    )


def _check(argument: str, swim: FilmedSwim) -> None:
    """Raise unless ``swim`` is a swim with columns of the right shapes; numbers may be NaN."""
    instance(argument, swim, FilmedSwim)
    utf8_text(f"the label of {argument}", swim.label)
    instance(f"{argument}.plan", swim.plan, BodyPlan)
    samples = len(np.atleast_1d(swim.time))
    for name, width in _widths(swim.plan).items():
        column = np.asarray(getattr(swim, name))
        shape = (samples, *width)
        if not fits(column.shape, shape) or column.dtype.kind not in "fiub":
            raise InvalidArgumentError(
                f"{argument}.{name} must be numbers of shape {spelled(shape)}; "
                f"got {column.dtype} of shape {column.shape}"
            )
