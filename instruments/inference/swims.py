"""Swims as experiments: a body from five seconds of a gait, and a change of body noticed."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from aquafish_gym import Damage, Morphology, held_out
from aquafish_gym.command import scale_action
from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.engines.compiled.single import CompiledWorld
from aquafish_gym.physics.kinematics import rotation
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.scenario import Scenario
from eea import RecordedLog, SwimLog, estimate_morphology_of, infer_log, watch_swim
from eea.fish.windows import LAG_SAMPLES
from eea.infer.answer import Answer
from gait.controllers.controller import INTERVAL, Controller
from gait.search.evolve import EvolveConfig, evolve_gait
from instruments.inference.recovery import measure_recovery, summarise_recovery
from instruments.inference.robots import SPANS, Floats

#: Swims -> how many, at full size.
SWIMS = {"window": 25, "unchanged": 100, "struck": 100, "recovery": 60}
TITLES = {
    "window": "five seconds of a gait, begun in mid-swim",
    "unchanged": "a minute of the undamaged fish's gait, watched",
    "struck": "damage that strikes in mid-swim, watched",
}
NOISE = 0.01  # rad/s
SECONDS = 5.0  # of a window
MINUTE, STRIKES, AFTER = 60.0, (5.0, 10.0), 10.0  # s
SOON = 3.0  # s, within which damage is to be noticed
GAITS = 10  # of the undamaged fish, each with a belief of its own
BRISK = 0.05  # rev/s or Hz: a servo whose mean speed is less hardly moves


def measure_swim(name: str, number: int, rng: np.random.Generator) -> dict[str, Any]:
    """Return what is found of one swim of ``SWIMS``."""
    if name == "window":
        return _window(number, rng)
    if name == "recovery":
        return measure_recovery(number, rng)
    gait, belief = _known(number % GAITS)
    whole = Morphology.nominal()
    if name == "unchanged":
        watched = watch_swim(_swim(gait, whole, MINUTE, rng), belief, threads=1)
        return {
            "noticed": watched.noticed,
            "windows": len(watched.looks),
            "least": min(look.p for look in watched.looks),
        }
    damages = held_out("recovery")
    damage = Damage.parse(damages[number // GAITS % len(damages)])
    at = round(float(rng.uniform(*STRIKES)), 2)
    swim = _swim(gait, whole, at + AFTER, rng, damage.apply(whole), at)
    watched = watch_swim(swim, belief, until_noticed=True, threads=1)
    return {
        "damage": str(damage),
        "struck": at,
        "noticed": watched.noticed,
        "moved": _moved(swim.commands[round(at / TIMESTEP) :]),
    }


def _window(number: int, rng: np.random.Generator) -> dict[str, Any]:
    """Return what five seconds of a damaged fish's own gait tell of its body."""
    shares = rng.uniform(0.5, 1.0, len(AQUAFISH.dimensions))
    body = Morphology.from_array(shares * Morphology.nominal().to_array())
    gait = evolve_gait(
        body,
        EvolveConfig(seed=number, generations=15, population=60, threads=1, paper=True),
    )
    swim = _swim(gait.controller, body, 2 * SECONDS, rng)
    first = len(swim.time) - round(SECONDS / TIMESTEP) - LAG_SAMPLES - 1
    swim = SwimLog(swim.time[first:], swim.gyro[first:], swim.commands[first:])
    found = infer_log(swim, seed=number, truth=body, moving=True, threads=1)
    low, high = found.interval(0.9)
    assert isinstance(found.belief, Answer)
    truth = body.to_array()
    return {
        "fitness": found.objective_fitness,
        "covered": ((low <= truth) & (truth <= high)).tolist(),
        "width": ((high - low) / SPANS).tolist(),
        "good": found.belief.good,
        "moved": _moved(swim.commands),
    }


def _moved(commands: Floats) -> list[bool]:
    """Return which servos a gait moves."""
    moved: list[bool] = (np.abs(commands).mean(axis=0) > BRISK).tolist()
    return moved


@lru_cache(maxsize=GAITS)
def _known(number: int) -> tuple[Controller, Answer]:
    """Return a gait of the undamaged fish, and what it believes after three trials."""
    body, rng = Morphology.nominal(), np.random.default_rng([number, 1])

    class Fish:
        def perform(self, command: Floats) -> RecordedLog:
            world = CompiledWorld()
            world.start(Scenario.create(body, fin_angles=rng.uniform(-np.pi, np.pi, 3)))
            left, right, caudal = command.tolist()
            felt = []
            for _ in range(256):
                world.advance((left, right, caudal))
                felt.append(world.state().spin)
            return RecordedLog(gyro=np.array(felt) + rng.normal(0.0, NOISE, (256, 3)))

    belief = estimate_morphology_of(Fish(), seed=number, threads=1).belief
    assert isinstance(belief, Answer)
    config = EvolveConfig(seed=number, generations=30, population=60, threads=1, paper=True)
    return evolve_gait(body, config).controller, belief


def _swim(
    gait: Controller,
    body: Morphology,
    seconds: float,
    rng: np.random.Generator,
    become: Morphology | None = None,
    at: float = 0.0,
) -> SwimLog:
    """Return a swim of a gait that feels its noisy gyroscope; the robot may become another."""
    world, policy = CompiledWorld(), gait.policy()
    world.start(Scenario.create(body, fin_angles=rng.uniform(-np.pi, np.pi, 3)))
    felt, told = [np.zeros(3)], []
    for t in range(round(seconds / TIMESTEP)):
        if become is not None and t == round(at / TIMESTEP):
            world.update(Scenario.create(become))
        if t % INTERVAL == 0:
            turned = rotation(world.state().orientation)
            seen = np.array([*turned[2], *turned[1], *felt[-1]])
            left, right, caudal = scale_action(
                AQUAFISH, np.asarray(policy(seen, t * TIMESTEP))
            ).tolist()
        world.advance((left, right, caudal))
        felt.append(np.array(world.state().spin) + rng.normal(0.0, NOISE, 3))
        told.append((left, right, caudal))
    return SwimLog.of_trials([np.array(told)], [RecordedLog(np.array(felt[1:]))], moving=True)


def summarise_swims(name: str, documents: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return a swim's part of the report."""
    if name == "recovery":
        return summarise_recovery(documents)
    if name == "window":
        fitness = np.array([d["fitness"] for d in documents])
        tail = np.array([d["moved"][2] for d in documents])
        return {
            "swims": len(documents),
            "median": float(np.median(fitness)),
            "least": float(fitness.min()),
            "all_fins": int(sum(all(d["moved"]) for d in documents)),
            "median_all_fins": _median([d["fitness"] for d in documents if all(d["moved"])]),
            "median_tail_still": _median(fitness[~tail].tolist()),
            "covered": float(np.mean([d["covered"] for d in documents])),
        }
    if name == "unchanged":
        return {
            "swims": len(documents),
            "windows": sum(d["windows"] for d in documents),
            "alarms": sum(d["noticed"] is not None for d in documents),
            "least": min(d["least"] for d in documents),
        }
    delays = [None if d["noticed"] is None else d["noticed"] - d["struck"] for d in documents]
    early = [delay is not None and delay < 0.0 for delay in delays]
    return {
        "swims": len(documents),
        "soon": sum(delay is not None and 0.0 <= delay <= SOON for delay in delays),
        "early": sum(early),
        "median_delay": _median([d for d in delays if d is not None and d >= 0.0]),
        "unnoticed": sorted(
            {d["damage"] for d, delay in zip(documents, delays, strict=True) if delay is None}
        ),
    }


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if len(values) else None
