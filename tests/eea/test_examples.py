"""Robots of the examples, what importing loads, and answers that do not depend on the processor."""

from __future__ import annotations

import json
import os
import platform
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import eea

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.slow
def test_a_mujoco_swimmer_finds_its_weak_motor_in_at_most_80_lines(capsys):
    pytest.importorskip("mujoco")
    script = EXAMPLES / "mujoco_robot.py"
    assert len(script.read_text().splitlines()) <= 80
    found = runpy.run_path(str(script))["main"](share=0.7)
    assert found.good, found.verdict
    assert found.probability("the rear motor is weak") > 0.99
    _, low, high = found.broken("rear motor")
    assert low < 0.7 < high
    assert high - low < 0.02
    assert "the rear motor is weak (100%): rear motor 0.70" in capsys.readouterr().out


TOY = EXAMPLES / "toy_robot.py"


def test_a_pendulum_is_modelled_in_under_a_hundred_lines(capsys):
    assert len(TOY.read_text().splitlines()) < 100
    example = runpy.run_path(str(TOY))
    found, true = example["main"](), example["TRUE_BODY"]
    ranges = example["PENDULUM"].models.span
    assert (abs(found - true) / ranges).max() < 0.05
    said = capsys.readouterr().out
    assert said.count("trial ") == 5
    assert f"length: found {found[0]:.3f}, it is 0.630" in said


@pytest.mark.parametrize(
    ("code", "unloaded"),
    [
        (
            f"import runpy; runpy.run_path({str(TOY)!r})",
            "aquafish_gym numba pybullet eea.fish.methods",
        ),
        (
            "import eea; from eea import PaperConfig",
            "matplotlib pybullet torch numba aquafish_gym tyro rich scipy",
        ),
        (
            "from eea import JointConfig, Number, Robot; JointConfig(noise=0.01); Number(0.0, 1.0)",
            "scipy",
        ),
    ],
)
def test_what_is_not_needed_is_not_loaded(code, unloaded):
    code += f"; import sys; print(set({unloaded!r}.split()) & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


def test_a_name_that_is_not_there_is_an_attribute_error():
    with pytest.raises(AttributeError, match="No eea attribute estimate_morphologie"):
        _ = eea.estimate_morphologie


CORES = ("Nehalem", "Haswell")  # of OpenBLAS, which any x86-64 of the last ten years can run
PROGRAM = """
import json
import gymnasium as gym
from aquafish.online import AgentConfig, SelfModelAgent
from aquafish_gym import Morphology
from eea import JointConfig, estimate_morphology
from gait import EvolveConfig, evolve_gait

damage = "left_pectoral:length=0.5"
config = JointConfig(rounds=2, alternatives="never")
found = estimate_morphology(None, damage, config, seed=0, target_engine="numba", threads=1)
quick = EvolveConfig(seed=0, generations=8, random_candidates=24, threads=1)
gait = evolve_gait(found.morphology, quick)
inferred = [
    found.morphology.to_dict(), found.sample(20).tolist(), gait.fitness, found.model.tolist(),
]

env = gym.make("AquaFishRecovery-v0", damage="caudal:missing@11", engine="numba")
observation, info = env.reset(seed=0)
agent = SelfModelAgent(config=AgentConfig(generations=10, refinements=2))
agent.begin(info["fin_angles"])
for _ in range(90):
    observation, _, _, _, info = env.step(agent.act(observation))
events = [(event.seconds, event.what, event.about) for event in agent.events]
print(json.dumps([inferred, [events, agent.model.robot.body.tolist(), info["y_position"]]]))
"""


@pytest.mark.slow
@pytest.mark.skipif(
    platform.machine() != "x86_64", reason="this machine cannot run kernels of x86-64"
)
def test_a_body_its_gait_and_an_agent_do_not_depend_on_the_processor():
    found = []
    for core in CORES:
        settings = {"OPENBLAS_CORETYPE": core, "OPENBLAS_NUM_THREADS": "1"}
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM], env=os.environ | settings, capture_output=True,
            text=True, check=True, timeout=600,
        )  # fmt: skip
        found.append(json.loads(done.stdout.splitlines()[-1]))
    (inferred, swum), (other, other_swum) = found
    assert other[:3] == inferred[:3]
    np.testing.assert_allclose(other[3], inferred[3], rtol=1e-6)  # not handed on
    assert other_swum[:2] == swum[:2]
    assert other_swum[2] == pytest.approx(swum[2], rel=1e-5)
