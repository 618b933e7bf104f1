"""Jobs of the runner's tests; spawned processes import this by name."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

# A command as there will be many: it goes on with what is in its folder.
COMMAND = """
from pathlib import Path
from run_jobs_here import Task, work
from aquafish_gym.runs.executors import workers
from aquafish_gym.runs.folder import held
from aquafish_gym.runs.runner import run_jobs

if __name__ == "__main__":
    folder, action, count = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
    jobs = [Task(number, action) for number in range(count)]
    try:
        with held(folder), workers(2) as executor:
            print("held", flush=True)
            told = lambda event: print(event.kind, event.job.name, event.text, flush=True)
            failures = run_jobs(jobs, work, folder, executor, told)
    except KeyboardInterrupt:
        sys.exit(130)
    except (OSError, ValueError) as error:
        print(error, file=sys.stderr)
        sys.exit(2)
    sys.exit(len(failures))
"""


@dataclass(frozen=True)
class Task:
    """What to do, and a file outside the results to remember by how often it was begun."""

    number: int
    action: str = "count"
    memory: str = ""

    @property
    def name(self):
        return f"{self.action} {self.number}"

    @property
    def file(self):
        return f"runs/{self.action}/{self.number}.json"


def work(task, say):
    """Return the same for the same number, whatever happened before."""
    times = 1
    if task.memory:
        with Path(task.memory).open("a") as file:
            file.write(f"{os.getpid()}\n")
        times = len(Path(task.memory).read_text().splitlines())
    say(f"{task.action} begins", 0.5)
    if task.action == "die" or (task.action == "die once" and times == 1):
        os.kill(os.getpid(), signal.SIGKILL)
    if task.action == "stop once" and times == 1:
        os.kill(os.getpid(), signal.SIGSTOP)
    if task.action == "leave":
        os._exit(7)
    if task.action == "err":
        raise ValueError("no such\nluck")
    if task.action == "eof":
        raise EOFError("the log ends early")
    if task.action == "nan":
        return {"value": float("nan")}
    if task.action == "object":
        return {"value": object()}
    if task.action == "sleep":
        time.sleep(600)
    if task.action in ("doze", "short sleep"):
        time.sleep(2.0 if task.action == "doze" else 0.1)
    rng = np.random.default_rng(task.number)
    return {"number": task.number, "values": rng.random((3, 4)), "best": np.float64(rng.random())}
