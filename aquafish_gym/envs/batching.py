"""What a batch of robots is told and how it answers Gymnasium: bodies, seeds, masks, info."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.utils.validation import InvalidArgumentError, brief, integer

Mask = NDArray[np.bool_]
Info = dict[str, Any]


def bodies(morphology: object, count: int) -> list[Any]:
    """Return one body for all robots, or one for each from (count, 9) sizes."""
    several = isinstance(morphology, np.ndarray) and morphology.ndim == 2
    if isinstance(morphology, list | tuple) and morphology:
        several = not isinstance(morphology[0], int | float | np.number)
    if not several:
        return [morphology]
    each: list[Any] = list(morphology)  # type: ignore[call-overload]
    if len(each) != count:
        raise InvalidArgumentError(
            f"morphology must be one body or num_envs = {count} of them; got {len(each)}"
        )
    return each


def check_seeds(seed: object, count: int) -> list[int | None]:
    """Return a seed for each robot, from one number, one each, or None."""
    if seed is None:
        return [None] * count
    # Bytes are a sequence of whole numbers, and no seeds.
    if not isinstance(seed, list | tuple | range) and not (
        isinstance(seed, np.ndarray) and seed.ndim
    ):
        first = integer("seed", seed, 0)
        return [first + i for i in range(count)]
    if len(seed) != count:
        raise InvalidArgumentError(f"seed must be one number or {count} of them; got {len(seed)}")
    return [None if s is None else integer(f"seed[{i}]", s, 0) for i, s in enumerate(seed)]


def check_mask(mask: object, count: int) -> Mask:
    """Return which robots (count,) shall be reset: at least one."""
    try:
        found = np.asarray(mask)
    except (ValueError, RecursionError):  # ragged, or too deep
        found = np.zeros(0)
    if found.dtype.kind != "b" or found.shape != (count,) or not found.any():
        raise InvalidArgumentError(
            f'options["reset_mask"] must be ({count},) of bool with at least one True; '
            f"got {brief(mask)}"
        )
    return found


def masked(info: Info, mask: Mask) -> Info:
    """Add the mask that Gymnasium wants beside each key."""
    return info | {f"_{name}": mask.copy() for name in info}


def put_final(info: Info, fresh: Info, last: NDArray[np.float32], ended: Mask) -> Info:
    """Move the ended robots' information to ``final_info`` and put the new episodes' instead."""
    final = {name: value.copy() for name, value in info.items()}
    for name in list(final):
        if name.startswith("_"):
            final[name] &= ended
    for name, value in fresh.items():
        if not name.startswith("_"):
            info[name] = value
    for name in info:
        if name.startswith("_") and name not in fresh:
            info[name] &= ~ended
    observations = np.full(len(ended), None, dtype=object)
    for i in np.flatnonzero(ended):
        observations[i] = last[i]
    finals = masked({"final_obs": observations}, ended)
    return info | finals | {"final_info": final, "_final_info": ended.copy()}
