"""Arguments and information of many robots at once, for the vector environment."""

from __future__ import annotations

from collections.abc import Mapping
from pkgutil import resolve_name
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.damage.damage import is_list_of_faults
from aquafish_gym.engines.packages import AUTO, MAXIMUM_THREADS
from aquafish_gym.engines.world_batch import WorldBatch
from aquafish_gym.engines.worlds import RECORDER, Swimmers, recording_folder
from aquafish_gym.envs.episode import EpisodeConfig, check_world
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.layout import FIELDS, layout
from aquafish_gym.plans import BodyPlan
from aquafish_gym.rendering import render_pose
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.array_types import Flags, Floats, Info, Rows
from aquafish_gym.utils.validation import InvalidArgumentError, brief, integer, one_of

NUMBA_PRECISION = "float32"  # of a batch whose precision is not given


def of_each(name: str, value: Any, count: int) -> list[Any]:
    """Return an argument for each of ``count`` robots, given one for all or a list of them."""
    if name == "damage":
        several = isinstance(value, list | tuple) and not (value and is_list_of_faults(value))
    elif isinstance(value, list | tuple):
        several = bool(value) and not isinstance(value[0], int | float | np.number)
    else:
        several = isinstance(value, np.ndarray) and value.ndim == 2
    if not several:
        return [value] * count
    if len(value) != count:
        joined = "; faults of one robot are joined by ';'" if name == "damage" else ""
        raise InvalidArgumentError(
            f"{name} must be one for all robots or num_envs = {count} of them; "
            f"got {len(value)}{joined}"
        )
    return list(value)


def with_options(
    configs: list[EpisodeConfig], options: Mapping[str, Any], rows: Rows
) -> list[EpisodeConfig]:
    """Return the configurations of the robots ``rows`` with options, for all or one for each."""
    if not options:
        return [configs[i] for i in rows.tolist()]
    each = {name: of_each(name, value, len(configs)) for name, value in options.items()}
    made: dict[tuple[int, ...], EpisodeConfig] = {}
    found = []
    for i in rows.tolist():
        own = {name: values[i] for name, values in each.items()}
        key = (id(configs[i]), *map(id, own.values()))
        if key not in made:
            made[key] = configs[i].with_options(own)
        found.append(made[key])
    return found


def check_seeds(seed: object, count: int) -> list[int | None]:
    """Return a seed for each robot, from one number, one each, or None."""
    if seed is None:
        return [None] * count
    alone = isinstance(seed, np.ndarray) and not seed.ndim
    if alone or not isinstance(seed, list | tuple | range | np.ndarray):
        first = integer("seed", seed, 0)
        return [first + i for i in range(count)]
    if len(seed) != count:
        raise InvalidArgumentError(f"seed must be one number or {count} of them; got {len(seed)}")
    return [None if s is None else integer(f"seed[{i}]", s, 0) for i, s in enumerate(seed)]


def check_mask(mask: object, count: int) -> Flags:
    """Return a mask (count,) of the robots to reset, at least one."""
    sound = isinstance(mask, np.ndarray) and not np.ma.is_masked(mask)
    found: Flags = mask if sound else np.zeros(0, np.bool_)  # type: ignore[assignment]
    if found.dtype != np.bool_ or found.shape != (count,) or not found.any():
        raise InvalidArgumentError(
            f'options["reset_mask"] must be ({count},) of bool with at least one True; '
            f"got {brief(mask)}"
        )
    return found


def masked(info: Info, mask: Flags) -> Info:
    """Add the mask that Gymnasium wants beside each key."""
    masks = np.empty((len(info), len(mask)), np.bool_)
    masks[:] = mask
    return info | dict(zip([f"_{name}" for name in info], masks, strict=True))


def put_final(info: Info, fresh: Info, last: NDArray[np.float32], ended: Flags) -> Info:
    """Return ``info`` of new episodes, with that of the ended ones in ``final_info``."""
    final = {
        name: value & ended if name.startswith("_") else value.copy()
        for name, value in info.items()
    }
    for name, value in fresh.items():
        info[name][ended] = value[ended]
    observations = np.full(len(ended), None, dtype=object)
    for i in np.flatnonzero(ended):
        observations[i] = last[i]
    finals = masked({"final_obs": observations}, ended)
    return info | finals | {"final_info": final, "_final_info": ended.copy()}


def make_swimmers(scenario: Scenario, engine: object, dtype: object, threads: object) -> Swimmers:
    """Return the robots of a scenario on an engine; refuse options that the engine lacks.

    The arguments are those of the vector environment.
    """
    automatic = isinstance(engine, str) and engine == AUTO
    found = "numba" if automatic else check_world(engine)
    precision = None if dtype is None else one_of("dtype", dtype, ("float32", "float64"))
    if found == "numba":
        from aquafish_gym.engines.compiled.lanes import LaneBatch

        type_of_numbers = getattr(np, precision or NUMBA_PRECISION)
        cores = None if threads is None else integer("threads", threads, 1, MAXIMUM_THREADS)
        lanes: Swimmers = LaneBatch(scenario, type_of_numbers, threads=cores)
        if folder := recording_folder():
            how = {"engine": found, "dtype": np.dtype(type_of_numbers).name, "substeps": 1}
            lanes = resolve_name(RECORDER)(lanes, scenario, folder, how)
        return lanes
    if precision == "float32":
        raise InvalidArgumentError(
            'dtype must be "float64" or None on other engines than numba; got "float32"'
        )
    if threads is not None:
        raise InvalidArgumentError(
            f"threads has no effect on other engines than numba; got {brief(threads)}"
        )
    if found == "pybullet":
        from aquafish_gym.engines.bullet.world import check_clients_fit

        check_clients_fit("num_envs", len(scenario))
    return WorldBatch(scenario, found)


def frames(plan: BodyPlan, bodies: Floats, states: Floats) -> tuple[Any, ...]:
    """Return a frame (480, 640, 3) uint8 for each robot of sizes (B, S) and states (rows, B)."""
    poses = zip(
        states[FIELDS["position"]].T,
        states[FIELDS["orientation"]].T,
        layout(plan).angles(states).T,
        strict=True,
    )
    return tuple(
        render_pose(Morphology.from_array(sizes, plan), (position, orientation), fin_angles)
        for sizes, (position, orientation, fin_angles) in zip(bodies, poses, strict=True)
    )
