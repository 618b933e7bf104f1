"""Posteriors of joint inference in files."""

from __future__ import annotations

import os
from typing import Any

from aquafish_gym.runs.arrays import read_arrays, write_arrays
from aquafish_gym.utils.storage import DamagedFileError
from aquafish_gym.utils.validation import InvalidArgumentError, instance
from eea.core.checks import ConfigurationError
from eea.fish.hypotheses import plan_of
from eea.infer.answer import Answer
from eea.infer.file import ARRAYS, from_arrays, to_arrays

MOST_HEADER_BYTES = 4 * 2**20


def save_posterior(path: str | os.PathLike[str], belief: Any) -> None:
    """Write a ``result.belief`` of joint inference to an ``.npz`` file, whole or not at all.

    The file has everything except the simulator.

    Raises
    ------
    InvalidArgumentError
        If the belief is not a posterior of joint inference.
    CannotWriteError
        If the file cannot be written.
    """
    write_arrays(path, to_arrays(instance("belief", belief, Answer)))


def load_posterior(path: str | os.PathLike[str]) -> Answer:
    """Return the posterior that ``save_posterior`` wrote, such as ``posterior.npz`` of a run.

    Its ``interval``, ``sample`` and ``table`` return the same as before saving.

    Raises
    ------
    InvalidArgumentError
        If the file cannot be read, is damaged or holds something else; the message names it.

    Examples
    --------
    >>> low, high = load_posterior("posterior.npz").interval(0.9)  # doctest: +SKIP
    """
    arrays = read_arrays(path, dict.fromkeys(ARRAYS, (None,)), "posterior")
    if arrays["header"].size > MOST_HEADER_BYTES:  # its parts take many times its memory
        raise DamagedFileError(f"posterior: {path} must have a header of at most 4 MiB")
    try:
        found = from_arrays(arrays)
        plan_of(found.robot)  # raises for what is no plan
    except (ConfigurationError, InvalidArgumentError) as error:
        raise DamagedFileError(f"posterior: {path}: {error}") from None
    return found
