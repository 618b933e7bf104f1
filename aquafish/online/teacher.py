"""The teacher: a policy that is given what broke.

In reinforcement learning a teacher is a policy with privileged inputs (A. Kumar and others, "RMA:
Rapid motor adaptation for legged robots", 2021). This one needs no student: the agent infers
exactly the privileged inputs.
"""

from __future__ import annotations

import base64
import binascii
import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

import numpy as np

from aquafish.online.gaits import load_library
from aquafish_gym.bodies import plan_key
from aquafish_gym.plans import AQUAFISH, BodyPlan, check_plan, check_same_plan
from aquafish_gym.scenario import CHANNELS
from aquafish_gym.utils.storage import read_document, read_packaged, write_document
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    file_path,
    finite_array,
    instance,
    sequence,
)
from gait.controllers.controller import Controller
from gait.controllers.dense import Singles
from gait.controllers.network import Senses

TEACHER_SCHEMA = "aquafish.teacher/1"
INTERVAL = 20  # steps of 0.01 s that an action is held
HIDDEN = (128, 64)  # nodes
_LARGEST_WEIGHT = float(np.finfo(np.float16).max)


@dataclass(frozen=True, eq=False)
class Teacher:
    """A network with hidden layers of 128 and 64 exponential linear units, given what broke.

    Its inputs are, in this order, for a plan of F fins and S sizes: the directions up and north in
    body axes (6); the gyroscope times 0.5, clipped to [-1, 1] (3); sine and cosine of the clock of
    the library's first gait (2); sine and cosine of each fin angle (2 F); the previous action (F);
    the clipped action of that gait for the inputs before the previous action (F); the sizes
    relative to the nominal ones minus 1 (S); the servo gains minus 1 (F). The output, clipped to
    [-1, 1], is the action (F,), which is held for 0.2 s.

    Parameters
    ----------
    weights
        Arrays of the shapes of :func:`shapes_of`.
    offline
        What its training took: simulated robot ``steps`` of 0.01 s, and CPU ``seconds``.
    curve
        [actions of all robots, mean return of their last episodes] in training.
    plan
        Of the robots.

    Raises
    ------
    InvalidArgumentError
        If a weight is missing, unknown, of another shape, or beyond half precision.
    """

    weights: dict[str, Singles]
    offline: dict[str, float]
    curve: Sequence[Sequence[float]] = ()
    plan: BodyPlan = AQUAFISH

    def __post_init__(self) -> None:
        given = instance("weights", self.weights, dict)
        shapes = shapes_of(instance("plan", self.plan, BodyPlan))
        _check_names("weights", given, shapes)
        weights = {
            name: finite_array(
                f"weights[{name!r}]", given[name], shape, -_LARGEST_WEIGHT, _LARGEST_WEIGHT
            ).astype(np.float32)
            for name, shape in shapes.items()
        }
        offline = instance("offline", self.offline, dict)
        _check_names("offline", offline, ("steps", "seconds"))
        for name, spent in offline.items():
            finite_array(f"offline[{name!r}]", spent, (), 0.0)
        curve: tuple[Sequence[float], ...] = ()
        if len(sequence("curve", self.curve)):
            curve = tuple(map(tuple, finite_array("curve", self.curve, (None, 2)).tolist()))
        vars(self).update(weights=weights, offline=offline, curve=curve)

    @classmethod
    def load(cls, path: Path | str | None = None) -> Self:
        """Read a teacher's file, by default the packaged ``teacher.json``.

        Raises
        ------
        InvalidArgumentError
            If it cannot be read, is damaged, or is no teacher.
        """
        if path is None:
            return cls._packaged("teacher.json")
        file = file_path("teacher", path)
        return cls._from_document(str(file), read_document(file, TEACHER_SCHEMA, "teacher"))

    @classmethod
    def load_any_water(cls) -> Self:
        """Read the packaged teacher that was trained in random water."""
        return cls._packaged("teacher_any_water.json")

    @classmethod
    def _packaged(cls, name: str) -> Self:
        return cls._from_document(name, read_packaged("aquafish.online", name, TEACHER_SCHEMA))

    @classmethod
    def _from_document(cls, name: str, document: dict[str, Any]) -> Self:
        try:
            plan = check_plan(document.pop("plan", AQUAFISH))
            _check_names("fields", document, ("offline", "curve", "weights"))
            weights = decode_weights(document["weights"], shapes_of(plan))
            return cls(weights, document["offline"], document["curve"], plan)
        except InvalidArgumentError as error:
            raise InvalidArgumentError(f"teacher: {name}: {error}") from None

    def save(self, path: Path | str) -> None:
        """Write a file of some 35 KB: the weights in half precision, as base64."""
        document = {
            **plan_key(self.plan),
            "offline": self.offline,
            "curve": self.curve,
            "weights": encode_weights(self.weights),
        }
        write_document(file_path("path", path), document, TEACHER_SCHEMA)


def shapes_of(plan: BodyPlan) -> dict[str, tuple[int, ...]]:
    """Return the shapes of a plan's weights: ``w`` (out, in) and ``b`` (out,) of each layer."""
    fins = len(plan.fins)
    layers = (sensed(plan) + 2 * fins + privileged(plan), *HIDDEN, fins)
    shapes: dict[str, tuple[int, ...]] = {}
    for i, (before, nodes) in enumerate(pairwise(layers)):
        shapes[f"w{i}"] = (nodes, before)
        shapes[f"b{i}"] = (nodes,)
    return shapes


def sensed(plan: BodyPlan) -> int:
    """Return how many of the inputs, the first, are those of the library's first gait."""
    return len(CHANNELS) + 2 + 2 * len(plan.fins)


def privileged(plan: BodyPlan) -> int:
    """Return how many of the inputs, the last, are constant in a swim: sizes and servo gains."""
    return len(plan.dimensions) + len(plan.fins)


@functools.cache
def first_gait(plan: BodyPlan) -> Controller:
    """Return the first gait of a plan's packaged library, whose action a teacher is given.

    InvalidArgumentError if it is no feed-forward network.
    """
    gait = load_library(plan)[0]
    if gait.memory or gait.senses != Senses(fins=True):
        raise InvalidArgumentError(
            f"teachers need a packaged library of the plan {plan.name} whose first gait is a "
            f"feed-forward network that senses its fins; got {gait!r}"
        )
    return gait


def encode_weights(weights: Mapping[str, Singles]) -> dict[str, str]:
    """Return arrays in half precision, as base64."""
    return {
        name: base64.b64encode(value.astype("<f2").tobytes()).decode()
        for name, value in weights.items()
    }


def decode_weights(given: object, shapes: Mapping[str, tuple[int, ...]]) -> dict[str, Singles]:
    """Return arrays of some shapes, as :func:`encode_weights` gives them.

    Raises
    ------
    InvalidArgumentError
        If an array is missing, unknown, or no base64 of its shape.
    """
    texts = instance("weights", given, dict)
    _check_names("weights", texts, shapes)
    return {name: _decoded(name, texts[name], shape) for name, shape in shapes.items()}


def _check_names(argument: str, given: Mapping[str, Any], wanted: Sequence[str] | Any) -> None:
    if set(given) != set(wanted):
        raise InvalidArgumentError(
            f"{argument} must be named {', '.join(wanted)}; got {brief(sorted(given))}"
        )


def _decoded(name: str, text: object, shape: tuple[int, ...]) -> Singles:
    """Return an array of half precision from base64."""
    try:
        numbers = np.frombuffer(base64.b64decode(instance(name, text, str), validate=True), "<f2")
        return numbers.astype(np.float32).reshape(shape)
    except (binascii.Error, ValueError):
        raise InvalidArgumentError(
            f"weights[{name!r}] must be base64 of {shape} numbers of half precision; "
            f"got {brief(text)}"
        ) from None


def check_teachers(
    teachers: object, packaged: bool, plan: BodyPlan, hold: int
) -> tuple[Teacher, Teacher] | tuple[()]:
    """Return the teachers beside a plan's library, which may be the packaged one.

    They are packaged for the paper's fish.
    """
    if teachers is None:
        packaged = packaged and plan == AQUAFISH
        return (Teacher.load(), Teacher.load_any_water()) if packaged else ()
    given = sequence("teachers", teachers)
    if not len(given):
        return ()
    if len(given) != 2:
        raise InvalidArgumentError(
            f"teachers must be two, for known water and for any other, or none; got {len(given)}"
        )
    if hold != INTERVAL:
        raise InvalidArgumentError(f"teachers need a hold of {INTERVAL} steps; got {hold}")
    known, foreign = (instance("teachers", one, Teacher) for one in given)
    for one in (known, foreign):
        check_same_plan("teachers", one.plan, plan)
    first_gait(plan)
    return known, foreign
