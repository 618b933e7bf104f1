"""Faults of servos and gyroscope, given as damage, are named by joint inference."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eea import (
    EngineTarget,
    JointConfig,
    JointInference,
    RealityGap,
)
from eea.core.session import streams
from eea.fish.joint import fish_robot
from eea.fish.simulator import EngineSimulator, fish_problem
from eea.infer.answer import Answer
from eea.infer.file import from_arrays, to_arrays

STEPS = 96
SMALL = JointConfig(
    steps=STEPS, bodies=24, poses=12, descents=6, polished=2, restarts=0, alternatives="always",
    nuisances=(),
)  # fmt: skip


def believed(damage: str, part: str = "left flipper", rounds: int = 2, **more) -> Answer:
    """Return what a target's trials tell, of the hypotheses that speak of a part."""
    config = replace(SMALL, rounds=rounds, **more)
    gap = RealityGap(gyro_noise=0.01)
    target = EngineTarget(None, damage, streams(1)["target"], STEPS, "numba", gap=gap)
    joint = fish_robot(EngineSimulator(STEPS, threads=1))
    some = tuple(h for h in joint.hypotheses if f"servo of the {part}" in h.name)
    result = JointInference(
        target, replace(joint, hypotheses=some), fish_problem(), config, 1
    ).run()
    assert isinstance(result.belief, Answer)
    return result.belief


@pytest.mark.parametrize(
    ("damage", "part", "fault"),
    [
        ("left_pectoral:reversed", "left flipper", "reversed"),
        pytest.param("caudal:seized", "tail", "seized", marks=pytest.mark.slow),
        pytest.param("left_pectoral:dead", "left flipper", "dead", marks=pytest.mark.slow),
        pytest.param("left_pectoral:weak=0.5", "left flipper", "weak", marks=pytest.mark.slow),
    ],
)
def test_a_servos_fault_is_named(damage: str, part: str, fault: str) -> None:
    belief = believed(damage, part, rounds=1 if "reversed" in damage else 2)
    assert belief.good, belief.verdict
    assert belief.findings[0].startswith(f"the servo of the {part} is {fault} (")
    assert belief.branches[0].probability > 0.8
    if "weak" in damage:
        middle, low, high = belief.table()[f"servo of the {part}"]
        assert low < middle < high
        assert middle == pytest.approx(0.5, abs=0.03)
        assert from_arrays(to_arrays(belief)).to_dict() == belief.to_dict()


def test_a_gyroscopes_bias_is_found() -> None:
    belief = believed("gyro_z:bias=0.1", rounds=1, alternatives="never", nuisances=("gyro_bias",))
    assert belief.good, belief.verdict
    found = [belief.table()[f"gyro bias {axis}"][0] for axis in "xyz"]
    np.testing.assert_allclose(found, [0.0, 0.0, 0.1], atol=0.01)


def test_what_no_hypothesis_says_is_noticed() -> None:
    belief = believed("left_pectoral:dead@0.4", rounds=1, alternatives="never")
    assert not belief.good
    assert belief.findings[0].startswith("no body explains the log")


def test_a_reversed_tail_is_no_fault_that_shows() -> None:
    """It sweeps as any that began at another phase."""
    target = EngineTarget(None, "caudal:reversed", streams(1)["target"], STEPS, "numba")
    command = np.array([0.3, 0.2, 0.9])
    log, begun = target.perform(command), target.start_angles
    same = EngineSimulator(STEPS, dtype="float64", threads=1)
    robot = fish_robot(same)
    values = {n: np.array([one.mean]) for n, one in robot.table.items() if one.mean is not None}
    values |= zip(robot.sought, target.morphology.to_array()[:, None], strict=True)
    angles = np.array([begun[0], begun[1], np.pi - begun[2]])
    values |= zip(robot.angles, angles[:, None], strict=True)
    there = robot.simulate(values, command[None], True)
    np.testing.assert_allclose(log.gyro, there, rtol=0, atol=1e-12)
