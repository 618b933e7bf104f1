"""AquaFish: a swimming robot, its water, and Gymnasium environments of it.

Importing the package registers ``AquaFish-v0``, ``FourFins-v0`` and ``TailFish-v0``. The engines'
packages, numba and PyBullet, are loaded when they are first used.
"""

import multiprocessing as _multiprocessing
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

import gymnasium as _gymnasium

from aquafish_gym.damage import Damage
from aquafish_gym.damage.held_out import held_out
from aquafish_gym.engines.api import simulate
from aquafish_gym.envs import AquaFishEnv, AquaFishVectorEnv, tasks
from aquafish_gym.envs.wrappers import FaultWrapper, VectorFaultWrapper
from aquafish_gym.imu import ImuLog
from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import AQUAFISH, PLANS, BodyPlan, Dimension, FinPlan, Hull
from aquafish_gym.world_config import WorldConfig

__all__ = [
    "AQUAFISH",
    "PLANS",
    "AquaFishEnv",
    "AquaFishVectorEnv",
    "BodyPlan",
    "Damage",
    "Dimension",
    "FaultWrapper",
    "FinPlan",
    "Hull",
    "ImuLog",
    "Morphology",
    "VectorFaultWrapper",
    "WorldConfig",
    "held_out",
    "simulate",
    "tasks",
]
__version__: str
if not _TYPE_CHECKING:  # mypy would accept any name

    def __getattr__(name: str) -> str:
        """Return the version, for which git is asked in a clone, when it is first used."""
        if name != "__version__":
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from aquafish_gym.runs.version import version

        return version()


#: The arguments that each id adds.
IDS: dict[str, dict[str, _Any]] = {
    "AquaFish-v0": {},
    "FourFins-v0": {"plan": "four-fins"},
    "TailFish-v0": {"plan": "tail-fish", "reactive": True},
    "AquaFishStation-v0": {"task": "station"},
    "AquaFishWaypoint-v0": {"task": "waypoint"},
    "AquaFishRecovery-v0": {"task": "recovery", "damage": "random:moderate@15-30"},
    "AquaFishReturn-v0": {"task": "return", "damage": "random:moderate@15-30"},
}
# No limit of steps is registered: an episode's steps follow from the task and frame_skip, and
# gym.make would cut other ones off. The spec of an environment that was made has max_episode_steps.
for _id, _kwargs in IDS.items():
    if _id not in _gymnasium.registry:
        _gymnasium.register(
            id=_id,
            entry_point="aquafish_gym:AquaFishEnv",
            vector_entry_point="aquafish_gym:AquaFishVectorEnv",
            kwargs=_kwargs,
        )

# A trainer's worker is a new Python, which knows no ids of ours if it cannot import the program
# that started it, such as a notebook. Gymnasium reads no entry points of installed packages; but
# the fork server, from which workers come, imports what it is told, unless it runs already. A
# program that names modules of its own does so after this import, and names this one among them.
if "forkserver" in _multiprocessing.get_all_start_methods():
    _multiprocessing.set_forkserver_preload(["__main__", __name__])
