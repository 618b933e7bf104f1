"""Several bodies, such as a posterior sample, as an array and as a file."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.morphology import Morphology, MorphologyLike, other_plans
from aquafish_gym.plans import (
    AQUAFISH,
    BodyPlan,
    PlanLike,
    check_plan,
    check_same_plan,
    plan_document,
)
from aquafish_gym.utils.storage import read_document, write_document
from aquafish_gym.utils.validation import InvalidArgumentError, brief, finite_array

BODIES_SCHEMA = "aquafish.bodies/1"
_ROBOT_FILES = (".urdf", ".sdf", ".xml", ".mjcf", ".xacro", ".usd")

# One body, a list of them, or an array (M, S).
MorphologiesLike = MorphologyLike | Sequence[MorphologyLike]


def body_array(
    bodies: MorphologiesLike, argument: str = "morphologies", plan: PlanLike = AQUAFISH
) -> NDArray[np.float64]:
    """Return the sizes (M, S) of one body or several, in the order of the plan's ``dimensions``.

    ``bodies`` is one body as ``Morphology.coerce`` takes it, a list of such, or (M, S) sizes in
    units of 5 cm; ``argument`` is its name in messages.

    Raises
    ------
    InvalidArgumentError
        If one is not a body.

    Examples
    --------
    >>> body_array([Morphology.nominal(), {"caudal": (0.0, 0.0, 0.0)}])[:, 6:]
    array([[0.4, 1.4, 0.6],
           [0. , 0. , 0. ]])
    """
    plan = check_plan(plan)
    if bodies is None or isinstance(bodies, Morphology | Mapping):
        return Morphology.coerce(bodies, plan).to_array()[None]
    if isinstance(bodies, list | tuple) and any(
        isinstance(b, Morphology | Mapping) for b in bodies
    ):
        return np.array([Morphology.coerce(body, plan).to_array() for body in bodies])
    return finite_array(
        argument,
        bodies,  # type: ignore[arg-type]
        (None, len(plan.dimensions)),
        0.0,
        plan.maxima,
        flat=True,
        hint=other_plans(plan),
    )


def median_body(bodies: NDArray[np.float64], plan: PlanLike = AQUAFISH) -> Morphology:
    """Return the body of the median of each size of bodies (M, S), without their correlations."""
    return Morphology.from_array(np.median(bodies, axis=0), plan)


def sample_stamp(bodies: NDArray[np.float64]) -> str:
    """Return the count and a hash of bodies (M, S): "2 bodies, 81c611f35bff7949"."""
    digest = hashlib.sha256(np.ascontiguousarray(bodies, np.float64).tobytes()).hexdigest()[:16]
    return f"{len(bodies)} bodies, {digest}"


def write_bodies(
    path: str | os.PathLike[str], bodies: MorphologiesLike, plan: PlanLike = AQUAFISH
) -> None:
    """Write a ``bodies.json``, whole or not at all, that :func:`read_bodies` reads back exactly.

    Raises
    ------
    InvalidArgumentError, CannotWriteError
        If one is not a body, or the file cannot be written.

    Examples
    --------
    >>> write_bodies("bodies.json", [Morphology.nominal(), None])
    >>> read_bodies("bodies.json") == (Morphology.nominal(),) * 2
    True
    """
    plan = check_plan(plan)
    rows = [Morphology.from_array(row, plan).to_dict() for row in body_array(bodies, plan=plan)]
    write_document(path, {**plan_key(plan), "morphologies": rows}, BODIES_SCHEMA)


def body_document(body: Morphology) -> dict[str, Any]:
    """Return what :func:`read_bodies` reads back as one body, ready for JSON."""
    plan = plan_key(body.plan)
    return {**plan, "morphology": body.to_dict()} if plan else body.to_dict()


def plan_key(plan: BodyPlan) -> dict[str, Any]:
    """Return what a file says of a plan, under the key "plan"; nothing of the paper's."""
    return {} if plan == AQUAFISH else {"plan": plan_document(plan)}


def read_bodies(
    path: str | os.PathLike[str], argument: str = "file", plan: PlanLike | None = None
) -> tuple[Morphology, ...]:
    """Return the bodies of a JSON file: a ``bodies.json``, or a file with one body.

    A body is an object from fin to [x, y, z], or numbers in the order of the plan's ``dimensions``.
    The file is a body, or an object with a ``morphology``, as a ``result.json``, or with a list of
    ``morphologies``. Its ``plan`` is that of the bodies; without one they are of the paper's fish,
    or of the argument ``plan`` if they name its fins. Bodies of another plan than the argument are
    refused.

    Raises
    ------
    InvalidArgumentError
        If the file cannot be read or holds no body; the message names file and argument.
    """
    wanted = None if plan is None else check_plan(plan)
    if isinstance(path, str | os.PathLike) and str(path).lower().endswith(_ROBOT_FILES):
        raise InvalidArgumentError(
            f"{argument} must be a JSON file of bodies; got {path}{other_plans(wanted or AQUAFISH)}"
        )
    document = read_document(path, argument=argument)
    rows = document.get("morphologies", [document.get("morphology", document)])
    try:
        if not isinstance(rows, list) or not rows:
            raise InvalidArgumentError(
                f"its morphologies must be a list of one body or more; got {brief(rows)}"
            )
        found = check_plan(document.get("plan", wanted or AQUAFISH))
        check_same_plan("its bodies", found, wanted or found)
        if "plan" not in document:
            _check_unsaid_plan(rows, found)
        return tuple(_body(row, found) for row in rows)
    except InvalidArgumentError as error:
        raise InvalidArgumentError(f"{argument}: {path}: {error}") from None


def _check_unsaid_plan(rows: list[object], wanted: BodyPlan) -> None:
    """Refuse bodies that are the paper's fish, as they do not say otherwise, where another is."""
    own_names = sorted(wanted.names) != sorted(AQUAFISH.names)
    if wanted != AQUAFISH and not (own_names and all(_names(row, wanted) for row in rows)):
        fins = f", or name the fins {', '.join(wanted.names)}" if own_names else ""
        raise InvalidArgumentError(
            f'its bodies must say under "plan" that they are of {wanted.name}{fins}; without that '
            f"they are of {AQUAFISH.name}; got {brief(rows[0])}"
        )


def _names(value: object, plan: BodyPlan) -> TypeGuard[dict[str, Any]]:
    """Return whether a body names all fins of a plan, and no other."""
    return isinstance(value, dict) and sorted(value) == sorted(plan.names)


def _body(value: object, plan: BodyPlan) -> Morphology:
    if isinstance(value, list):
        return Morphology.from_array(value, plan)
    if not _names(value, plan):
        raise InvalidArgumentError(
            f"a body must be an object with the keys {', '.join(plan.names)}, or "
            f"{len(plan.dimensions)} numbers; got {brief(value)}{other_plans(plan)}"
        )
    return Morphology.coerce(value, plan)
