"""Arguments and information of many robots at once, for the vector environment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.damage.damage import is_list_of_faults
from aquafish_gym.envs.episode import EpisodeConfig
from aquafish_gym.physics.arithmetic import Vector
from aquafish_gym.utils.validation import InvalidArgumentError, brief, integer

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Info = dict[str, Any]

ALL_OR_EACH = ("morphology", "damage", "fin_angles")  # may be one for all robots, or one each


def three(rows: Floats) -> Vector:
    x, y, z = rows
    return (x, y, z)


def of_each(arguments: Mapping[str, Any], count: int) -> dict[str, list[Any]]:
    """Return each argument as a list: one for all robots, or one for each of ``count``."""
    found = {}
    for name, value in arguments.items():
        rows = isinstance(value, list | tuple) if name == "damage" else has_rows(value)
        if name == "damage" and rows and value and is_list_of_faults(value):
            raise InvalidArgumentError(
                "damage must be one for all robots or a list of texts or Damages, one each; got a "
                f"list of {len(value)} faults, which might be either: make it Damage(...)"
            )
        each = list(value) if rows and name in ALL_OR_EACH else [value]
        if len(each) != count and not (len(each) == 1 and each[0] is value):
            joined = "; faults of one robot are joined by ';'" if name == "damage" else ""
            raise InvalidArgumentError(
                f"{name} must be one for all robots or num_envs = {count} of them; "
                f"got {len(each)}{joined}"
            )
        found[name] = each
    return found


def has_rows(value: object) -> bool:
    """Return whether a value is several rows, and not one of three or nine numbers."""
    if isinstance(value, np.ndarray):
        return value.ndim == 2
    if isinstance(value, list | tuple) and value:
        return not isinstance(value[0], int | float | np.number)
    return False


def with_options(
    starts: list[EpisodeConfig], several: Mapping[str, list[Any]]
) -> list[EpisodeConfig]:
    """Return configurations with options, each with one value for all or one for each robot."""
    made: dict[tuple[int, ...], EpisodeConfig] = {}
    found = []
    for i, start in enumerate(starts):
        options = {name: values[i % len(values)] for name, values in several.items()}
        key = (id(start), *map(id, options.values()))
        if key not in made:
            made[key] = start.with_options(options)
        found.append(made[key])
    return found


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
    """Return a mask (count,) of the robots to reset, at least one."""
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
    """Return ``info`` of new episodes, with that of the ended ones in ``final_info``."""
    masks = [name for name in info if name.startswith("_")]
    final = {name: info[name] & ended if name in masks else info[name].copy() for name in info}
    for name, value in fresh.items():
        info[name][ended] = value[ended]
    observations = np.full(len(ended), None, dtype=object)
    for i in np.flatnonzero(ended):
        observations[i] = last[i]
    finals = masked({"final_obs": observations}, ended)
    return info | finals | {"final_info": final, "_final_info": ended.copy()}
