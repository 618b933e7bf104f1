"""One mutant, judged by its tests in a copy of the repository and in a process of its own."""

from __future__ import annotations

import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from instruments.mutants.targets import Mutant, tracked_files

KILLED = "killed"
SURVIVED = "survived"
OUT_OF_TIME = "out of time"
# Wall-clock seconds for each second of processor time: others use the machine, too.
PATIENCE = 20.0
_FAILED = re.compile(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", re.MULTILINE)


@dataclass(frozen=True)
class Trial:
    """How mutants are judged.

    Attributes
    ----------
    root
        The clone whose tracked files are copied.
    kernels
        Folder of compiled kernels, which all mutants share: the key of a kernel is a hash of its
        sources.
    cpu_seconds
        Processor time that a mutant's tests have.
    """

    root: Path
    kernels: Path
    cpu_seconds: int

    def __call__(self, mutant: Mutant) -> dict[str, Any]:
        """Return the verdict, the first test that failed and the CPU seconds.

        Raises
        ------
        RuntimeError
            If the source as it is fails, or pytest finds no tests.
        """
        with tempfile.TemporaryDirectory(prefix="mutant-") as folder:
            tree = Path(folder)
            for name in tracked_files(self.root):
                (tree / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(self.root / name, tree / name)
            if mutant.edit is not None:
                file = tree / mutant.path
                file.write_text(mutant.edit.apply(file.read_text("utf-8")), "utf-8")
            return self._judge(mutant, tree)

    def _judge(self, mutant: Mutant, tree: Path) -> dict[str, Any]:
        words = ["-x", "-q", "-m", "not slow", "-p", "no:cacheprovider", "-p", "pytest_timeout"]
        words += ["--doctest-modules", *mutant.tests]
        environment = os.environ | {
            "PYTHONPATH": str(tree),
            "NUMBA_CACHE_DIR": str(self.kernels),
            "OPENBLAS_NUM_THREADS": "1",
            "OMP_NUM_THREADS": "1",
            "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",  # the tests need no plugin to run one by one
        }
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        began = time.monotonic()
        process = subprocess.Popen(
            [sys.executable, "-m", "pytest", *words],
            cwd=tree,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,
            preexec_fn=self._limit,
        )
        try:
            output, _ = process.communicate(timeout=PATIENCE * self.cpu_seconds)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            output, _ = process.communicate()
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        verdict = self._verdict(process.returncode, output)
        if mutant.edit is None and verdict != SURVIVED:
            raise RuntimeError(f"the tests fail without a mutant: {output[-2000:]}")
        failed = _FAILED.search(output)
        return {
            "verdict": verdict,
            "test": failed[1] if failed else None,
            "seconds": {"cpu": round(cpu, 1), "wall": round(time.monotonic() - began, 1)},
        }

    def _limit(self) -> None:
        """Let the kernel end the tests after their processor time."""
        resource.setrlimit(resource.RLIMIT_CPU, (self.cpu_seconds, self.cpu_seconds + 5))

    @staticmethod
    def _verdict(code: int, output: str) -> str:
        """Return what pytest's exit code says of a mutant."""
        if code == 0:
            return SURVIVED
        if code in (-signal.SIGKILL, -signal.SIGXCPU):
            return OUT_OF_TIME
        if code in (4, 5) and "ImportError" not in output:
            raise RuntimeError(f"pytest runs no tests: {output[-2000:]}")
        return KILLED
