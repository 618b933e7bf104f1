"""Compiling before work starts: in one process, so that its workers need not each do it."""

from __future__ import annotations

import numpy as np

from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.engines.compiled.single import CompiledWorld
from aquafish_gym.engines.compiled.spectrum import disagreements, distances
from aquafish_gym.utils.validation import one_of


def prepare_kernels(dtype: str = "float32", reactive: bool = False, single: bool = False) -> None:
    """Compile what trials need, once: other processes of this machine then find it on disk.

    The time loop and the comparison of spectra; half a minute on a cold cache, which is said on
    stderr, and half a second on a warm one. It runs in the caller's thread, so that Ctrl-C ends
    it.

    Parameters
    ----------
    dtype
        ``"float32"`` or ``"float64"``: what the robots compute in.
    reactive
        Whether the water has the terms of ``physics/reactive.py``.
    single
        Whether the loop of one robot, which environments take, is needed too.

    Raises
    ------
    UnknownNameError
        If there is no such dtype.
    """
    number = getattr(np, one_of("dtype", dtype, ("float32", "float64")))
    one = np.zeros((1, 3))
    lanes = LaneBatch(np.zeros((1, 9)), one, dtype=number, threads=1, reactive=reactive)
    spectra = np.repeat(lanes.spectra(one, 4), 2, axis=0)
    distances(spectra, spectra, np.zeros(2, np.intp))
    disagreements(spectra, 2)
    if single:
        world = CompiledWorld(reactive)
        world.reset(np.zeros(9), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        world.advance((0.0, 0.0, 0.0))
