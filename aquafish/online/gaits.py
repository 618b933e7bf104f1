"""Gaits chosen and refined by imagination: on the self-model, from the very state that it is in."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.layout import FIELDS, angles_of_rows
from aquafish_gym.rollout import rollout
from aquafish_gym.runs.storage import read_document
from aquafish_gym.scenario import Scenario
from gait.controller import Controller, program_of
from gait.fitness import penalize_diverged
from gait.search.cma import Strategy
from gait.search.templates import Template

Floats = NDArray[np.float64]

LIBRARY, SCHEMA = Path(__file__).with_name("library.json"), "aquafish.library/1"
POPULATION, SIGMA = 24, 0.05
LARGEST = 30  # nodes of a network that CMA-ES refines in a second


def load_library(path: Path = LIBRARY) -> list[Controller]:
    """Return the gaits of a library: two for the whole robot, then those for broken ones.

    ``examples/gait_library.py`` made the packaged one.
    """
    return [Controller.from_dict(one) for one in read_document(path, SCHEMA, "library")["gaits"]]


def imagine(
    controllers: Sequence[Controller], robot: Scenario, state: Floats, seconds: float
) -> Floats:
    """Return how far (P,) controllers would swim along +y from a state (25,), in units.

    ``robot`` is a scenario of one. The controllers know its fin angles and servo gains.
    """
    far = np.empty(len(controllers))
    kinds: dict[object, list[int]] = {}
    for i, controller in enumerate(controllers):
        kinds.setdefault(controller.kind, []).append(i)
    for those in kinds.values():
        found = rollout(
            program_of([controllers[i] for i in those]),
            robot.take(np.zeros(len(those), np.intp)),
            seconds=seconds,
            believed=angles_of_rows(state),
            believed_gain=robot.servo_gain[0],
            dtype=np.float32,
            threads=1,
            start=np.repeat(state[:, None], len(those), axis=1),
        )
        far[those] = found.end[:, 1] - state[FIELDS["position"]][1]
    return penalize_diverged(far, seconds)


def refine(
    first: Controller,
    robot: Scenario,
    state: Floats,
    seconds: float,
    generations: int,
    rng: np.random.Generator,
) -> tuple[Controller, float]:
    """Return a gait refined by CMA-ES for a state, and how far it would swim, see `imagine`."""
    template, body = Template.like(first), Morphology.from_array(robot.body[0])
    search = Strategy(
        template.vector(first),
        lambda x: template.controller(x, first.clock, body, first.seed),
        POPULATION,
        rng,
        SIGMA,
    )
    best, farthest = first, float(imagine([first], robot, state, seconds)[0])
    for _ in range(generations):
        proposal = search.ask()
        tried = [*proposal.controllers, *(proposal.finalists or [])]
        far = imagine(tried, robot, state, seconds)
        top = int(far.argmax())
        if far[top] > farthest:
            best, farthest = tried[top], float(far[top])
        search.tell(far[: len(proposal.controllers)].tolist(), best, farthest)
    return best, farthest
