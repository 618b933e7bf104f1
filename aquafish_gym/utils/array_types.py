"""Names for the types of arrays that many modules take and return."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Reals: TypeAlias = NDArray[np.floating]  # in single or double precision
Observations: TypeAlias = NDArray[np.float32]
Flags: TypeAlias = NDArray[np.bool_]
Rows: TypeAlias = NDArray[np.intp]  # indices of robots in a batch
Info: TypeAlias = dict[str, Any]  # what ``reset`` and ``step`` return of an environment
Triple: TypeAlias = tuple[float, float, float]
