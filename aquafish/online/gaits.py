"""The library's gaits, and which of some swims farthest on the self-model from its very state."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from aquafish.online import thresholds
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.utils.storage import read_document, read_packaged
from aquafish_gym.utils.validation import InvalidArgumentError, brief, instance
from aquafish_gym.world_config import WorldConfig
from gait.controllers.controller import Controller
from gait.swims.scores import scores

LIBRARY_SCHEMA = "aquafish.library/1"


def read_library(path: Path | None = None) -> dict[str, Any]:
    """Return the content of a library: its ``gaits``, and what they took, ``offline``.

    It is the packaged one for None. ``experiments.gaits.library`` made that.
    """
    if path is not None:
        return read_document(path, LIBRARY_SCHEMA, "library")
    return read_packaged("aquafish.online", "library.json", LIBRARY_SCHEMA)


def load_library(path: Path | None = None) -> list[Controller]:
    """Return the gaits of a library: two for the whole robot, then those for broken ones."""
    return [Controller.from_dict(one) for one in read_library(path)["gaits"]]


def check_library(library: Sequence[Controller], hold: int) -> list[Controller]:
    """Return the gaits of a library, each of which holds an action for ``hold`` steps."""
    if not isinstance(library, list | tuple) or not library:
        raise InvalidArgumentError(f"library must have a gait; got {brief(library)}")
    for gait in library:
        instance("library", gait, Controller)
        if gait.interval != hold or gait.senses.goal:
            raise InvalidArgumentError(
                f"library must have gaits without a goal whose interval is hold, {hold} steps; "
                f"got {gait!r}"
            )
    return list(library)


def imagine(
    controllers: Sequence[Controller], robot: Scenario, state: Floats, seconds: float
) -> Floats:
    """Return how far (P,) controllers would swim along +y from a state (25,), in units.

    ``robot`` is a scenario of one. The controllers know its fin angles and servo gains.
    """
    world = WorldConfig.of(robot)
    far = scores(controllers, robot.body[0], seconds=seconds, world=world, threads=1, start=state)
    return far[:, 0]


def gait_to_refine(
    swum: Controller | None,
    gaits: Sequence[Controller],
    robot: Scenario,
    state: Floats,
    seconds: float,
) -> Controller | None:
    """Return the gait that is swum; if it is too large to refine, the best small one, if any.

    The others are compared as by :func:`imagine`. ``swum`` is None for a teacher's.
    """
    if swum is not None and swum.nodes <= thresholds.MAXIMUM_REFINED_NODES:
        return swum
    small = [gait for gait in gaits if gait.nodes <= thresholds.MAXIMUM_REFINED_NODES]
    return small[int(imagine(small, robot, state, seconds).argmax())] if small else None
