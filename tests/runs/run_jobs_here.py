"""Jobs of the runner's tests; spawned processes import this by name."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np


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
    if task.action == "short sleep":
        time.sleep(0.1)
    rng = np.random.default_rng(task.number)
    return {"number": task.number, "values": rng.random((3, 4)), "best": np.float64(rng.random())}
