"""Commands on the pages exist, with their options, and run as they are pasted."""

from __future__ import annotations

import pathlib
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from functools import partial
from itertools import pairwise

import pytest
from test_snippets import PAGES as WITH_CODE
from test_snippets import ROOT, outputs

import aquafish.cli
import eea.__main__
import gait.__main__
import instruments.__main__
from aquafish.cli import main
from aquafish_gym.runs.command_line import run_command_line
from experiments.gaits.ceiling import Ceiling
from experiments.league.thresholds import Thresholds
from experiments.league.whole import WholeLeague
from experiments.reality_gap.command import Gap
from experiments.results import RESULTS
from experiments.scores.command import Scores
from gait import Controller
from tests.in_process import jobs_in_process

BLOCK = re.compile(r"^```sh\n(.*?)^```$", re.MULTILINE | re.DOTALL)
INDEX = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
HOW_TOS = re.findall(r"^howto/(?!index)\w+$", INDEX, re.MULTILINE)
PAGES = ["README.md", "docs/tutorial.md", *(f"docs/{name}.md" for name in HOW_TOS)]
#: Commands that are not run, by how they begin, and why.
NOT_RUN = {
    "make": "the case study and these tests",
    "pip install": "installs",
    "aquafish view": "serves until Ctrl-C; tests/aquafish/test_viewer.py",
    "dask": "needs other computers; tests/runs/test_jobs.py",
    "aquafish recover": "minutes; tests/aquafish/test_recovery.py",
    "aquafish study --figure all": "hours, on the computers above",
    "python -m rl_zoo3.train": "tests/envs/test_trainers.py",
    "python -m tests.trainers": "installs gigabytes; tests/envs/test_trainers_page.py",
    "aquafish export policy.zip": "needs a policy; tests/gait/test_export_policy.py",
    "cc -std=c99 -Dpolicy_TEST": "needs a policy; tests/gait/test_export_policy.py",
    "aquafish export own.json": "needs a NEAT run; below",
    "cc -std=c99 -Down_TEST": "needs a NEAT run; below",
    "python examples/minari_dataset.py": "tests/envs/test_trainers.py",
    "python examples/evolving_plans.py": "minutes; tests/gait/test_other_bodies_swim.py",
}
#: Files that the Python of a page writes and its commands read.
PYTHON_WRITES = {"docs/howto/body.md": "minnow.json"}
TINY = "--generations 1 --random-candidates 6 --restarts 1 --poses 2"
#: What makes commands shorter, by how they begin.
SHORTER = {
    "aquafish run": "--rounds 1 --target-engine numba",
    "aquafish evolve": TINY,
    "aquafish baseline": "--steps 1600 --environments 16",
    "aquafish film": "--seconds 1 --engine numba",
    "aquafish transfer": "--poses 2 --seconds 2 --target-engine numba",
    "aquafish study": "--replicates 1 --rounds 1 --workers 1 --steps 32",
}


def commands(page: str) -> list[str]:
    """Return the commands of a page's shell blocks."""
    blocks = "".join(BLOCK.findall((ROOT / page).read_text(encoding="utf-8")))
    lines = (
        re.sub(r"(^|\s)#.*", "", line).strip() for line in blocks.replace("\\\n", "").split("\n")
    )
    return [line for line in lines if line]


ALL = {page: commands(page) for page in PAGES}


def run(line: str) -> int:
    """Run a command as a shell would, the packages' own within this process."""
    line = " ".join([line, *(more for begin, more in SHORTER.items() if line.startswith(begin))])
    program, *words = shlex.split(line)
    if program == "aquafish":
        return main(words)
    if program == "python" and words[0].startswith("examples/"):
        sys.argv[:] = words
        with pytest.raises(SystemExit) as ended:
            runpy.run_path(words[0], run_name="__main__")
        return int(ended.value.code or 0)
    return subprocess.run(line, shell=True, check=False).returncode


@pytest.mark.parametrize(
    "pages", [pytest.param(PAGES, marks=pytest.mark.slow), PAGES[:1]], ids=["all", "README"]
)
@jobs_in_process()
def test_pages_can_be_pasted_one_after_another(
    pages: list[str],
    tmp_path: pathlib.Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", list(sys.argv))
    for page in pages:
        if page in PYTHON_WRITES:
            list(outputs(page, {}, capfd))
        for line in ALL[page]:
            if not line.startswith(tuple(NOT_RUN)):
                assert run(line) == 0, f"{page}: {line}\n{capfd.readouterr().err}"
    written = {path.name for path in tmp_path.iterdir()}
    others = {PYTHON_WRITES[page] for page in pages if page in PYTHON_WRITES}
    assert written == {"examples", "out"} | others, "commands of pages write into out/"


def test_what_is_not_run_or_shorter_is_on_a_page() -> None:
    everything = [line for lines in ALL.values() for line in lines]
    for begin in (*NOT_RUN, *SHORTER):
        assert any(line.startswith(begin) for line in everything), begin


PAGE = "docs/howto/gait.md"


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler, cc")
@pytest.mark.parametrize("feed_forward", [True, False])
def test_a_neat_run_of_ones_own_ends_in_c(
    feed_forward: bool,
    tmp_path: pathlib.Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    folder = tmp_path / "docs" / "howto"
    folder.mkdir(parents=True)
    settings = (ROOT / "docs" / "howto" / "neat.ini").read_text()
    line = "feed_forward                      = True"
    assert line in settings
    (folder / "neat.ini").write_text(
        settings.replace(line, line.replace("True", str(feed_forward)))
    )
    monkeypatch.chdir(tmp_path)
    body, *_, run_of_ones_own = (code for code, _ in WITH_CODE[PAGE])
    assert "run(evaluate, 100)" in run_of_ones_own
    names: dict[str, object] = {}
    exec(body.partition("gait = ")[0] + "from gait import random_poses", names)
    exec(run_of_ones_own.replace("run(evaluate, 100)", "run(evaluate, 3)"), names)
    found = Controller.load("own.json")
    assert (found.layers is None) is feed_forward
    assert found.connections
    capfd.readouterr()
    for line in commands(PAGE)[-2:]:
        assert run(line) == 0, capfd.readouterr().err
    assert "1000 steps, 0 numbers differ, by at most 0" in capfd.readouterr().out


# Programs of one command, without a name.
FOLDERS = {"--out", "--data"}
EXPERIMENTS = {
    "python -m experiments.gaits": Ceiling,
    "python -m experiments.league.thresholds": Thresholds,
    "python -m experiments.league.whole": WholeLeague,
    "python -m experiments.reality_gap": Gap,
    "python -m experiments.scores": Scores,
}
PROGRAMS = {
    "aquafish": (
        aquafish.cli.main,
        {"recover", "view", "page", *eea.__main__.COMMANDS, *gait.__main__.COMMANDS},
    ),
    "python -m eea": (eea.__main__.main, eea.__main__.COMMANDS),
    "python -m gait": (gait.__main__.main, gait.__main__.COMMANDS),
    "python -m instruments": (instruments.__main__.main, instruments.__main__.COMMANDS),
    **{
        program: (partial(run_command_line, program, command), {""})
        for program, command in EXPERIMENTS.items()
    },
}


def written(text: str) -> list[tuple[str, str, list[str]]]:
    """Return the commands of a page's shell blocks: the program, the command, its options."""
    found = []
    for line in "".join(BLOCK.findall(text)).replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        for program in PROGRAMS:
            beginning = program.split()
            if words[: len(beginning)] == beginning:
                rest = words[len(beginning) :]
                name = "" if program in EXPERIMENTS else rest.pop(0)
                options = [word for word in rest if word.startswith("--")]
                found.append((program, name, options))
    return found


WRITTEN = {page: written((ROOT / page).read_text(encoding="utf-8")) for page in WITH_CODE}


def test_pages_name_commands_and_options_that_exist(capsys: pytest.CaptureFixture[str]) -> None:
    described: dict[tuple[str, str], str] = {}
    for page, commands in WRITTEN.items():
        for program, name, options in commands:
            main, known = PROGRAMS[program]
            assert name in known, page
            if (program, name) not in described:
                assert main([*filter(None, [name]), "-H"]) == 0
                described[program, name] = capsys.readouterr().out
            said = described[program, name]
            for option in options:
                assert re.search(rf"{option}\b", said), f"{page}: {program} {name} has no {option}"
    assert {"recover", "study", "evolve", "transfer", "infer"} <= {name for _, name in described}
    assert set(EXPERIMENTS) <= {program for program, _ in described}


#: Programs of committed results, as pages show them.
MADE = re.compile(r"`((?:python -m (?:experiments|instruments)|aquafish recover --held-out)[^`]*)`")
#: What makes a part of a result, or other than a result.
OTHERS = {
    "aquafish recover --held-out --seed 0",
    "python -m experiments.NAME",
    "python -m experiments.gaits.library",
    "python -m experiments.gaits.library --plan minnow.json",
    "python -m experiments.league.whole --scheduler tcp://HOST:8786",
    "python -m experiments.league.whole --tables NAME",
    "python -m experiments.scores --tasks forward --entries 'PPO, fins' 'CMA-ES, fins'",
    "python -m instruments.benchmarks",
    "python -m instruments.inference",
    "python -m instruments.inference.discrepancy --seed 1",
    "python -m instruments.verification --only reactive",
    "python -m instruments.verification --only real_fish",
    "python -m instruments.verification --plan minnow.json",
}


def made(text: str) -> set[str]:
    """Return the commands in a text that make results, without folders."""
    lines = "".join(BLOCK.findall(text)).replace("\\\n", " ").splitlines()
    lines += MADE.findall(" ".join(BLOCK.sub("", text).split()))
    found = (shlex.split(line, comments=True) for line in lines if MADE.match(f"`{line}`"))
    return {without_folders(words) for words in found}


def without_folders(words: list[str]) -> str:
    """Return a command line without --out, --data and their folders."""
    kept = [w for before, w in pairwise(["", *words]) if {before, w}.isdisjoint(FOLDERS)]
    return shlex.join(kept)


def test_a_page_makes_a_result_by_the_command_of_its_record() -> None:
    """That is the one of ``make results``, which docs/provenance.md has."""
    recorded = {without_folders(shlex.split(c)) for one in RESULTS.values() for c in one.commands}
    shown = set()
    for page in (*WITH_CODE, "paper/paper.md"):
        if page != "docs/provenance.md":
            shown |= made((ROOT / page).read_text(encoding="utf-8"))
    assert shown - recorded == OTHERS
