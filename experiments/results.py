"""Make the committed results, and say how each was made.

    python -m experiments.results                 # all that are not up to date
    python -m experiments.results physics method  # some of them
    python -m experiments.results --plan          # only what is missing, and the time that it takes

A result is made by its own commands in a folder of its own, OUT/NAME. Then its files replace the
committed ones, and its record in docs/provenance.json has the commands, the commit, the date, the
CPU time, and two digests: of the golden cases on which it rests, and of its files. It is up to date
while commands and digests are today's. The same command resumes. A run of a tree with uncommitted
changes, or with --smallest, stays in OUT.
"""

from __future__ import annotations

import hashlib
import json
import os
import shlex
import subprocess
import sys
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from aquafish_gym import held_out
from aquafish_gym.engines.packages import available_cores, check_gpu
from aquafish_gym.runs.command_line import REFUSED, run_command_line
from aquafish_gym.runs.manifest import lock
from aquafish_gym.runs.markdown import markdown_table
from aquafish_gym.runs.version import git, is_clone
from aquafish_gym.utils.storage import ensure_writable_directory, write_bytes
from aquafish_gym.utils.validation import EngineUnavailableError, InvalidArgumentError, one_of

ROOT = Path(__file__).parents[1]
RECORDS = ROOT / "docs" / "provenance.json"
GOLDEN = ROOT / "tests" / "golden.json"
GPU = "an NVIDIA GPU"


@dataclass(frozen=True)
class Result:
    """A committed result.

    Attributes
    ----------
    commands
        Command lines that make it in a folder DIR, one after another; ``--out DIR`` is added.
    files
        Its files from the clone's root, and the files in DIR that they copy.
    golden
        Cases of tests/golden.json: while they are unchanged, the result is.
    cpu_minutes
        Expected CPU time.
    smallest
        Words that make every command very small; None if there are none.
    folder
        Name of its folder, which several results may share; by default that of the result.
    needs
        Modules that must be installed, folders of the clone that must exist (downloads), and "an
        NVIDIA GPU".
    kept
        Why it is not made again, whatever has changed since; "" if it is.
    """

    commands: tuple[str, ...]
    files: Mapping[str, str]
    golden: tuple[str, ...]
    cpu_minutes: float
    smallest: str | None = None
    folder: str = ""
    needs: tuple[str, ...] = ()
    kept: str = ""

    @property
    def is_input(self) -> bool:
        """Whether experiments read its files: those outside docs/."""
        return not all(file.startswith("docs/") for file in self.files)

    def missing(self) -> list[str]:
        """Return what it needs and is not here."""
        return [need for need in self.needs if not _is_here(need)]


def _is_here(need: str) -> bool:
    """Return whether a module, a folder of the clone or a GPU is here."""
    if need == GPU:
        with suppress(EngineUnavailableError):
            check_gpu()
            return True
        return False
    return (ROOT / need).exists() if "/" in need else find_spec(need) is not None


@dataclass(frozen=True)
class Record:
    """How a committed result was made.

    Attributes
    ----------
    commands, commit, date
        Of the run.
    cpu_minutes
        CPU time of the run; None if it was not measured.
    golden
        Digest of the golden cases at that commit; None if it is not known.
    files
        Digest of the files that were committed.
    """

    commands: list[str]
    commit: str
    date: str
    cpu_minutes: float | None
    golden: str | None
    files: str


def _files(folder: str, *names: str) -> dict[str, str]:
    """Return files of a folder that are called as in DIR."""
    return {f"{folder}/{name}": name for name in names}


_LEAGUE = "python -m experiments.league.whole --seeds held-out --first"
_LEAGUE_CASES = ("league row", "agent episode", "AquaFishRecovery-v0 numba", "drawn damage")
_RUNS = ("run none", "run in-band", "run out-of-band")
_JOINT = ("run joint", "infer dense fins")
_SWIMS = ("simulate numba float32", "simulate numba float64")
_IDS = tuple(
    f"{name} numba"
    for name in (
        "AquaFish-v0", "AquaFishStation-v0", "AquaFishWaypoint-v0", "AquaFishRecovery-v0",
        "AquaFishReturn-v0",
    )
)  # fmt: skip
_SMALLEST_RECOVERY = (
    "--replicates 1 --rounds 2 --joint-rounds 1 --steps 64 --models 6 --angle-sets 6 "
    "--generations 3 --population 12 --gait-poses 1 --search-generations 3 "
    "--search-restarts 1 --random-candidates 10 --search-population 10 "
    "--direct-generations 2 --poses 2 --seconds 2"
)
_STUDY = ("conditions", "dimensions", "angles", "final", *(f"fig{i}" for i in range(5, 11)))


def _league(tables: str, files: Mapping[str, str], minutes: float, first: int = 40) -> Result:
    """Return tables of the league, which are played in one folder."""
    return Result(
        commands=(f"{_LEAGUE} {first} --tables {tables}",),
        files={f"docs/results/league/{name}": file for name, file in files.items()},
        golden=_LEAGUE_CASES,
        cpu_minutes=minutes,
        smallest="--episodes 1 --entrants blind self-model",
        folder="league",
    )


def _real(name: str, source: str, minutes: float) -> Result:
    """Return what is inferred of a real robot, from a download of ``source``."""
    data = f"out/downloads/{source.rpartition('/')[2]}"
    return Result(
        commands=(f"python -m experiments.real {name} --data {data}",),
        files=_files("docs/real", f"{name}.png", f"{name}.json"),
        golden=("infer", "infer dense fins"),
        cpu_minutes=minutes,
        needs=(data,),
    )


RESULTS: dict[str, Result] = {
    "recovery": Result(
        commands=("aquafish recover --held-out --replicates 10",),
        files=_files(
            "docs/recovery",
            "report.md",
            "report.json",
            "bodies.png",
            "distances.png",
            "film.webp",
            "fitness.png",
            "paths.png",
            "sizes.png",
        ),
        golden=(
            "recover",
            "run out-of-band",
            *_JOINT,
            "evolve cma",
            "evolve neat",
            "agent episode",
        ),
        cpu_minutes=80,
        smallest=_SMALLEST_RECOVERY,
        needs=("pybullet",),
    ),
    "film": Result(
        commands=("aquafish recover",),
        files={"docs/_static/half-a-flipper.webp": "film.webp"},
        golden=("recover", "run out-of-band", *_JOINT, "evolve cma"),
        cpu_minutes=8,
        smallest=_SMALLEST_RECOVERY,
        needs=("pybullet",),
    ),
    "figures": Result(
        commands=(
            "aquafish study --figure 5 6 7 9 --replicates 25 --rounds 25",
            "aquafish study --figure 8 10 --replicates 8 --rounds 25",
        ),
        files=_files(
            "docs/results/figs-5-to-10",
            "summary.md",
            "summary.json",
            *(f"figures/{name}.png" for name in _STUDY),
        ),
        golden=(*_RUNS, "run ideal", "study"),
        cpu_minutes=180,
        smallest="--preset smoke --replicates 2 --rounds 2",
    ),
    "method": Result(
        commands=(
            "aquafish study --method examples.random_search:random_search --conditions out-of-band "
            "joint --steps 128 --rounds 5 --held-out --replicates 10 --gap.gyro-noise 0.01",
        ),
        files=_files("docs/results/method", "results.csv", "study.json"),
        golden=("run out-of-band", *_JOINT, "study"),
        cpu_minutes=4,
        smallest="--preset smoke --replicates 2 --rounds 2",
    ),
    "minari": Result(
        commands=(
            "aquafish evolve --senses imu clock fins --interval 20",
            "python examples/minari_dataset.py DIR/controller.json --damage random:severe@2-10 "
            "--episodes 10",
        ),
        files={
            f"docs/results/minari/{name}": name
            for name in (
                "aquafish/namespace_metadata.json",
                "aquafish/damaged-v0/data/main_data.hdf5",
                "aquafish/damaged-v0/data/metadata.json",
            )
        },
        golden=("evolve cma", "AquaFish-v0 numba", "drawn damage"),
        cpu_minutes=1,
        smallest="",
        needs=("minari",),
    ),
    "posterior": Result(
        commands=(
            "aquafish run --rounds 2 --damage left_pectoral:length=0.5 --gap.gyro-noise 0.01",
        ),
        files=_files("docs/results", "posterior.png"),
        golden=_JOINT,
        cpu_minutes=0.5,
        smallest="",
    ),
    "gaits": Result(
        commands=(
            "python -m experiments.gaits --replicates 10 --bodies none left_pectoral:length=0.5 "
            "caudal:missing",
        ),
        files={
            "docs/results/gaits/ceiling.md": "table.md",
            "docs/results/gaits/ceiling-times.md": "times.md",
        },
        golden=("evolve cma", "evolve neat"),
        cpu_minutes=50,
        smallest="--replicates 1 --budget-divisor 1000",
    ),
    "gaits-damages": Result(
        commands=(
            "python -m experiments.gaits --replicates 1 --searches NEAT linear mlp recurrent "
            f"'recurrent, fins' --bodies {shlex.join(held_out('recovery'))}",
        ),
        files={
            "docs/results/gaits/damages.md": "table.md",
            "docs/results/gaits/damages-times.md": "times.md",
        },
        golden=("evolve cma", "evolve neat"),
        cpu_minutes=25,
        smallest="--bodies none --budget-divisor 1000",
    ),
    "gaits-sample": Result(
        commands=("python -m experiments.gaits.sample --noise 0.1",),
        files={"docs/results/gaits/sample.md": "table.md"},
        golden=(*_JOINT, "evolve cma"),
        cpu_minutes=30,
        smallest="--replicates 1 --gait.generations 1 --gait.random-candidates 10",
    ),
    "gap": Result(
        commands=("python -m experiments.reality_gap --replicates 25",),
        files=_files(
            "docs/gap",
            "report.json",
            "obj_fit.png",
            "share.png",
        ),
        golden=(*_RUNS, *_JOINT, "evolve neat", "simulate nuisances", "simulate reactive"),
        cpu_minutes=90,
        smallest="--smoke --replicates 1 --rounds 2 --generations 3 --population 20 --poses 2 "
        "--worlds plain drag",
        needs=("pybullet",),
    ),
    "gap-ten-trials": Result(
        commands=(
            "python -m experiments.reality_gap --replicates 10 --worlds noise-0.01 --rounds 10",
        ),
        files=_files(
            "docs/gap/ten-trials",
            "report.json",
            "progress.png",
        ),
        golden=(*_RUNS, *_JOINT, "evolve neat"),
        cpu_minutes=15,
        smallest="--smoke --replicates 1 --rounds 2 --generations 3 --population 20 --poses 2",
    ),
    "inference": Result(
        commands=("python -m instruments.inference --seed 1 --bodies 0.4",),
        files=_files("docs/inference", "report.json", "times.json", "coverage.png", "ranks.png"),
        golden=(*_JOINT, "infer", "simulate nuisances", "simulate series", "simulate reactive"),
        cpu_minutes=48,
        smallest="--bodies 0.01 --only exact prior",
        needs=("mujoco",),
    ),
    "inference-foreign": Result(
        commands=("python -m instruments.inference --seed 2 --only foreign --bodies 0.4",),
        files={"docs/results/inference/foreign.md": "foreign.md"},
        golden=(*_JOINT, "simulate nuisances"),
        cpu_minutes=40,
        smallest="--bodies 0.01 --only scale-0.01",
        needs=("mujoco", "pybullet"),
    ),
    "inference-strangers": Result(
        commands=(
            "python -m instruments.inference --only solver jitter float32 compass delay alias pair "
            "bound slow second fifteen twentyfive",
        ),
        files={"docs/results/inference/strangers.md": "strangers.md"},
        golden=("infer", "infer dense fins"),
        cpu_minutes=14,
        smallest="--bodies 0.01",
    ),
    "physics": Result(
        commands=("python -m instruments.verification",),
        files=_files(
            "docs/physics",
            "report.json",
            "convergence.png",
            "quadrature.png",
            "real_fish.png",
            "single_precision.png",
            "strokes.png",
        ),
        golden=(*_SWIMS, "simulate pybullet float64", "simulate reactive"),
        cpu_minutes=4,
        smallest="--quick",
        needs=("mujoco", "pybullet"),
    ),
    "performance-gpu": Result(
        commands=("python -m instruments.benchmarks.gpu",),
        files={"docs/results/performance/gpu.md": "table.md"},
        golden=_SWIMS,
        cpu_minutes=10,
        smallest="--robots 1000 --double 1000 --lanes 1000 --mjx 1000",
        needs=(GPU,),
    ),
    **{
        f"performance-{name}": Result(
            commands=(f"python -m instruments.benchmarks --only {groups}",),
            files={f"docs/results/performance/{name}.md": "table.md"},
            golden=_SWIMS,
            cpu_minutes=minutes,
            smallest="--quick",
            needs=needs,
        )
        for name, groups, minutes, needs in (
            ("environments", "environments resets learning", 3, ("mujoco", "stable_baselines3")),
            ("training", "training", 2, ("stable_baselines3",)),
            ("physics", "physics", 2, ("pybullet",)),
            ("faults", "faults", 1, ("torch",)),
            ("starting", "starting", 1, ()),
        )
    },
    "real-fish": _real(
        "fish", "https://github.com/giorgosmamakoukas/dataDrivenControlOfRoboticFish", 3
    ),
    "real-drones": _real("drones", "https://github.com/AerialRoboticsUUST/CrazyPAD", 5),
    "real-auv": _real("auv", "https://github.com/sunyrain/MLTask", 18),
    "scores": Result(
        commands=("python -m experiments.scores",),
        files={
            "docs/results/scores/table.md": "table.md",
            "docs/results/scores/times.md": "times.md",
            **{
                f"experiments/scores/results/{file}": file
                for name in ("CPG", "NEAT", "CMA-ES", "CMA-ES--fins", "PPO--fins")
                for file in (f"runs/forward/{name}/100.json", f"runs/forward/{name}/100.times.json")
            },
        },
        golden=(*_IDS, "evolve cma", "evolve neat", "drawn damage"),
        cpu_minutes=70,
        smallest="--tasks forward --entries CPG NEAT CMA-ES 'CMA-ES, fins' 'PPO, fins' "
        "--replicates 1 --episodes 2 --budget-divisor 1000",
        needs=("stable_baselines3",),
    ),
    "scores-fish": Result(
        commands=(
            "python -m experiments.scores --tasks four-fins tail-fish --entries zero still random "
            "bang-bang 'tail only' CPG NEAT CMA-ES 'CMA-ES, fins' PPO 'PPO, fins'",
        ),
        files=_files("docs/results/fish", "table.md", "times.md"),
        golden=(
            "FourFins-v0 numba",
            "TailFish-v0 numba",
            "evolve cma",
            "evolve neat",
            "drawn damage",
        ),
        cpu_minutes=30,
        smallest="--tasks four-fins --entries CPG CMA-ES --replicates 1 --episodes 2 "
        "--budget-divisor 1000",
        needs=("stable_baselines3",),
    ),
    **{
        f"fish-{condition}": Result(
            commands=(
                f"aquafish study --plan four-fins --held-out --conditions {condition} --steps 256 "
                f"--rounds {rounds} --replicates 10 --gap.gyro-noise 0.01",
            ),
            files={f"docs/results/fish/{condition}.json": "summary.json"},
            golden=("run out-of-band", *_JOINT, "study", "FourFins-v0 numba"),
            cpu_minutes=minutes,
            smallest="--preset smoke --replicates 2 --rounds 2",
        )
        for condition, rounds, minutes in (("joint", 2, 3), ("out-of-band", 20, 4))
    },
    "fish-league": Result(
        commands=(
            "python -m experiments.league --plan four-fins --entrants blind self-model "
            "--tiers severe --episodes 20",
        ),
        files=_files("docs/results/fish", "league.json"),
        golden=(*_LEAGUE_CASES, "FourFins-v0 numba"),
        cpu_minutes=7,
        smallest="--episodes 1",
    ),
    "scores-return": Result(
        commands=(
            "python -m experiments.scores --tasks forward --replicates 1 --controllers "
            "experiments/scores/results",
        ),
        files={"docs/results/scores/return.md": "return.md"},
        golden=("AquaFishReturn-v0 numba", "drawn damage"),
        cpu_minutes=1,
        smallest="--episodes 2",
    ),
    "league": _league(
        "home",
        {
            "table.md": "home/table.md",
            "times.md": "home/times.md",
            "blind.md": "home/blind.md",
            "gain.md": "home/gain.md",
            "recognition.md": "home/recognition.md",
            "league.json": "home/league.json",
            "pace.png": "home/pace.png",
        },
        52,
    ),
    "league-held-out": _league(
        "held-out",
        {"held-out.md": "held-out/table.md", "held-out-recognition.md": "held-out/recognition.md"},
        23,
    ),
    "league-return": _league("return", {"return.md": "return/table.md"}, 175),
    "league-waters": _league(
        "home none current reactive mujoco mujoco-lift vortices dense pybullet",
        {
            f"waters-{tier}.md": f"waters-{tier}.md"
            for tier in ("severe", "moderate", "mild", "none")
        },
        370,
    ),
    "league-imu": _league("imu", {"imu.md": "imu/blind.md"}, 26),
    "league-gyroscope": _league("gyroscope", {"gyroscope.md": "gyroscope/blind.md"}, 26),
    "league-three-faults": _league(
        "three-faults", {"three-faults.md": "three-faults/recognition.md"}, 5
    ),
    "league-early": _league("early", {"early.md": "early/recognition.md"}, 8),
    "league-outside": _league(
        "outside",
        {"outside.md": "outside/recognition.md", "outside-blind.md": "outside/blind.md"},
        71,
        first=140,
    ),
    "league-current-begins": _league(
        "current-begins", {"current-begins.md": "current-begins/recognition.md"}, 3
    ),
    "league-ceiling": replace(
        _league("ceiling-severe ceiling-other", {"ceiling.md": "ceiling.md"}, 110, first=100),
        smallest=None,  # five CPU minutes an episode
    ),
    "league-policies": Result(
        commands=("python -m experiments.league.policies",),
        files={
            "docs/results/league/curves.png": "curves.png",
            **{
                f"experiments/league/data/policies/student-{twin}.json": f"student-{twin}.json"
                for twin in ("0", "1", "2", "any-water")
            },
        },
        golden=("AquaFishRecovery-v0 numba", "drawn damage"),
        cpu_minutes=90,
        needs=("stable_baselines3",),
        kept="the rivals are data, and PyTorch trains others on another processor",
    ),
    "league-thresholds": Result(
        commands=("python -m experiments.league.thresholds",),
        files={"docs/results/league/thresholds-worth.md": "table.md"},
        golden=_LEAGUE_CASES,
        cpu_minutes=90,
        smallest="--names GLITCH_SDS --factors 2",
    ),
}


def golden_digest(text: str, cases: Iterable[str]) -> str | None:
    """Return the digest of some cases of a text of tests/golden.json; None if it lacks one."""
    kept = json.loads(text)
    if any(case not in kept for case in cases):
        return None
    rows = "".join(f"{case} {kept[case]}\n" for case in sorted(cases))
    return _digest(rows.encode())


def files_digest(result: Result) -> str:
    """Return the digest of a result's committed files; a missing one counts as empty."""
    paths = {file: ROOT / file for file in sorted(result.files)}
    contents = {file: path.read_bytes() if path.is_file() else b"" for file, path in paths.items()}
    return _digest("".join(f"{file} {_digest(one)}\n" for file, one in contents.items()).encode())


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]


def read_records() -> dict[str, Record]:
    """Return the records of the committed results by name."""
    return {name: Record(**one) for name, one in json.loads(RECORDS.read_text("utf-8")).items()}


def out_of_date(result: Result, record: Record | None) -> str:
    """Return why a result must be made again, or "" if it is up to date."""
    if record is None:
        return "not made yet"
    if record.commands != list(result.commands):
        return "other command"
    if record.files != files_digest(result):
        return "other files"
    if result.kept:
        return ""
    if record.golden is None:
        return "golden cases unknown"
    if record.golden != golden_digest(GOLDEN.read_text("utf-8"), result.golden):
        return "golden cases changed"
    return ""


def provenance() -> str:
    """Return the table of the committed results, for docs/provenance.md."""
    records = read_records()
    rows = [["result", "command", "commit", "date", "CPU minutes", "since then"]]
    for name, result in RESULTS.items():
        record = records.get(name)
        reason = out_of_date(result, record)
        made = ["", "", ""]
        commands = list(result.commands)
        if record is not None:
            spent = record.cpu_minutes
            minutes = "not measured" if spent is None else f"{spent:.3g}"
            made = [record.commit, record.date, minutes]
            commands = record.commands
        where = f" on {GPU}" if GPU in result.needs else ""
        again = f"to be made again{where}: {reason}" if reason else result.kept or "unchanged"
        first = next(iter(result.files)).removeprefix("docs/")
        link = f"[{name}]({first})" if result.files else name
        rows.append([link, "<br>".join(f"`{one}`" for one in commands), *made, again])
    return markdown_table(rows)


def command_words(command: str, folder: Path) -> list[str]:
    """Return a command line that writes a folder as the words that start it here."""
    program, *words = shlex.split(command.replace("DIR/", f"{shlex.quote(str(folder))}/"))
    python = [sys.executable] if program == "python" else [sys.executable, "-m", program]
    return [*python, *words, "--out", str(folder)]


def present_commit() -> str:
    """Return the commit of the clone; "" if tracked files differ from it, other than the pages."""
    commit = changed = None
    if is_clone(ROOT):  # a copy without .git may lie in another repository
        commit = git(ROOT, "rev-parse", "--short=8", "HEAD")
        # A result that was just made is in the pages already.
        but = (":!docs", ":!*.md")
        changed = git(ROOT, "status", "--porcelain", "--untracked-files=no", "--", ".", *but)
    if commit is None or changed is None:
        raise InvalidArgumentError(f"results need a clone that git can read; {ROOT} is none")
    return "" if changed else commit


@dataclass(frozen=True)
class MakeResults:
    """Make the committed results that are not up to date, and record how."""

    example: ClassVar[str] = "physics --plan"

    names: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="NAME")] = ()
    """Some of the results of docs/provenance.md; all that are not up to date by default."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("out/results")
    """Folder of a folder for each result."""
    plan: bool = False
    """Only say what is missing, and how long it takes."""
    smallest: bool = False
    """Make them very small, to see that their commands work; nothing replaces a committed file."""

    def execute(self) -> None:
        """Make what is missing, and commit-ready copies of it."""
        for name in self.names:
            one_of("names", name, RESULTS)
        if self.plan:
            self._todo()
            return
        # Before anything is read: another run may be about to write it.
        with lock(ensure_writable_directory(self.out)):
            self._make_all(self._todo())

    def _todo(self) -> dict[str, Result]:
        """Return the results to make, and say which they are and how long they take."""
        records = read_records()
        todo = {}
        for name in self.names or RESULTS:
            reason = out_of_date(RESULTS[name], records.get(name))
            lacking = ", ".join(RESULTS[name].missing())
            if self.smallest and RESULTS[name].smallest is None:
                lacking = "its whole size"
            minutes = "" if self.smallest else f", about {RESULTS[name].cpu_minutes:g} CPU minutes"
            if not reason and not self.smallest:
                continue
            if lacking:
                print(f"{name}: left out, for it needs {lacking}")
            else:
                todo[name] = RESULTS[name]
                print(f"{name}: {'smallest size' if self.smallest else reason}{minutes}")
        if not todo:
            print("nothing to do")
        elif not self.smallest:
            total = sum(result.cpu_minutes for result in todo.values())
            print(
                f"{len(todo)} results: about {total / 60:.1f} CPU hours, "
                f"{total / 60 / available_cores():.1f} hours on {available_cores()} cores",
                flush=True,
            )
        return todo

    def _make_all(self, todo: Mapping[str, Result]) -> None:
        """Make results; SystemExit with the code 1 if one failed, or must be committed first."""
        failed = []
        # Inputs of others first: they must be committed before the others are made.
        for name in sorted(todo, key=lambda one: not todo[one].is_input):
            changes_code = todo[name].is_input and not self.smallest and bool(present_commit())
            if not self._make(name, todo[name]):
                failed.append(name)
            elif changes_code and not present_commit():
                print(f"{name} is an input of others: commit it; the same command goes on")
                raise SystemExit(1)
        if failed:
            print(f"failed: {', '.join(failed)}; the same command resumes", file=sys.stderr)
            raise SystemExit(1)

    def _make(self, name: str, result: Result) -> bool:
        """Make a result and replace the committed files. Return whether it went well.

        Raises KeyboardInterrupt if it was interrupted.
        """
        base = self.out / ("smallest" if self.smallest else ".") / (result.folder or name)
        folder = ensure_writable_directory(base / "run").resolve()
        # A result may be an input of the next: that must be committed first.
        commit = "" if self.smallest else present_commit()
        golden = golden_digest(GOLDEN.read_text("utf-8"), result.golden)
        # CPU seconds of all tries of these commands with these golden cases
        made_of = _digest(repr((result.commands, golden)).encode())[:8]
        spent = base / f"{name}-{made_of}.cpu"
        for command in result.commands:
            whole = f"{command} {(result.smallest or '') if self.smallest else ''}".strip()
            print(f"\n{name}: {whole}", flush=True)
            before = _children_seconds()
            try:
                code = _run(command_words(whole, folder))
            finally:
                so_far = float(spent.read_text()) if spent.exists() else 0.0
                write_bytes(spent, f"{so_far + _children_seconds() - before:.1f}\n".encode())
            if code == REFUSED:
                print(f"{name}: if it is of an older version, remove {base}", file=sys.stderr)
            if code:
                return False
        lacking = [file for file in result.files.values() if not (folder / file).is_file()]
        if lacking:
            print(f"{name}: {folder} lacks {', '.join(lacking)}", file=sys.stderr)
            return False
        if not self.smallest and not (commit and present_commit() == commit):
            why = "changed in the meantime" if commit else "has uncommitted changes"
            print(f"{name}: stays in {folder}, for the tree {why}")
        elif not self.smallest:
            for target, file in result.files.items():
                write_bytes(ROOT / target, (folder / file).read_bytes())
            date = f"{datetime.now(UTC):%Y-%m-%d}"
            minutes = round(float(spent.read_text()) / 60, 1)
            files = files_digest(result)
            write_record(name, Record(list(result.commands), commit, date, minutes, golden, files))
        return True


def write_record(name: str, record: Record) -> None:
    """Write a result's record, and fill the pages that show its tables."""
    records = read_records() | {name: record}
    whole = {one: asdict(records[one]) for one in RESULTS if one in records}
    write_bytes(RECORDS, (json.dumps(whole, indent=1) + "\n").encode())
    fill_pages()


def fill_pages() -> None:
    """Write the tables of the committed results, and that of the records, into the pages."""
    subprocess.run([sys.executable, "-m", "experiments.pages"], cwd=ROOT, check=True)


def _run(words: list[str]) -> int:
    """Run a command from the clone and return its exit code; interrupt it as this process is."""
    paths = (str(ROOT), os.environ.get("PYTHONPATH"))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}
    with subprocess.Popen(words, cwd=ROOT, env=environment) as process:
        try:
            return process.wait()
        except KeyboardInterrupt:
            process.terminate()
            process.wait()
            raise


def _children_seconds() -> float:
    """Return the CPU seconds of the processes that this one has started; 0 on Windows."""
    used = os.times()
    return used.children_user + used.children_system


if __name__ == "__main__":
    sys.exit(run_command_line("experiments.results", MakeResults))
