"""A policy of stable-baselines3 as a C99 file for a microcontroller, with test vectors.

``policy.c`` restates ``SB3Policy.act``, and both agree to the bit.
"""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np

from gait.controllers.c_files import (
    CFile,
    c_file_path,
    c_float,
    c_floats,
    source_and_header,
    wrapped,
)
from gait.controllers.sb3_policy import (
    ACTIVATIONS,
    CHOSEN,
    CLIPPED,
    SQUASHED,
    Floats,
    SB3Policy,
)

VECTOR_COUNT = 1000
VECTOR_SPREAD = 3.0  # standard deviation of the observations, as the network sees them

_BY_TANH = ("Tanh", "ELU", "SiLU")  # activations that policy.c computes from tanh


def policy_file(policy: SB3Policy, path: Path | str) -> CFile:
    """Return a policy as a C file to write.

    Raises
    ------
    InvalidArgumentError
        If the file's name is no identifier of C followed by .c, if another file than an exported
        one is there, or if a layer exceeds float32.
    """
    source = c_file_path("c", path)
    texts = policy_texts(policy, source.stem)
    observations = make_observations(policy, VECTOR_COUNT)
    actions = policy.act(observations)
    columns = [f"observation_{i}" for i in range(policy.widths[0])]
    columns += [f"action_{i}" for i in range(actions.shape[1])]
    rows = [[*seen, *done] for seen, done in zip(observations, actions, strict=True)]
    return CFile(source, *texts, columns, rows)


def policy_texts(policy: SB3Policy, name: str) -> tuple[str, str]:
    """Return a policy's C file and header; ``name`` begins the names of its functions."""
    widths = policy.widths
    chosen = policy.output == CHOSEN
    scaled = policy.normalization
    limited = scaled is not None and bool(np.isfinite(scaled.limit))
    numbers = [np.column_stack([layer.biases, layer.weights]).ravel() for layer in policy.layers]
    answers = 1 if chosen else widths[-1]
    inner = "".join(f"{width} ({policy.activation}), " for width in widths[1:-1])
    described = f"Dense layers of {inner}{widths[-1]} ({policy.output})."
    hidden = len(policy.layers) > 1
    tanh = policy.output == SQUASHED or (hidden and policy.activation in _BY_TANH)
    values = {
        "KIND": policy.kind,
        "DESCRIPTION": "\n * ".join(textwrap.wrap(described, 97)),
        "INPUTS": widths[0],
        "ACTIONS": widths[-1],
        "LAYERS": len(policy.layers),
        "WIDEST": max(widths),
        "WIDTHS": wrapped(widths),
        "NUMBERS": c_floats(np.concatenate(numbers)),
        "SCALED": "" if scaled is None else ", before VecNormalize",
        "MEAN": "" if scaled is None else c_floats(scaled.mean),
        "SCALE": "" if scaled is None else c_floats(scaled.scale),
        "LIMIT": "" if scaled is None else c_float(scaled.limit),
        "WITHIN": "" if scaled is None or not limited else f", within {scaled.limit:g} of 0",
        "LOW": c_floats(policy.low),
        "HIGH": c_floats(policy.high),
        "TYPE": "float",
        "FORMAT": "%f",
        "COLUMNS": widths[0] + answers,
        "ANSWERS": answers,
    }
    parts = {
        "bounds": not chosen,
        "choice": chosen,
        "clipped": policy.output == CLIPPED,
        "squashed": policy.output == SQUASHED,
        "raw": scaled is None,
        "normalized": scaled is not None,
        "limited": limited,
        "clip": tanh or limited,
        "tanh": tanh,
        "hidden": hidden,
        "single": not hidden,
        "double": False,
    }
    parts |= {one: hidden and one == policy.activation for one in ACTIVATIONS}
    return source_and_header("policy", name, values, parts)


def make_observations(policy: SB3Policy, count: int, seed: int = 0) -> Floats:
    """Return random observations (count, n); where they are scaled, of the scale's spread."""
    seen = np.random.default_rng(seed).standard_normal((count, policy.widths[0])) * VECTOR_SPREAD
    if policy.normalization is not None:
        seen = policy.normalization.mean + policy.normalization.scale * seen
    return seen.astype(np.float32)
