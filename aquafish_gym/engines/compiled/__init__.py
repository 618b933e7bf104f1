"""The compiled engine: thousands of robots at once in vector registers, or one by itself.

Importing it loads numba, which is why ``engines.base`` and ``engines.worlds`` do so only when
this engine is asked for.
"""

from aquafish_gym.engines.compiled.kernel import WIDTHS, Policy, compile_kernel
from aquafish_gym.engines.compiled.lanes import LaneBatch, lane_width, pack_rows, simulate_lanes
from aquafish_gym.engines.compiled.preparing import prepare_kernels
from aquafish_gym.engines.compiled.single import CompiledWorld
from aquafish_gym.engines.compiled.spectrum import (
    coefficients,
    disagreements,
    distances,
    pack_spectra,
)

__all__ = [
    "WIDTHS",
    "CompiledWorld",
    "LaneBatch",
    "Policy",
    "coefficients",
    "compile_kernel",
    "disagreements",
    "distances",
    "lane_width",
    "pack_rows",
    "pack_spectra",
    "prepare_kernels",
    "simulate_lanes",
]
