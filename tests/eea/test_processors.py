"""The same seed gives the same body, and the same gait for it, on every processor.

OpenBLAS has kernels for each, which round differently. Least squares magnifies that to 1e-8, and a
search for a gait would magnify it to another gait. ``tests/engines`` compares the physics.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys

import numpy as np
import pytest

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
def test_a_body_its_gait_and_an_agent_do_not_depend_on_the_processor() -> None:
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
