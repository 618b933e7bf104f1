"""Gaits chosen by imagination: simulated on the self-model from the very state it is in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from aquafish.online.self_model import Robot
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.layout import FIELDS, angles_of_rows
from aquafish_gym.rollout import rollout
from aquafish_gym.scenario import Scenario
from gait.controller import Controller, program_of
from gait.fitness import penalize_diverged
from gait.search.cma import Strategy
from gait.search.templates import Template

Floats = NDArray[np.float64]

POPULATION = 24


def imagine(
    controllers: Sequence[Controller],
    robot: Robot,
    state: Floats,
    seconds: float,
    dtype: type[np.floating] = np.float32,
) -> Floats:
    """Return how far (P,) each controller would swim along +y from a state (25,), in units."""
    far = np.empty(len(controllers))
    kinds: dict[object, list[int]] = {}
    for i, controller in enumerate(controllers):
        kinds.setdefault(controller.kind, []).append(i)
    for those in kinds.values():
        count = len(those)
        fields = {
            "body": np.tile(robot.body, (count, 1)),
            "servo_gain": np.tile(robot.servo_gain, (count, 1)),
        }
        found = rollout(
            program_of([controllers[i] for i in those]),
            Scenario.fill(fields, robot.reactive),
            seconds=seconds,
            believed=angles_of_rows(state),
            believed_gain=robot.servo_gain,
            dtype=dtype,
            threads=1,
            start=np.repeat(state[:, None], count, axis=1),
        )
        far[those] = penalize_diverged(found.end[:, 1] - state[FIELDS["position"]][1], seconds)
    return far


def refine(
    first: Controller,
    robot: Robot,
    state: Floats,
    seconds: float,
    generations: int,
    rng: np.random.Generator,
    sigma: float = 0.05,
) -> tuple[Controller, float]:
    """Return a gait refined from ``first`` by CMA-ES for a state, and how far it would swim."""
    template, body = Template.like(first), Morphology.from_array(robot.body)
    search = Strategy(
        template.vector(first),
        lambda x: template.controller(x, first.clock, body, first.seed),
        POPULATION,
        rng,
        sigma,
    )
    best, best_far = first, float(imagine([first], robot, state, seconds)[0])
    for _ in range(generations):
        proposal = search.ask()
        tried = [*proposal.controllers, *(proposal.finalists or [])]
        far = imagine(tried, robot, state, seconds)
        top = int(far.argmax())
        if far[top] > best_far:
            best, best_far = tried[top], float(far[top])
        search.tell(far[: len(proposal.controllers)].tolist(), first, best_far)
    return best, best_far
