"""Install trainers, each in an environment of its own, and run their blocks of the page."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from aquafish_gym.runs.command_line import run_command_line
from aquafish_gym.utils.validation import one_of
from tests.trainers.page import PAGE, ROOT, Trainer, read_trainers, score, shown_line

INSTALL_TIMEOUT_SECONDS = 1800
RUN_TIMEOUT_SECONDS = 600


class TrainerError(RuntimeError):
    """What could not be installed, ended with an error or printed no score."""


def call(command: Sequence[str], where: Path, seconds: float) -> str:
    """Return what a command prints; TrainerError with its last lines if it fails."""
    # What the caller's environment adds to modules would hide what is installed here.
    clean = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    try:
        done = subprocess.run(
            command, cwd=where, env=clean, capture_output=True, text=True, timeout=seconds
        )
    except subprocess.TimeoutExpired:
        raise TrainerError(f"no end after {seconds:g} s: {shlex.join(command)}") from None
    if done.returncode:
        last = "\n".join((done.stdout + done.stderr).splitlines()[-20:])
        raise TrainerError(f"status {done.returncode}: {shlex.join(command)}\n{last}")
    return done.stdout


def install(trainer: Trainer, venv: Path) -> Path:
    """Return the interpreter of a new environment that has the trainer and this checkout."""
    torch = venv / ".installed-torch"  # the Makefile's target: PyTorch for CPUs, and nothing else
    make = ["make", "--silent", f"PYTHON={sys.executable}", f"VENV={venv}", str(torch)]
    call(make, ROOT, INSTALL_TIMEOUT_SECONDS)
    python = venv / "bin" / "python"
    pip = [str(python), "-m", "pip", "install", "-qq", "--no-compile"]
    call([*pip, *shlex.split(trainer.requirements)], ROOT, INSTALL_TIMEOUT_SECONDS)
    return python


def run_block(trainer: Trainer, python: Path, where: Path, shown: str) -> str:
    """Return the score that a trainer's block prints in the folder ``where``."""
    (where / "docs").symlink_to(ROOT / "docs")
    (where / "block.py").write_text(trainer.code, encoding="utf-8")
    printed = call([str(python), "block.py"], where, RUN_TIMEOUT_SECONDS)
    found = score(printed, shown)
    if found is None:
        raise TrainerError(f"no line like {shown!r} in:\n{printed[-2000:]}")
    return found


@dataclass(frozen=True)
class Trainers:
    """Install trainers as docs/howto/trainers.md says and run their blocks.

    Each has an environment of its own, of about 2 GB, which is removed before the next.
    """

    names: tyro.conf.Positional[Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME ...")]] = ()
    """Headings of the page, such as skrl, tianshou and rllib; all if there is none."""

    def execute(self) -> None:
        """Run the blocks and print the scores; exit with status 1 if one failed."""
        page = PAGE.read_text(encoding="utf-8")
        known = read_trainers(page)
        chosen = [one_of("NAME", name.lower(), known) for name in self.names] or list(known)
        failed = []
        for name in dict.fromkeys(chosen):
            trainer = known[name]
            print(f"{trainer.name}: installing {trainer.requirements} ...", flush=True)
            with tempfile.TemporaryDirectory() as place:
                where = Path(place) / "run"
                where.mkdir()
                try:
                    python = install(trainer, Path(place) / "venv")
                    found = run_block(trainer, python, where, shown_line(page))
                except TrainerError as error:
                    failed.append(name)
                    print(f"{trainer.name}: failed, {error}", flush=True)
                else:
                    print(f"{trainer.name}: {found}", flush=True)
        if failed:
            print(f"failed: {', '.join(failed)}", file=sys.stderr)
            raise SystemExit(1)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return its exit code."""
    return run_command_line("tests.trainers", Trainers, arguments)


if __name__ == "__main__":
    sys.exit(main())
