"""Hashes of what every public command and environment gives at smoke size.

    python -m tests.golden               # which cases differ from tests/golden.json
    python -m tests.golden --show NAME   # the numbers of one case, to compare two versions
    python -m tests.golden --write       # accept the present results; say why in the commit

Numbers are hashed to six significant digits, since the last digits of numpy's sines and transforms
differ between CPUs. Joint inference magnifies them: its cases are well-posed and keep three
decimals. Times, versions and paths are left out.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import hashlib
import io
import json
import re
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import aquafish_gym

HASHES = Path(__file__).with_suffix(".json")
ROOT = Path(__file__).parents[1]
DAMAGE = "left_pectoral:length=0.5"
# What may differ between two equal runs or versions and is no result.
NOT_RESULTS = {
    "checksum", "schema", "config", "settings", "seconds", "cpu_seconds", "versions", "code",
    "evaluation_seconds",
}  # fmt: skip
DIGITS = 6


def canonical(value: Any, digits: int = DIGITS) -> Any:
    """Return nested lists and dictionaries with numbers as text of some significant digits."""
    if isinstance(value, dict):
        kept = {key: each for key, each in value.items() if key not in NOT_RESULTS}
        return {str(key): canonical(kept[key], digits) for key in sorted(kept, key=str)}
    if isinstance(value, np.ndarray):
        return canonical(value.tolist(), digits)
    if isinstance(value, list | tuple):
        return [canonical(each, digits) for each in value]
    if isinstance(value, float | np.floating):
        return f"{float(value) + 0.0:.{digits}g}"
    if isinstance(value, np.generic):
        return canonical(value.item(), digits)
    return value


def text_of(value: Any, digits: int = DIGITS) -> str:
    return json.dumps(canonical(value, digits), indent=1, sort_keys=True)


# Environments and the simulator


def environment(name: str, options: dict[str, Any], batched: bool = False) -> Any:
    """Return all observations, rewards and infos of most of an episode under random actions."""
    make = partial(gym.make_vec, num_envs=3) if batched else partial(gym.make)
    env: Any = make(name, **options)
    found, info = env.reset(seed=5)
    rng = np.random.default_rng(1)
    rows = [[found, info["fin_angles"]]]
    for _ in range(150 if name == "AquaFishRecovery-v0" else 80):
        action = rng.uniform(-1, 1, env.action_space.shape).astype(np.float32)
        found, reward, terminated, truncated, info = env.step(action)
        numbers = {key: each for key, each in info.items() if not key.startswith("_")}
        rows.append([found, reward, terminated, truncated, numbers])
    env.close()
    return rows


def drawn_damage() -> Any:
    """Return what each tier of random damage draws, on which every published result rests."""
    from aquafish_gym.damage import TIERS, Damage

    rng = np.random.default_rng(6)
    tiers = {tier: Damage.parse(f"random:{tier}@2-8") for tier in TIERS}
    return {tier: [str(each.sample(rng)) for _ in range(200)] for tier, each in tiers.items()}


def trials(**options: Any) -> Any:
    """Return the log of three robots simulated with some options."""
    rng = np.random.default_rng(2)
    bodies = rng.uniform(0.05, 0.5, (3, 9))
    fins = rng.uniform(-3, 3, (3, 3))
    commands = rng.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 1.0], (3, 3))
    if options.pop("series", False):
        commands = rng.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 1.0], (3, 4, 3))
    log = aquafish_gym.simulate(bodies, commands, fins, steps=64, record="pose", **options)
    return [log.rpy, log.gyro, log.position, log.quaternion, log.fin_angles]


def fit_of_fins(density: float) -> Any:
    """Return the posterior of three trials of a robot with fins of a density, in times water's."""
    from aquafish_gym.engines.api import simulate_scenario
    from aquafish_gym.scenario import Scenario
    from eea import FitConfig
    from eea.fish.joint import fish_robot
    from eea.fish.simulator import EngineSimulator
    from eea.infer.fit import fit
    from eea.infer.trials import Observed

    rng = np.random.default_rng(3)
    body = aquafish_gym.Morphology.nominal().to_array()
    commands = np.array([[0.5, -0.4, 1.0], [-0.4, 0.5, 0.8], [0.5, 0.4, 1.0]])
    angles = rng.uniform(-np.pi, np.pi, (3, 3))
    scenario = Scenario.create(body, fin_angles=angles, fin_density=np.full(3, density))
    log = simulate_scenario(scenario, commands, 256, "numba", "float64", record="gyro").gyro
    signal = log + rng.normal(0.0, 0.03, log.shape)
    effort = FitConfig(alternatives="never", restarts=0)
    robot = fish_robot(EngineSimulator(256, threads=1))
    return fit(Observed(commands, signal), robot, effort, rng)


def dense_fins() -> Any:
    """Return the intervals of a robot whose log contradicts the assumed density of its fins."""
    return np.round(fit_of_fins(1.5).interval(0.9), 3)


def random_networks() -> list[Any]:
    """Return two linear controllers."""
    from aquafish_gym import Morphology
    from gait import Controller

    rng, body = np.random.default_rng(3), Morphology.nominal()
    return [
        Controller(
            np.pad(rng.normal(size=(3, 11)), ((0, 0), (0, 3))), rng.normal(size=3), np.ones(3), 0.7,
            body, seed=0,
        )
        for _ in range(2)
    ]  # fmt: skip


def swims(dtype: str) -> Any:
    """Return how far two networks swim on two bodies, in the lanes and alone."""
    from aquafish_gym import Morphology
    from gait import scores, swim

    networks, body = random_networks(), Morphology.nominal()
    broken = [body, {"left_pectoral": (0.4, 0.8, 0.1)}]
    far = scores(networks, broken, [(0.1, 0.2, 0.3), (1.0, -2.0, 0.5)], seconds=2, dtype=dtype)
    paths = [swim(network, body, engine="numba", seconds=2).position for network in networks]
    return [far, paths]


def exported() -> Any:
    """Return a controller's C file, its header and its test vectors, as written."""
    from gait.controllers.export import export_c

    with tempfile.TemporaryDirectory() as folder:
        return [path.read_text() for path in export_c(random_networks()[0], f"{folder}/fish.c")]


def printed() -> Any:
    """Return the physics in JavaScript, and a model in C with its test vectors, as written."""
    from aquafish_gym import Morphology
    from aquafish_gym.code_generation import robot_code
    from gait.controllers.export_model import export_model

    code = robot_code()
    functions = set(code.functions) - {code.step_reactive}
    script = code.javascript(*sorted(functions, key=lambda f: f.__name__))
    with tempfile.TemporaryDirectory() as folder:
        files = export_model(Morphology.nominal(), f"{folder}/model.c")
        return [script, *(path.read_text() for path in files)]


# The agent that swims on


def agent_episode() -> Any:
    """Return the events and actions of an episode in which a fin and a sensor break."""
    from aquafish.online import SelfModelAgent

    env = gym.make(
        "AquaFishRecovery-v0", damage="left_pectoral:length=0.4@12; gyro_x:bias=0.2@20",
        engine="numba", max_episode_steps=150,
    )  # fmt: skip
    seen, info = env.reset(seed=7)
    agent, actions, over = SelfModelAgent(), [], False
    agent.begin(info["fin_angles"])
    while not over:
        actions.append(np.asarray(agent.act(seen), np.float64).round(3).tolist())
        seen, _, _, over, info = env.step(np.asarray(actions[-1], np.float32))
    env.close()
    return [[(event.seconds, event.what) for event in agent.events], actions, info["y_position"]]


def league_row() -> Any:
    """Return the ways of two entrants in one short episode of the league."""
    from experiments.league.episodes import Episode, play

    rows = [play(Episode(name, "severe", 0, seconds=32.0)) for name in ("blind", "self-model")]
    return [
        [row["onsets"], [event[:2] for event in row["events"]], np.round(row["way"], 3)]
        for row in rows
    ]


# Commands


def command(run: Callable[..., int], words: Sequence[str], out: Path) -> None:
    """Run a command line; say what it printed if it fails."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        code = run([*words, "--out", str(out)])
    if code:
        raise RuntimeError(f"{' '.join(words)} ended with {code}:\n{said.getvalue()}")


def eea(*words: str) -> Callable[[Path], None]:
    def run(out: Path) -> None:
        from eea.__main__ import main

        command(main, words, out)

    return run


def gait(*words: str) -> Callable[[Path], None]:
    def run(out: Path) -> None:
        from gait.__main__ import main

        command(main, words, out)

    return run


def aquafish(*words: str) -> Callable[[Path], None]:
    def run(out: Path) -> None:
        from aquafish.cli import main

        command(main, words, out)

    return run


def transfer(out: Path) -> None:
    gait(*CMA)(out / "gait")
    gait(
        "transfer", "--controller", str(out / "gait" / "controller.json"),
        "--target-damage", DAMAGE, "--target-engine", "numba", "--poses", "2",
    )(out)  # fmt: skip


def document(name: str, *keys: str) -> Callable[[Path], Any]:
    """Return what reads a JSON file, or some of its keys."""

    def read(out: Path) -> Any:
        found = json.loads((out / name).read_text())
        return {key: found[key] for key in keys} if keys else found

    return read


def to_three_decimals(read: Callable[[Path], Any]) -> Callable[[Path], Any]:
    """Return what reads the same, rounded, without the number of simulated trials."""

    def rounded(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: rounded(each) for key, each in value.items() if key != "trials"}
        if isinstance(value, list):
            return [rounded(each) for each in value]
        return round(value, 3) if isinstance(value, float) else value

    return lambda out: rounded(read(out))


def without_joint_inference(out: Path) -> Any:
    """Return the case study's report without treatments that magnify the last digits."""
    report = json.loads((out / "report.json").read_text())
    magnifying = re.compile("joint|swims-on")
    for part in ("replicates", "treatments"):
        report[part] = {key: row for key, row in report[part].items() if not magnifying.search(key)}
    report["paired"] = [row for row in report["paired"] if not magnifying.search(json.dumps(row))]
    return report


def table(name: str) -> Callable[[Path], Any]:
    """Return what reads a CSV file's rows without the columns of times, numbers to six digits."""

    def read(out: Path) -> Any:
        with (out / name).open(newline="") as lines:
            rows = list(csv.DictReader(lines))
        return [{k: _number(v) for k, v in row.items() if "seconds" not in k} for row in rows]

    return read


def _number(text: str) -> Any:
    try:
        return float(text)
    except ValueError:
        return text


RUN = ("run", "--steps", "64", "--rounds", "2", "--seed", "3", "--target-damage", DAMAGE,
       "--target-engine", "numba", "--gap.gyro-noise", "0.01")  # fmt: skip
JOINT = ("run", "--condition", "joint", "--steps", "256", "--rounds", "2", "--seed", "3",
         "--target-damage", DAMAGE, "--target-engine", "numba")  # fmt: skip
CMA = ("evolve", "--search", "cma", "--seed", "1", "--restarts", "2", "--random-candidates", "8",
       "--generations", "3", "--poses", "2")  # fmt: skip
NEAT = ("evolve", "--search", "neat", "--seed", "1", "--restarts", "2", "--generations", "2",
        "--cma-generations", "2", "--population", "10", "--poses", "2")  # fmt: skip
SMALL_STUDY = ("--rounds", "2", "--joint-rounds", "1", "--steps", "64", "--models", "6",
               "--angle-sets", "6", "--generations", "3", "--population", "12",
               "--gait-poses", "1", "--search-generations", "3", "--search-restarts", "1",
               "--random-candidates", "10", "--search-population", "10",
               "--direct-generations", "2", "--poses", "2", "--seconds", "2",
               "--target-engine", "numba", "--no-film")  # fmt: skip
RECOVER = ("recover", *SMALL_STUDY, "--workers", "1")
RESULT = document("result.json", "morphology", "truth", "rounds", "stopped")
CONTROLLER = document("controller.json")

#: Name -> what makes a folder, and what is read from it.
COMMANDS: dict[str, tuple[Callable[[Path], None], Callable[[Path], Any]]] = {
    **{
        f"run {condition}": (eea(*RUN, "--condition", condition), RESULT)
        for condition in ("none", "ideal", "in-band", "out-of-band", "recovery")
    },
    "run joint": (eea(*JOINT), to_three_decimals(RESULT)),
    "infer": (
        eea("infer", "--log", str(ROOT / "examples" / "logs" / "swim.csv")),
        to_three_decimals(document("result.json")),
    ),
    "study": (eea("study", "--preset", "smoke", "--workers", "1"), table("results.csv")),
    "evolve cma": (gait(*CMA), CONTROLLER),
    "evolve neat": (gait(*NEAT), CONTROLLER),
    "evolve station": (gait(*CMA, "--task", "station"), CONTROLLER),
    "transfer": (transfer, document("transfer.json")),
    "recover": (aquafish(*RECOVER), without_joint_inference),
}

ENVIRONMENTS: dict[str, Callable[[], Any]] = {
    **{
        f"{name} {engine}": partial(environment, name, {"engine": engine})
        for name in (
            "AquaFish-v0", "AquaFishStation-v0", "AquaFishWaypoint-v0", "AquaFishRecovery-v0",
            "AquaFishReturn-v0", "FourFins-v0", "TailFish-v0",
        )
        for engine in ("numba", "pybullet")
    },
    **{
        f"{name} batch {dtype}": partial(
            environment, name, {"dtype": dtype, "damage": "random:severe@1-3+4"}, batched=True
        )
        for name in ("AquaFish-v0", "AquaFishStation-v0", "AquaFishWaypoint-v0")
        for dtype in ("float32", "float64")
    },
    "AquaFish-v0 broken": partial(
        environment,
        "AquaFish-v0",
        {
            "engine": "numba",
            "damage": f"{DAMAGE}; caudal:seized@2; gyro:noise=0.05; up_x:stuck@1+2",
            "observe_fins": "reckoned",
            "current": (0.1, 0.0, -0.1),
            "reactive": True,
            "frame_skip": 10,
        },
    ),
    **{
        f"simulate {engine} {dtype}": partial(trials, engine=engine, dtype=dtype)
        for engine, dtype in (("numba", "float32"), ("numba", "float64"), ("pybullet", "float64"))
    },
    "drawn damage": drawn_damage,
    "simulate nuisances": partial(
        trials, dtype="float64", drag=(0.8, 1.2), servo_gain=(1.0, 0.5, -1.0), lag=0.033,
        current=(0.1, 0.2, 0.0), substeps=2,
    ),
    "simulate series": partial(
        trials, dtype="float64", series=True, interval=7, begun=12, lag=0.02,
        velocity=(0.1, 0.5, 0.0), spin=(0.0, 0.2, 0.1),
    ),
    "simulate reactive": partial(trials, dtype="float32", reactive=True),
    "infer dense fins": dense_fins,
    "swims float32": partial(swims, "float32"),
    "swims float64": partial(swims, "float64"),
    "export": exported,
    "export model": printed,
    "agent episode": agent_episode,
    "league row": league_row,
}  # fmt: skip

NAMES = (*ENVIRONMENTS, *COMMANDS)


def result(name: str) -> str:
    """Return what a case gives, as canonical text."""
    if name in ENVIRONMENTS:
        return text_of(ENVIRONMENTS[name]())
    make, read = COMMANDS[name]
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        make(out)
        return text_of(read(out))


def digest(name: str, out: Path | None = None) -> str:
    """Return the hash of a case, or of a command's case whose folder is there already."""
    text = result(name) if out is None else text_of(COMMANDS[name][1](out))
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def kept() -> dict[str, str]:
    """Return the hashes on disk by case."""
    hashes: dict[str, str] = json.loads(HASHES.read_text())
    return hashes


def _differing(names: Sequence[str]) -> Iterator[tuple[str, str]]:
    before = kept() if HASHES.exists() else {}
    for name in names:
        now = digest(name)
        if before.get(name) != now:
            print(f"{name}: {before.get(name)} -> {now}", flush=True)
            yield name, now


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="cases; all if not given")
    parser.add_argument("--show", metavar="NAME", choices=NAMES)
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    if arguments.show:
        print(result(arguments.show))
        return 0
    changed = dict(_differing(arguments.names or NAMES))
    if arguments.write:
        hashes = {**(kept() if HASHES.exists() else {}), **changed}
        ordered = {name: hashes[name] for name in NAMES if name in hashes}
        HASHES.write_text(json.dumps(ordered, indent=1) + "\n")
        return 0
    return 1 if changed else 0


if __name__ == "__main__":
    sys.exit(main())
