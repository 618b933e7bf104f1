"""Faults of ``AquaFishRecovery-v0``, inferred from the five seconds after them, and recognised."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from itertools import islice
from typing import Any

import gymnasium as gym
import numpy as np

import aquafish_gym  # noqa: F401  registers the environment
from aquafish.online.gaits import load_library
from aquafish.online.recognition import recognise
from aquafish_gym import Damage, Morphology
from aquafish_gym.command import scale_action
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.scenario import Scenario
from eea import SwimLog, infer_changes, infer_log, known_body
from eea.core.config import FitConfig
from eea.fish.hypotheses import servo_names
from eea.infer.answer import Answer
from gait.controllers.agents import ControllerAgent
from gait.swims.episode import transitions
from instruments.inference.robots import SPANS, Floats
from instruments.verification.tables import Table

NAME = "AquaFishRecovery-v0"
TIERS = ("severe", "moderate")
NOISES = (0.01, 0.0)  # rad/s, in turn for each two swims
LEAST_NOISE = 1e-6  # rad/s: observations are in single precision
ACTIONS, HOLD, DT = 25, 20, 0.2  # after the onset; steps of 0.01 s; s
EARLIEST, LATEST = 75, 150  # actions before the onset
NEAR_SIZE, NEAR_GAIN = 0.05, 0.05  # of a range, of a gain: a body that is right
TOLERANCE = 0.02  # rad/s: as the agent's
NOTHING = "nothing"  # is known
BODY = "the body before"
RECOGNISE = "body and state before, by recognise"


def measure_recovery(number: int, rng: np.random.Generator) -> dict[str, Any]:
    """Return what is found of one swim; its number sets the tier and the noise."""
    tier, noise = TIERS[number % 2], NOISES[number // 2 % 2]
    damage, onset = _draw(tier, rng), int(rng.integers(EARLIEST, LATEST + 1))
    actions, observed = _swim(damage, noise, onset, int(rng.integers(2**31)))
    whole = Scenario.create(fin_angles=observed["fin_angles"])
    truth = damage.edit(Scenario.create())
    lanes = LaneBatch(whole, np.float64, threads=1)
    for command in scale_action(AQUAFISH, actions[:onset]):
        lanes.advance(command[None], HOLD)
    state = lanes.states[:, 0].astype(np.float64)
    after = scale_action(AQUAFISH, actions[onset:])
    log = SwimLog(
        np.round(DT * np.arange(ACTIONS + 1), 9),
        observed["gyro"][onset:],
        np.concatenate([after, after[-1:]]),
    )
    found = {
        NOTHING: _inferred(log, truth, noise, known=False),
        BODY: _inferred(log, truth, noise, known=True),
        RECOGNISE: _recognised(state, log.gyro[1:], actions[onset:], noise, truth),
    }
    return {"damage": str(damage), "tier": tier, "noise": noise, "found": found}


def _draw(tier: str, rng: np.random.Generator) -> Damage:
    """Return a damage of fins alone: the gyroscope is the only sensor here."""
    while True:
        damage = Damage.parse(f"random:{tier}").sample(rng)
        if all(fault.part in AQUAFISH.names for fault in damage.faults):
            # Dead in mid-swim is seized: the angle is random only from the start.
            return Damage.parse(str(damage).replace(":dead", ":seized"))


def _swim(damage: Damage, noise: float, onset: int, seed: int) -> tuple[Floats, dict[str, Floats]]:
    """Return the actions (K, 3) of an episode's part, and what was observed before and after."""
    faults = "; ".join(f"{fault}@{DT * onset!r}" for fault in damage.faults)
    env = gym.make(NAME, damage=f"gyro:noise={noise!r}; {faults}", engine="numba")
    seen, info = env.reset(seed=seed)
    fins = info["fin_angles"].copy()
    gait = ControllerAgent(load_library()[0])
    gait.reset(info)
    steps = list(islice(transitions(env, gait.act, seen), onset + ACTIONS))
    actions = np.array([step.action for step in steps], float)
    gyro = np.array([seen[6:9], *(step.observation[6:9] for step in steps)], float)
    env.close()
    return actions, {"fin_angles": fins, "gyro": gyro}


def _inferred(log: SwimLog, truth: Scenario, noise: float, known: bool) -> dict[str, Any]:
    """Return what is inferred, and whether ``known`` is the body before the fault.

    The water and the sensor are known to be as modelled.
    """
    noise = max(noise, LEAST_NOISE)
    began = time.process_time()
    if known:
        before = known_body(Morphology.nominal(), noise, nuisances=())
        belief = infer_changes(log, before, threads=1)
    else:
        config = FitConfig(nuisances=(), noise=noise)
        found = infer_log(log, config, moving=True, threads=1).belief
        assert isinstance(found, Answer)
        belief = found
    seconds = time.process_time() - began
    best, table = belief.branches[0].hypothesis, belief.table()
    gains = [
        table[servo][0] if servo in table else best.fixed.get(servo, 1.0)
        for servo in servo_names(AQUAFISH).values()
    ]
    named = [word in best.name for word in AQUAFISH.words.values()] if known else None
    return _judged(belief.model, np.array(gains), truth, seconds, named)


def _recognised(
    state: Floats, gyro: Floats, actions: Floats, noise: float, truth: Scenario
) -> dict[str, Any]:
    """Return what ``recognise`` finds from the same state."""
    observed = np.concatenate([np.zeros((len(gyro), 6)), gyro], axis=1)
    sd = np.array([np.inf] * 6 + [noise] * 3)
    tolerance = np.full(9, max(TOLERANCE, 5.0 * noise))
    began = time.process_time()
    found = recognise([Scenario.create()], [state], observed, actions, sd, tolerance, HOLD)
    seconds = time.process_time() - began
    named = [any(fin == fault.part for fault in found.damage) for fin in AQUAFISH.names]
    return _judged(found.robot.body[0], found.robot.servo_gain[0], truth, seconds, named)


def _judged(
    body: Floats, gains: Floats, truth: Scenario, seconds: float, named: list[bool] | None
) -> dict[str, Any]:
    """Return how near a body and gains are to the truth."""
    off = np.abs(body - truth.body[0]) / SPANS
    there = truth.body[0].reshape(3, 3).min(axis=1) > 0.0
    far = np.abs(gains - truth.servo_gain[0])[there]
    whole = Scenario.create()
    broken = [
        bool((one != other).any()) or gain != 1.0
        for one, other, gain in zip(
            truth.body[0].reshape(3, 3),
            whole.body[0].reshape(3, 3),
            truth.servo_gain[0],
            strict=True,
        )
    ]
    return {
        "fitness": float(1.0 - off.mean()),
        "right": bool(off.max() <= NEAR_SIZE and (far <= NEAR_GAIN).all()),
        "named": None if named is None else named == broken,
        "seconds": seconds,
    }


def summarise_recovery(documents: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the report's part: by noise and tier, what each way found."""
    part: dict[str, Any] = {}
    for noise in NOISES:
        for tier in TIERS:
            some = [d["found"] for d in documents if (d["noise"], d["tier"]) == (noise, tier)]
            if some:
                part[f"{tier}, {noise:g} rad/s"] = {
                    name: _summary([found[name] for found in some if name in found])
                    for name in some[0]
                }
    return part


def _summary(found: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    fitness, seconds = (np.array([f[key] for f in found]) for key in ("fitness", "seconds"))
    return {
        "swims": len(found),
        "median": float(np.median(fitness)),
        "least": float(fitness.min()),
        "right": sum(f["right"] for f in found),
        "named": None if found[0]["named"] is None else sum(f["named"] for f in found),
        "seconds": float(seconds.mean()),
    }


def recovery_table(part: Mapping[str, Any]) -> Table:
    """Return what was found of the swims."""
    rows = []
    for swims, ways in part.items():
        for name, s in ways.items():
            named = "" if s["named"] is None else f"{s['named']} of {s['swims']}"
            rows.append(
                (swims, name, str(s["swims"]), f"{s['median']:.3f}", f"{s['least']:.3f}", named,
                 f"{s['right']} of {s['swims']}", f"{s['seconds']:.2f}")
            )  # fmt: skip
    columns = (
        "damage, noise",
        "known",
        "swims",
        "median OBJ_FIT",
        "least",
        "fins",
        "body",
        "CPU s",
    )
    return Table("five seconds at 5 Hz after a fault", columns, rows, words=2)
