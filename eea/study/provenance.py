"""Which code computes a study's results."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import aquafish_gym
import eea
from aquafish_gym.runs.stamps import code_stamp

# What decides a result. A study's settings are written down themselves, and the folder, the
# commands and the reports only carry results.
ROBOT = ("command.py", "damage.py", "imu.py", "morphology.py", "physics", "engines")
ALGORITHM = ("core", "aquafish", "study/replicate.py")


@cache
def source_stamp() -> str:
    """Return a hash of the code that decides the results; comments and docstrings have no say."""
    packages = ((aquafish_gym, ROBOT), (eea, ALGORITHM))
    return code_stamp(
        file
        for package, names in packages
        for name in names
        for file in _sources(Path(str(package.__file__)).parent / name)
    )


def _sources(path: Path) -> list[Path]:
    return sorted(path.rglob("*.py")) if path.is_dir() else [path]
