"""What is timed: rows, the groups they come in, and where the groups are found."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from importlib import import_module

from aquafish_gym.engines.packages import load_pybullet
from aquafish_gym.utils.validation import EngineUnavailableError, install_advice
from instruments.verification.mujoco_model import load_mujoco

NO_MUJOCO = f"MuJoCo is not installed, so its rows are left out: {install_advice('mujoco')}"


@dataclass(frozen=True)
class Settings:
    """How much to time.

    Attributes
    ----------
    robots
        The open loop's largest batch; a cap on most others.
    steps
        Physics steps of 0.01 s a trial.
    seed
        Random bodies, commands, fin angles and networks follow from it.
    cores
        How many threads the rows of all cores take.
    quick
        Whether the fixed sizes of a group shall be small, too.
    """

    robots: int
    steps: int
    seed: int
    cores: int
    quick: bool = False


@dataclass(frozen=True, eq=False)
class Row:
    """One thing to time.

    Attributes
    ----------
    what, engine, dtype, batch, threads
        What the table says of it.
    amount
        How many of its group's units one call does.
    call
        Does it. If ``own_clock``, it returns the seconds it took, as told by another process or
        found in another way.
    against
        The row of the same group that this one is compared with; None if with none.
    as_time
        Whether the table shows seconds a unit rather than units a second.
    own_clock
        See ``call``; such a row is neither warmed up nor repeated within a turn.
    typical
        Whether the row's figure is the median turn rather than the best.
    most_turns
        A row that takes long may ask for fewer turns than the others.
    share
        Whether the row is a part of the other one: the ratio is then of their times, its share.
    """

    what: str
    engine: str
    dtype: str
    batch: int
    threads: int
    amount: float
    call: Callable[[], object]
    against: Row | None = None
    as_time: bool = False
    own_clock: bool = False
    typical: bool = False
    most_turns: int | None = None
    share: bool = False


@dataclass(frozen=True)
class Group:
    """Rows that take turns.

    Attributes
    ----------
    title
        What the table calls them.
    unit
        What their amounts count, in the singular.
    rows
        In the table's order; a row's reference is among them.
    notes
        A sentence for everything that is left out here.
    """

    title: str
    unit: str
    rows: list[Row]
    notes: list[str] = field(default_factory=list)


# Returns a group; what must be closed afterwards goes on the stack.
Provider = Callable[[Settings, ExitStack], Group]

# Loaded when chosen. By name alone, as engines are: this package knows no gaits and no EEA.
GROUPS: dict[str, str] = {
    "physics": "instruments.benchmarks.physics:open_loop",
    "widths": "instruments.benchmarks.physics:lane_widths",
    "bodies": "instruments.benchmarks.bodies:new_bodies",
    "mujoco": "instruments.benchmarks.mujoco_rollout:against_mujoco",
    "neat": "instruments.benchmarks.gait:populations",
    "tasks": "instruments.benchmarks.gait:tasks",
    "environments": "instruments.benchmarks.environments:single_and_vector",
    "resets": "instruments.benchmarks.environments:resets",
    "wrapped": "instruments.benchmarks.faults:arrays",
    "faults": "instruments.benchmarks.faults:tensors",
    "learning": "instruments.benchmarks.gait:learning",
    "training": "instruments.benchmarks.training:until_it_swims",
    "pictures": "instruments.benchmarks.watching:pictures",
    "starting": "instruments.benchmarks.starting:processes",
    "replicate": "instruments.benchmarks.replicate:replicates",
}


def load_provider(name: str) -> Provider:
    """Return what makes the group of this name, one of ``GROUPS``."""
    module, function = GROUPS[name].split(":")
    found: Provider = getattr(import_module(module), function)
    return found


def missing_pybullet() -> list[str]:
    """Return a sentence if PyBullet is not here, and none if it is."""
    try:
        load_pybullet()
    except EngineUnavailableError as error:
        return [f"PyBullet's rows are left out: {error}"]
    return []


def missing_mujoco() -> list[str]:
    """Return a sentence if MuJoCo is not here, and none if it is."""
    try:
        load_mujoco()
    except EngineUnavailableError:
        return [NO_MUJOCO]
    return []
