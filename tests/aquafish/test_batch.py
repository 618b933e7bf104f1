"""What is compiled before the jobs begin."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from aquafish.batch import in_small
from aquafish_gym.engines.compiled import lanes
from aquafish_gym.engines.compiled.policies import OPEN_LOOP
from eea import JointConfig


def test_a_rehearsal_compiles_every_law_and_precision_that_hypotheses_are_fitted_with(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = set()
    compile_kernel = lanes.compile_kernel

    def note(*kernel: Any) -> Any:
        asked.add(kernel)
        return compile_kernel(*kernel)

    monkeypatch.setattr(lanes, "compile_kernel", note)
    in_small(JointConfig(steps=33))  # which no other test asks for
    widths = {lanes.lane_width(dtype) for dtype in (np.float32, np.float64)}
    assert asked == {(p, width, on) for p in OPEN_LOOP for width in widths for on in (False, True)}
