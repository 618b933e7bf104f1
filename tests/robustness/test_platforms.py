"""What Windows and macOS lack is not needed: no module imports it, and runs work without it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

CODE = """
import importlib
import os
import pkgutil
import signal
import sys

import filelock  # it has a lock of its own for each system

for module, names in {
    os: ("sched_getaffinity", "O_NOFOLLOW", "O_CLOEXEC", "fork", "register_at_fork", "sysconf"),
    signal: ("pthread_sigmask", "SIG_BLOCK", "SIG_UNBLOCK", "SIGHUP"),
}.items():
    for name in names:
        vars(module).pop(name, None)
# torch, which stable_baselines3 imports, goes by the name of the system.
EXTRAS = {"distributed", "pybullet", "stable_baselines3", "viser"}
for name in ("fcntl", "grp", "pwd", "resource", "termios", "pybullet", "stable_baselines3"):
    sys.modules[name] = None

from aquafish_gym.utils.validation import MissingExtraError

count = 0
for package in ("aquafish", "aquafish_gym", "eea", "gait"):
    path = importlib.import_module(package).__path__
    for found in pkgutil.walk_packages(path, package + "."):
        try:
            importlib.import_module(found.name)
            count += 1
        except MissingExtraError as error:
            assert "aquafish-gym[rl]" in str(error)
        except ModuleNotFoundError as error:
            if str(error.name).partition(".")[0] not in EXTRAS:
                raise

from pathlib import Path

from aquafish_gym import simulate
from aquafish_gym.runs import manifest, workers

log = simulate(None, [[0.1, 0.1, 0.5]], steps=4, engine="numba", dtype="float32")
manifest.REMOVES_OPEN_FILES = False
with manifest.result_folder(sys.argv[1], "a test", {"steps": 4}, ()) as folder:
    try:
        with manifest.lock(folder):
            raise AssertionError("locked twice")
    except manifest.InvalidArgumentError as error:
        print(error)
with workers.workers(2) as pool:
    sent = pool.submit(abs, -3).result()
print(count, log.gyro.shape, sent, *sorted(path.name for path in Path(sys.argv[1]).iterdir()))
"""


@pytest.mark.slow  # it imports all modules
def test_all_modules_import_and_runs_work_without_what_other_systems_lack(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", CODE, str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    refused, result = done.stdout.splitlines()
    assert refused == f"out: {tmp_path} is in use by another command"
    count, rest = result.split(" ", 1)
    assert int(count) > 150
    assert rest == "(1, 4, 3) 3 settings.json"


WITHOUT_COMPILER = """
import numpy as np, gymnasium as gym
from aquafish.online import SelfModelAgent
from aquafish_gym import Morphology, simulate
from aquafish_gym.rollout import rollout
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.validation import EngineUnavailableError
from eea.fish import EngineTarget
from gait import Controller, EvolveConfig, evaluate, evolve_gait, swim, scores
from gait.controllers.controller import program_of

still = Controller(np.zeros((3, 14)), np.zeros(3), np.ones(3), 0.7, Morphology.nominal(), 0)
for engine in ("numba", "pybullet"):
    env = gym.make("AquaFish-v0", engine=engine)
    env.reset(seed=0)
    print(env.step(np.ones(3, np.float32))[0].round(6).tolist())
simulate(None, (0.1, 0.1, 0.1), steps=9, engine="pybullet")
for use in (
    lambda: simulate(None, (0.1, 0.1, 0.1), steps=9),
    lambda: gym.make_vec("AquaFish-v0", 2),
    lambda: rollout(program_of([still]), Scenario.create(), seconds=0.1),
    lambda: EngineTarget(None, engine="numba"),
    lambda: evaluate(lambda seen: np.zeros((len(seen), 3)), episodes=1),
    lambda: scores([still], None),
    lambda: swim(still, None, engine="numba"),
    lambda: evolve_gait(None, EvolveConfig(seconds=0.1)),
    lambda: SelfModelAgent().begin((0.0, 0.0, 0.0)),
):
    try:
        use()
    except EngineUnavailableError as error:
        print(error)
"""


@pytest.mark.pybullet
def test_without_numbas_compiler_a_sentence_says_so() -> None:
    found = subprocess.run(
        [sys.executable, "-c", WITHOUT_COMPILER],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    one, two, *sentences = found.stdout.splitlines()
    assert one == two
    assert len(sentences) == 9
    assert set(sentences) == {
        "the compiled engine and controllers need numba's compiler, which NUMBA_DISABLE_JIT turns "
        "off; unset it"
    }
