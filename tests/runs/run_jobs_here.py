"""Jobs of the tests; worker processes import this by name."""

from __future__ import annotations

import os
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aquafish_gym.runs.jobs import run_jobs
from aquafish_gym.runs.manifest import lock


@dataclass(frozen=True)
class Task:
    """What to do, and a file outside the results that counts its starts."""

    number: int
    action: str = "count"
    memory: str = ""

    @property
    def name(self):
        return f"{self.action} {self.number}"

    @property
    def file(self):
        return f"runs/{self.action}/{self.number}.json"


def work(task):
    """Return the same for the same number, whatever happened before."""
    times = 1
    if task.memory:
        with Path(task.memory).open("a") as file:
            file.write(f"{os.getpid()}\n")
        times = len(Path(task.memory).read_text().splitlines())
    match task.action:
        case "die":
            os.kill(os.getpid(), signal.SIGKILL)
        case "die once":
            if times == 1:
                os._exit(7)
        case "stop once":
            if times == 1:
                os.kill(os.getpid(), signal.SIGSTOP)
        case "stop":
            os.kill(os.getpid(), signal.SIGSTOP)
        case "err":
            raise ValueError("no such\nluck")
        case "nan":
            return {"value": float("nan")}
        case "sleep":
            time.sleep(600)
        case "sleep five":
            time.sleep(5)
        case "doze":
            time.sleep(0.3)
    rng = np.random.default_rng(task.number)
    return {"number": task.number, "values": rng.random((3, 4)), "best": np.float64(rng.random())}


if __name__ == "__main__":  # a command that resumes: FOLDER ACTION COUNT
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    folder, action, count = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
    try:
        with lock(folder):
            print("locked", flush=True)
            tasks = [Task(number, action, str(folder / "begun")) for number in range(count)]
            sys.exit(len(run_jobs(tasks, work, folder, count=2)))
    except KeyboardInterrupt as stop:
        sys.exit(str(stop))
    except ValueError as error:
        sys.exit(str(error))
