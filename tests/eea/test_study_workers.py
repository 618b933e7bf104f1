"""Processes that die: their jobs are begun again, and none outlives its parent."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from aquafish_gym.runs.workers import do_jobs, wait_for_orphans


def work(job):
    """Do what a job's name says; the second part is a file to remember by."""
    action, _, path = job.partition(":")
    memory = Path(path)
    if path:
        with memory.open("a") as file:
            file.write(f"{os.getpid()}\n")
    yield f"{action} begins"
    times = len(memory.read_text().splitlines()) if path else 0
    if action == "die" or (action == "die once" and times == 1):
        os.kill(os.getpid(), signal.SIGKILL)
    if action == "err":
        raise ValueError("no such luck")
    if action == "sleep":
        time.sleep(600)
    yield os.environ["OMP_NUM_THREADS"]


@pytest.fixture(autouse=True)
def _in_time():
    """Fail rather than hang."""
    before = signal.signal(signal.SIGALRM, lambda *_: pytest.fail("it hangs"))
    signal.alarm(120)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def test_jobs_are_done_whoever_dies(tmp_path):
    jobs = ["a", f"die once:{tmp_path / 'once'}", "b", "err", f"die:{tmp_path / 'die'}", "c"]
    environment = dict(os.environ)
    events = list(do_jobs(jobs, work, 2, tmp_path / "guard"))
    ends = {e.job: e for e in events if e.kind in ("done", "failed")}
    assert [ends[job].kind for job in jobs] == ["done", "done", "done", "failed", "failed", "done"]
    assert len([e for e in events if e.kind in ("done", "failed")]) == len(jobs)
    assert ends["err"].content.startswith("ValueError: no such luck (test_study_workers.py, line ")
    assert ends[jobs[4]].content == "its process was killed by SIGKILL, 3 times"
    died = [(e.job, e.content) for e in events if e.kind == "died"]
    killed = "its process was killed by SIGKILL"
    assert sorted(died) == sorted([(jobs[1], killed), (jobs[4], killed), (jobs[4], killed)])
    assert [e.content for e in events if e.job == "a"] == [None, "a begins", "1", None]
    assert len({*(tmp_path / "die").read_text().splitlines()}) == 3
    assert os.environ == environment
    assert wait_for_orphans(tmp_path / "guard")


def test_leaving_stops_the_workers(tmp_path):
    events = do_jobs([f"sleep:{tmp_path / 'pid'}"], work, 1, tmp_path / "guard")
    for event in events:
        if event.kind == "said":
            break
    worker = int((tmp_path / "pid").read_text())
    assert _alive(worker)
    events.close()
    assert not _alive(worker)


def test_workers_end_when_their_parent_is_killed(tmp_path):
    code = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "from pathlib import Path\n"
        "from test_study_workers import work\n"
        "from aquafish_gym.runs.workers import do_jobs\n"
        "if __name__ == '__main__':\n"
        "    jobs = [f'sleep:{sys.argv[2]}/{i}' for i in range(2)]\n"
        "    for event in do_jobs(jobs, work, 2, Path(sys.argv[2], 'guard')):\n"
        "        print(event.kind, flush=True)\n"
    )
    script = tmp_path / "parent.py"
    script.write_text(code)
    parent = subprocess.Popen(
        [sys.executable, str(script), str(Path(__file__).parent), str(tmp_path)],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        said = []
        while said.count("said\n") < 2:
            said.append(parent.stdout.readline())
            assert said[-1], "the parent ended"
    finally:
        parent.kill()
    parent.communicate()
    workers = [int((tmp_path / str(i)).read_text()) for i in range(2)]
    assert wait_for_orphans(tmp_path / "guard")  # they let go of it when they end
    deadline = time.monotonic() + 30
    while any(_alive(worker) for worker in workers):
        assert time.monotonic() < deadline, "orphans live on"
        time.sleep(0.05)


def _alive(process):
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False
