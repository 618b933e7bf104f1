"""Processes that die or stand still take only their own call along; a dask cluster likewise."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import pytest
from run_jobs_here import Task, work

from aquafish_gym.runs.executors import interrupts, workers
from aquafish_gym.runs.processes import ProcessExecutor, WorkerDiedError
from aquafish_gym.runs.runner import run_jobs
from aquafish_gym.utils.validation import InvalidArgumentError

HERE = Path(__file__).parent
JOBS = [Task(number, "short sleep") for number in range(12)]


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.rglob("*.json")}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("undisturbed")
    with ThreadPoolExecutor(len(JOBS)) as executor:
        assert run_jobs(JOBS, work, folder, executor) == []
    return contents(folder)


def test_a_dead_process_takes_only_its_own_call_along():
    with ProcessExecutor(2) as executor:
        futures = [executor.submit(abs, -3), executor.submit(os._exit, 4), executor.submit(abs, -5)]
        assert futures[0].result() == 3
        assert futures[2].result() == 5
        with pytest.raises(WorkerDiedError, match="its process ended with code 4"):
            futures[1].result()
        assert executor.submit(abs, -7).result() == 7


def test_what_a_call_raises_is_raised_here():
    with ProcessExecutor(1) as executor:
        with pytest.raises(ValueError, match=r"math domain error|nonnegative"):
            executor.submit(__import__("math").sqrt, -1).result()
        with pytest.raises(SystemExit):
            executor.submit(sys.exit, 3).result()
        with pytest.raises(RuntimeError, match="pickle"):  # what comes back cannot travel
            executor.submit(open, os.devnull).result()
        with pytest.raises(Exception, match=r"pickle|local object"):
            executor.submit(lambda: 1).result()
        assert executor.submit(os.getenv, "OMP_NUM_THREADS").result() == "1"
    with pytest.raises(RuntimeError, match="shut down"):
        executor.submit(abs, 1)


def test_a_first_call_has_one_process():
    """So one call, that is waited for, compiles once for all."""
    with workers(8) as executor:
        pids = {executor.submit(os.getpid).result()}
        assert len(executor._workers) == 1
        pids |= {f.result() for f in [executor.submit(os.getpid) for _ in range(3)]}
        assert len(executor._workers) <= 4


def test_a_stopped_process_is_killed_and_its_job_begun_elsewhere(tmp_path, undisturbed):
    stopping = Task(99, "stop once", str(tmp_path / "memory"))
    events = []
    with ProcessExecutor(2, silence=2) as executor:
        assert run_jobs([stopping, *JOBS], work, tmp_path, executor, events.append) == []
    told = [event.text for event in events if event.kind == "retried"]
    assert told == ["its process stood still and was killed"]
    assert contents(tmp_path).keys() == undisturbed.keys() | {"99.json"}


def test_processes_may_be_idle_or_die_then():
    with ProcessExecutor(1, silence=1) as executor:
        first = executor.submit(os.getpid).result()
        time.sleep(3)
        assert executor.submit(os.getpid).result() == first
        os.kill(first, signal.SIGKILL)
        time.sleep(0.2)
        assert executor.submit(os.getpid).result() != first


def test_processes_that_are_busy_or_asleep_are_left_alone():
    """One holds the interpreter, so that it cannot beat; another uses no time."""
    with ProcessExecutor(2, silence=2) as executor:
        busy = executor.submit(pow, 3, 2_500_000)  # one C call, seconds long
        asleep = executor.submit(time.sleep, 4)
        assert busy.result().bit_length() > 3_900_000
        assert asleep.result() is None


def test_killing_an_executor_ends_its_calls_at_once():
    executor = ProcessExecutor(2)
    futures = [executor.submit(time.sleep, 600) for _ in range(4)]
    while not all(future.running() for future in futures[:2]):
        time.sleep(0.05)
    executor.kill()
    for future in futures[:2]:
        with pytest.raises(WorkerDiedError):
            future.result()
    assert all(future.cancelled() for future in futures[2:])


@pytest.mark.parametrize("count", [0, -1, True, 1.5, 10**400])
def test_a_count_of_workers_that_cannot_be_is_refused(count):
    with (
        pytest.raises(InvalidArgumentError, match="workers must be a whole number"),
        workers(count),
    ):
        pass


def test_sigterm_is_an_interruption_meanwhile():
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt), interrupts():
        signal.raise_signal(signal.SIGTERM)
    assert signal.getsignal(signal.SIGTERM) is before


@contextmanager
def cluster(folder, failures=3):
    """Run a dask scheduler and two workers, so many of which a job may kill; give its address."""
    pytest.importorskip("distributed")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(HERE), *sys.path]),
        "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": str(failures),
    }

    def run(program, *arguments):
        return subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.dask_{program}", *arguments],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=environment,
        )

    port = address.rpartition(":")[2]
    hosts = ("--host", "127.0.0.1", "--port", port, "--no-dashboard")
    programs = [run("scheduler", *hosts)]
    options = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", str(folder))
    programs += [run("worker", address, *options) for _ in range(2)]
    try:
        while not _answers(int(port)):
            time.sleep(0.1)
        yield address, programs[1:]
    finally:
        for program in programs:
            program.kill()
            program.wait()


def _answers(port):
    with socket.socket() as one:
        return one.connect_ex(("127.0.0.1", port)) == 0


def test_a_cluster_does_the_same_jobs_though_a_worker_is_killed(
    tmp_path, tmp_path_factory, undisturbed
):
    out = tmp_path / "out"
    out.mkdir()
    with cluster(tmp_path_factory.mktemp("dask")) as (address, hands):
        done = []

        def kill_one(event):
            done.append(event)
            if len(done) == 4:
                hands[0].kill()

        with workers(scheduler=address) as executor:
            failing = Task(0, "err")
            failures = run_jobs([*JOBS, failing], work, out, executor, kill_one)
    assert len(failures) == 1
    assert failures[0].startswith("err 0: ValueError: no such luck (run_jobs_here.py")
    assert contents(out) == undisturbed


@pytest.mark.slow
def test_a_job_that_kills_the_workers_of_a_cluster_is_named(tmp_path):
    with cluster(tmp_path, 0) as (address, _), workers(scheduler=address) as executor:
        failures = run_jobs([Task(0, "leave")], work, tmp_path, executor)
        assert run_jobs([Task(1)], work, tmp_path, executor) == []  # there is another worker
    assert len(failures) == 1
    assert failures[0].startswith("leave 0: KilledWorker: Attempted to run task")
    assert failures[0].endswith("all those workers died while running it")


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nonsense", "foo://bar:1"])
def test_a_scheduler_that_does_not_answer_is_one_sentence(address, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("aquafish_gym.runs.executors._PATIENCE", 0.5)
    with (
        pytest.raises(InvalidArgumentError, match=r"scheduler must be .* nobody answers"),
        workers(scheduler=address),
    ):
        pass


def test_a_cluster_without_dask_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ImportError, match='the extra "cluster"'), workers(scheduler="tcp://a:1"):
        pass
