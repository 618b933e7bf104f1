"""A cart whose two channels are linear in what is sought, for fast tests of recorded trials."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eea import FitConfig, Number, Robot, Trial

TIME = np.arange(60)
PUSH = np.sin(TIME / 4.0)
SD = (0.05, 5e4)  # of the channels' noise, in their units
TRUTH = {"gain": 1.0, "drag": 1.0, "bias": 0.0}
QUICK = FitConfig(alternatives="always", bodies=4, poses=2, descents=2, polished=1, restarts=0)


def roll(values, push):
    """Return a rate and a force; ``push`` (B, T)."""
    rate = values["gain"][:, None] * push + values["bias"][:, None]
    return np.stack([rate, 1e6 * values["drag"][:, None] * push**2], axis=-1)


CART = Robot(
    roll,
    {
        "gain": Number(0.0, 2.0, healthy=1.0, unit="m"),
        "drag": Number(0.0, 2.0, healthy=1.0),
        "bias": Number(0.0, sd=0.1),
    },
    {"rate": "rad/s", "force": "N"},
)
SOUGHT = replace(CART.without_healthy(), hypotheses=())  # both numbers, by intervals


def with_numbers(robot, **numbers):
    """Return a robot some of whose numbers are others."""
    return replace(robot, numbers={**robot.numbers, **numbers})


def record(simulate, values, inputs, sd=0.0, rng=0):
    """Return a trial of a simulator, with white noise; ``values`` are one each."""
    one = {name: np.array([value]) for name, value in values.items()}
    signal = simulate(one, None if inputs is None else inputs[None])[0]
    noise = np.random.default_rng(rng).normal(0.0, sd, signal.shape)
    return Trial(signal + noise, inputs)


def measured(rng, push=PUSH, sd=SD, correlation=0.0, **values):
    """Return a recorded trial; ``values`` differ from ``TRUTH``."""
    numbers = {name: np.array([value]) for name, value in {**TRUTH, **values}.items()}
    signal = roll(numbers, push[None])[0]
    noise = rng.normal(size=signal.shape)
    for k in range(1, len(noise)):
        noise[k] = correlation * noise[k - 1] + (1.0 - correlation**2) ** 0.5 * noise[k]
    return Trial(signal + np.array(sd) * noise, push)
