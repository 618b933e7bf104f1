"""Is the wheel enough by itself? Run by an environment that holds it, in an empty directory.

    python smoke.py

It asserts what the wheel holds, runs commands of each package small, and says one line.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from importlib.metadata import files
from pathlib import Path

import gymnasium as gym

import aquafish_gym

PACKAGES = {"aquafish", "aquafish_gym", "eea", "gait"}
SMALL_MODEL = ("--condition", "out-of-band", "--rounds", "1", "--steps", "16",
               "--estimation.population", "6", "--estimation.generations", "2",
               "--exploration.population", "6", "--exploration.generations", "2")  # fmt: skip

SMALL_SEARCH = ("--generations", "1", "--population", "10", "--poses", "0", "--paper",
                "--seconds", "0.2")  # fmt: skip


def check_content() -> None:
    """Assert that the wheel holds the packages with their data, and nothing of the tests."""
    held = [str(file) for file in files("aquafish-gym") or [] if ".." not in file.parts]
    packages = {name.partition("/")[0] for name in held if not name.startswith("aquafish_gym-")}
    assert packages == PACKAGES, packages
    data = ("gait/controllers/controller.c", "gait/controllers/controller.h",
            "gait/controllers/model.c", "gait/search/neat.ini", "aquafish_gym/damage/held_out.json",
            "aquafish/page/agent.js", "aquafish_gym/rendering/web/scene.js")  # fmt: skip
    for name in (*(f"{package}/py.typed" for package in PACKAGES), *data):
        assert name in held, name
    assert not Path(str(aquafish_gym.__file__)).is_relative_to(Path.cwd()), "not the wheel's"


def run(*command: str) -> None:
    """Run a program of this environment."""
    name, *arguments = command
    program = [sys.executable, "-m", name]
    if name == "aquafish":
        program = [str(Path(sys.executable).parent / "aquafish")]
    done = subprocess.run([*program, *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{' '.join(command)}\n{done.stdout}\n{done.stderr}"


def main() -> None:
    """Check everything; an AssertionError says what is wrong."""
    began = time.monotonic()
    check_content()
    for command in ("aquafish", "eea", "gait"):
        run(command, "--help")
    run("aquafish", "recover", "--help")
    run("eea", "run", "--out", "model", "--target-damage", "caudal:missing", *SMALL_MODEL)
    run("gait", "evolve", "--morphology", "model/morphology.json", "--out", "gait", *SMALL_SEARCH)
    run("gait", "transfer", "--controller", "gait/controller.json",
        "--poses", "1", "--seconds", "0.2", "--target-damage", "caudal:missing")  # fmt: skip
    run("gait", "export", "gait/controller.json", "--c", "fish.c",
        "--model", "model.c")  # fmt: skip
    result = json.loads(Path("model/result.json").read_text(encoding="utf-8"))
    assert len(result["rounds"]) == 1
    env = gym.make("AquaFish-v0", render_mode="rgb_array")
    env.reset(seed=0)
    before = env.render()
    env.step(env.action_space.sample())
    assert (env.render() != before).any()
    env.close()
    print(f"the wheel works on Python {sys.version.split()[0]} ({time.monotonic() - began:.0f} s)")


if __name__ == "__main__":
    import os

    with tempfile.TemporaryDirectory() as empty:
        os.chdir(empty)
        main()
