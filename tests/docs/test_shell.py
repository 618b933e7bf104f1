"""The shell blocks of README, tutorial and how-tos can be pasted in the order of the pages."""

from __future__ import annotations

import pathlib
import re
import runpy
import shlex
import shutil
import subprocess
import sys

import pytest

from aquafish.cli import main
from tests.in_process import jobs_in_process

ROOT = pathlib.Path(__file__).parents[2]
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
    "aquafish export own.json": "needs a NEAT run; tests/docs/test_neat_page.py",
    "cc -std=c99 -Down_TEST": "needs a NEAT run; tests/docs/test_neat_page.py",
    "python examples/minari_dataset.py": "tests/envs/test_trainers.py",
}
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
        for line in ALL[page]:
            if not line.startswith(tuple(NOT_RUN)):
                assert run(line) == 0, f"{page}: {line}\n{capfd.readouterr().err}"
    written = {path.name for path in tmp_path.iterdir()}
    assert written == {"examples", "out"}, "pages write into out/"


def test_what_is_not_run_or_shorter_is_on_a_page() -> None:
    everything = [line for lines in ALL.values() for line in lines]
    for begin in (*NOT_RUN, *SHORTER):
        assert any(line.startswith(begin) for line in everything), begin
