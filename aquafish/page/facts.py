"""What the page's agent knows: the library's numbers, words and gaits, as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from aquafish.online import AgentConfig, thresholds
from aquafish.online.belief import chance_bound
from aquafish.online.gaits import check_library
from aquafish.online.hypotheses import FIRST_NUMBERS, NUMBERED, all_hypotheses, searched_range
from aquafish.online.self_model import error_sds, error_size
from aquafish_gym.damage.breaking import break_part
from aquafish_gym.physics.layout import FIELDS, layout
from aquafish_gym.plans import BodyPlan
from aquafish_gym.rendering.scene import PART_NUMBERS, drawn_parts
from aquafish_gym.scenario import CHANNELS, GYRO_CHANNELS, TIMESTEP, Scenario
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.controllers.controller import Controller
from gait.controllers.network import OUTPUT_GAIN, Senses

GYRO_NOISE = 0.01  # standard deviation, rad/s: the league's
GAIT_SENSES = Senses(fins=True)  # of each gait of the library


def agent_facts(gaits: Sequence[Controller], seconds: float) -> dict[str, Any]:
    """Return what ``agent.js`` calls FACTS; it chooses a gait for the next ``seconds``."""
    plan = gaits[0].plan
    noise = np.zeros(len(CHANNELS))
    noise[GYRO_CHANNELS] = GYRO_NOISE
    hold = gaits[0].interval
    check_library(gaits, plan, hold)
    return {
        "thresholds": {
            **{
                name: np.asarray(value).tolist()
                for name, value in vars(thresholds).items()
                if name.isupper()
            },
            **{
                name: error_sds(plan, getattr(thresholds, name)).tolist()
                for name in ("MODEL_ERROR", "RECOGNISED_ERROR", "START_ERROR")
            },
        },
        "hold": hold,
        "seconds": hold * TIMESTEP,
        "horizon": round(seconds / (hold * TIMESTEP)),
        "gyroNoise": GYRO_NOISE,
        "noise": np.hypot(noise, thresholds.LEAST_OBSERVATION_SD).tolist(),
        "tolerance": np.maximum(
            thresholds.CHANNEL_TOLERANCE, thresholds.TOLERANCE_RATIO * noise
        ).tolist(),
        "northing": FIELDS["position"].start + 1,
        "errors": error_size(plan),
        "stateRows": layout(plan).state_numbers,
        "robotRows": layout(plan).robot_rows,
        "parts": PART_NUMBERS * len(drawn_parts(plan)),
        "fins": plan.names,
        "sizes": [d.nominal for d in plan.dimensions],
        "maxima": plan.maxima.tolist(),
        "columns": {
            fin: {d.size: i for i, d in enumerate(plan.dimensions) if d.fin == fin}
            for fin in plan.names
        },
        "middle": ((plan.command_low + plan.command_high) / 2).tolist(),
        "reach": ((plan.command_high - plan.command_low) / 2).tolist(),
        "effects": {
            fin: {word: effects(plan, fin, word) for word in FIRST_NUMBERS} for fin in plan.names
        },
        "singles": singles(plan),
        "numberRanges": {
            word: searched_range(word) if word in NUMBERED else (0.0, 0.0) for word in FIRST_NUMBERS
        },
        "costs": {
            word: thresholds.WORD_COST + thresholds.NUMBER_COST * (word in NUMBERED)
            for word in FIRST_NUMBERS
        },
        # It begins at rest, in water whose current it knows.
        "startCovariance": np.diag(
            np.full(error_size(plan), thresholds.START_ERROR[0]) ** 2
        ).tolist(),
        "largestError": error_sds(
            plan, thresholds.ERROR_SCALES[-1] * thresholds.MODEL_ERROR
        ).tolist(),
        "windows": [
            (window, chance_bound(window * len(CHANNELS))) for window in thresholds.WINDOWS
        ],
        "inferences": AgentConfig().inferences,
        "outputGain": OUTPUT_GAIN,
        "gaits": [gait_facts(gait) for gait in gaits],
    }


def singles(plan: BodyPlan) -> list[list[dict[str, Any]]]:
    """Return the hypotheses of nothing broken and of single faults, as lists of faults."""
    return [
        [
            {"fin": fin, "word": word, "number": number}
            for (fin, word), number in zip(grid.words, row, strict=True)
        ]
        for grid in all_hypotheses(plan)
        if len(grid.words) < 2
        for row in grid.numbers.tolist()
    ]


def effects(plan: BodyPlan, fin: str, word: str) -> list[tuple[float, ...]]:
    """Return what a word about a fin does to a robot's sizes and servo gains.

    Each row is (i, a, b, c, d): with the word's number x, value i becomes
    ``a + b x + (c + d x) value``. Found by breaking robots.
    """
    shares, numbers = (axis.ravel() for axis in np.meshgrid((0.3, 0.4), (0.25, 0.75)))
    largest = np.concatenate([plan.maxima, np.ones(len(plan.fins))])
    robots = Scenario.create(np.outer(shares, plan.maxima), plan=plan)
    robots.servo_gain[:] = shares[:, None]
    break_part(plan, robots.columns(), slice(None), fin, word, numbers)
    after = np.concatenate([robots.body, robots.servo_gain], axis=1)
    terms = np.stack([np.ones(4), numbers, shares, shares * numbers], axis=1)
    found = np.linalg.solve(terms, after).round(9).T + 0.0  # no "-0"
    found[:, 2:] /= largest[:, None]
    changed = np.flatnonzero((found != (0.0, 0.0, 1.0, 0.0)).any(axis=1))
    return [(i, *found[i].tolist()) for i in changed.tolist()]


def gait_facts(gait: Controller) -> dict[str, Any]:
    """Return a gait as ``agent.js`` reads it: its layout, and its numbers in float32."""
    if gait.senses != GAIT_SENSES:
        raise InvalidArgumentError(
            f"library must have gaits with {GAIT_SENSES} to be on a page; got {gait.senses}"
        )
    _, _, _, _, inputs, nodes, memory, clipped, _, *ends = gait.layout().tolist()
    return {
        "layout": {
            "inputs": inputs,
            "nodes": nodes,
            "memory": bool(memory),
            "clipped": bool(clipped),
            "ends": ends,
        },
        "genes": [float(str(gene)) for gene in gait.genes().astype(np.float32)],
    }
