"""Whatever stops the jobs and wherever they run, the folder ends with the same bytes."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import numpy as np
import pytest
from run_jobs_here import Task, work

from aquafish_gym.runs import cluster
from aquafish_gym.runs import workers as pools
from aquafish_gym.runs.jobs import finished, read_result, run_jobs
from aquafish_gym.runs.manifest import versions
from aquafish_gym.runs.workers import workers
from aquafish_gym.utils.storage import DamagedFileError
from aquafish_gym.utils.validation import InvalidArgumentError

pytestmark = pytest.mark.timeout(120)  # fail rather than hang
JOBS = [Task(number) for number in range(4)]


def contents(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*.json")
    }


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The jobs' files when nothing goes wrong."""
    folder = tmp_path_factory.mktemp("undisturbed")
    assert run_jobs(JOBS, work, folder, count=1) == []
    return contents(folder)


def test_results_are_what_the_work_returns(tmp_path, undisturbed):
    rng = np.random.default_rng(2)
    expected = {"number": 2, "values": rng.random((3, 4)).tolist(), "best": rng.random()}
    for name, content in undisturbed.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(content)
    assert read_result(tmp_path, JOBS[2]) == expected
    assert read_result(tmp_path, Task(99)) is None


def timed(job):
    """Return a result with the times that it took."""
    return {"number": job.number, "seconds": [0.5, float(time.perf_counter())]}


def test_times_are_no_part_of_a_result(tmp_path):
    folders = [tmp_path / name for name in "ab"]
    for folder in folders:
        folder.mkdir()
        assert run_jobs(JOBS[:1], timed, folder, count=1) == []
        assert read_result(folder, JOBS[0])["seconds"][0] == 0.5
    one, other = (folder / JOBS[0].file for folder in folders)
    assert one.read_bytes() == other.read_bytes()


def test_only_missing_and_damaged_results_are_computed(tmp_path, undisturbed, capfd):
    run_jobs(JOBS, work, tmp_path, count=2)
    assert contents(tmp_path) == undisturbed
    (tmp_path / JOBS[1].file).write_bytes(b"{")
    (tmp_path / JOBS[2].file).write_text("{}")
    (tmp_path / JOBS[3].file).unlink()
    assert finished(tmp_path, JOBS) == {JOBS[0]}
    for job in JOBS[1:3]:
        with pytest.raises(DamagedFileError, match=f"{job.number}.json"):
            read_result(tmp_path, job)
    capfd.readouterr()
    assert run_jobs(JOBS, work, tmp_path, describe=lambda result: f"{result['number']}!") == []
    said = capfd.readouterr().err
    assert "3/3" in said
    assert "count 1  1!" in said
    assert "count 0" not in said
    assert contents(tmp_path) == undisturbed


def slow(job):
    """Take a second."""
    time.sleep(1.0)
    return {"number": job.number}


def test_long_jobs_are_not_silent(tmp_path, capfd, monkeypatch):
    monkeypatch.setattr("aquafish_gym.runs.jobs.SILENT_SECONDS", 0.2)
    assert run_jobs(JOBS[:1], slow, tmp_path, count=1) == []
    first, *lines = capfd.readouterr().err.splitlines()
    assert first.startswith("1 jobs, 0 done already, 1 to do; what is not compiled yet")
    assert sum("s; count 0 still runs" in line for line in lines) >= 2
    assert lines[-1].startswith("1/1  count 0")
    assert run_jobs(JOBS[:1], slow, tmp_path, count=1) == []
    assert capfd.readouterr().err == ""


def test_a_failing_job_leaves_the_others_alone(tmp_path, undisturbed):
    bad = [Task(0, action) for action in ("err", "nan")]
    failures = run_jobs([*bad, *JOBS], work, tmp_path, count=2)
    assert sorted(failure.partition(" (")[0] for failure in failures) == [
        "err 0: ValueError: no such luck",
        "nan 0: ValueError: Out of range float values are not JSON compliant: nan",
    ]
    assert contents(tmp_path) == undisturbed


def test_jobs_of_a_dead_worker_start_again(tmp_path, undisturbed):
    once = Task(0, "die once", str(tmp_path / "once"))
    assert run_jobs([once, *JOBS], work, tmp_path, count=2) == []
    done = contents(tmp_path)
    assert done.keys() == undisturbed.keys() | {once.file}
    assert {name: done[name] for name in undisturbed} == undisturbed
    with pytest.raises(OSError, match="worker processes died 3 times"):
        run_jobs([Task(0, "die"), *JOBS], work, tmp_path, count=2)


def test_a_stopped_worker_is_noticed_and_its_jobs_start_again(
    tmp_path, undisturbed, monkeypatch, capfd
):
    monkeypatch.setattr(pools, "SAID_SECONDS", 2.0)
    monkeypatch.setattr(pools, "KILLED_SECONDS", 6.0)
    once = Task(0, "stop once", str(tmp_path / "once"))
    assert run_jobs([once, *JOBS], work, tmp_path, count=2) == []
    done = contents(tmp_path)
    assert done.keys() == undisturbed.keys() | {once.file}
    assert {name: done[name] for name in undisturbed} == undisturbed
    assert "has been silent for 2 s, as if it were stopped" in capfd.readouterr().err


def test_warm_up_takes_the_missing_jobs(tmp_path):
    warmed = []
    for jobs in (JOBS[:1], JOBS[:2], JOBS[:2]):
        run_jobs(jobs, work, tmp_path, count=1, warm_up=warmed.append)
    assert warmed == [JOBS[:1], JOBS[1:2]]


def start(folder, action, count):
    return subprocess.Popen(
        [sys.executable, Path(__file__).with_name("run_jobs_here.py"), folder, action, str(count)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )


def begun(folder):
    """Return the processes that have started jobs."""
    file = folder / "begun"
    return [int(line) for line in file.read_text().split()] if file.exists() else []


def is_alive(process):
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(") ")[2][0] != "Z"
    except FileNotFoundError:
        return False


def assert_ended(folder):
    """Wait for a second until the processes that have started jobs are gone."""
    deadline = time.monotonic() + 1.0
    while any(map(is_alive, begun(folder))) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not any(map(is_alive, begun(folder)))


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="reads /proc")
@pytest.mark.parametrize(
    "stop", [signal.SIGINT, pytest.param(signal.SIGKILL, marks=pytest.mark.slow)]
)
def test_a_stopped_command_leaves_no_process_and_resumes(tmp_path, stop):
    program = start(tmp_path, "doze", 30)
    while len(list(tmp_path.rglob("*.json"))) < 3:
        assert program.poll() is None
        time.sleep(0.05)
    if stop == signal.SIGINT:
        os.killpg(program.pid, stop)  # as Ctrl-C in a terminal
    else:
        program.send_signal(stop)
    _, said = program.communicate(timeout=20)
    if stop != signal.SIGKILL:
        assert "jobs to do; the same command resumes" in said
        assert "Traceback" not in said
    assert_ended(tmp_path)
    kept = contents(tmp_path)
    assert 3 <= len(kept) < 30
    again = start(tmp_path, "doze", 10)
    assert again.wait(timeout=60) == 0
    again.communicate()
    assert contents(tmp_path).items() >= kept.items()
    assert len(contents(tmp_path)) >= 10


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="reads /proc")
def test_stopped_workers_do_not_hold_an_interruption(tmp_path):
    program = start(tmp_path, "stop", 4)
    while len(begun(tmp_path)) < 2:
        assert program.poll() is None
        time.sleep(0.05)
    time.sleep(0.5)
    program.send_signal(signal.SIGTERM)
    _, said = program.communicate(timeout=10)
    assert "interrupted with 4 of 4 jobs to do; the same command resumes" in said
    assert_ended(tmp_path)


def test_a_second_command_in_the_folder_is_refused(tmp_path):
    first = start(tmp_path, "sleep", 1)
    assert first.stdout.readline() == "locked\n"
    second = start(tmp_path, "sleep", 1)
    _, said = second.communicate(timeout=20)
    assert "in use by another command" in said
    first.kill()
    first.communicate()


def test_workers_ignore_modules_in_the_current_folder(tmp_path, monkeypatch):
    (tmp_path / "pickle.py").write_text("raise SystemExit('pickle.py of the current folder ran')")
    monkeypatch.chdir(tmp_path)
    with workers(1) as executor:
        assert executor.submit(os.getpid).result() != os.getpid()


def test_workers_end_with_the_block():
    with workers(2) as executor:
        first = executor.submit(os.getpid).result()
        with pytest.raises(ZeroDivisionError):
            executor.submit(divmod, 1, 0).result()
    with pytest.raises(ProcessLookupError):
        os.kill(first, 0)
    with contextlib.suppress(KeyError), workers(1) as executor:
        sleeping = executor.submit(time.sleep, 600)
        raise KeyError
    assert isinstance(sleeping.exception(), BrokenProcessPool)


def test_an_address_that_says_nothing_is_refused_in_time(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(cluster, "ANSWER_SECONDS", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as server:
        silent = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        for address in (silent, "tcp://", "tcp://127.0.0.1:1", "nonsense://host:1"):
            begun = time.monotonic()
            with (
                pytest.raises(InvalidArgumentError, match="scheduler: no worker answers at"),
                workers(scheduler=address),
            ):
                pass
            assert time.monotonic() - begun < 20.0


@pytest.fixture
def dask_cluster():
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0"
    ) as made:
        yield made


def test_a_cluster_of_other_code_does_no_job(dask_cluster, monkeypatch, tmp_path):
    address = dask_cluster.scheduler_address
    asked = []

    def answer(function):
        asked.append(function)
        return str(len(asked))  # the worker and the command differ

    monkeypatch.setattr(cluster, "code_hash", answer)
    monkeypatch.setattr(cluster, "computing", cluster.computing.__wrapped__)
    with pytest.raises(InvalidArgumentError, match=r"must have the code .*: code 1 there, 2 here"):
        run_jobs(JOBS, work, tmp_path, scheduler=address)
    assert asked[0] is work
    assert not list(tmp_path.iterdir())
    monkeypatch.undo()
    other = {**cluster.computing(work), "code": "0123456789abcdef"}
    with pytest.raises(cluster.OtherCodeError, match=r"code .* there, 0123456789abcdef here"):
        cluster.run_alike(other, work, divmod, 7, 2)


def test_versions_are_told_apart(monkeypatch):
    here = cluster.computing(None)
    code = cluster.computing(work)
    monkeypatch.setattr(cluster, "versions", lambda: {**versions(), "aquafish-gym": "0.2"})
    computing = cluster.computing.__wrapped__  # without its cache
    assert "aquafish-gym 0.2 there" in cluster.difference(computing(None), here)
    assert cluster.difference(computing(work), code) == ""  # another commit with the same code
    assert cluster.difference(here, dict(here)) == ""
    assert "numpy None there" in cluster.difference({**here, "numpy": None}, here)


def test_a_cluster_that_has_lost_its_workers_ends_the_command(dask_cluster, monkeypatch, tmp_path):
    monkeypatch.setattr(cluster, "ANSWER_SECONDS", 2.0)
    lost = threading.Timer(1.0, dask_cluster.scale, (0,))
    lost.start()
    with pytest.raises(OSError, match="none has answered for 2 s; the same command resumes"):
        run_jobs([Task(0, "sleep five")], work, tmp_path, scheduler=dask_cluster.scheduler_address)
    lost.join()


def test_a_dask_cluster_gives_the_same_bytes(tmp_path, undisturbed, dask_cluster):
    failures = run_jobs(
        [*JOBS, Task(0, "err")], work, tmp_path, scheduler=dask_cluster.scheduler_address
    )
    assert [failure.partition(" (")[0] for failure in failures] == [
        "err 0: ValueError: no such luck"
    ]
    assert contents(tmp_path) == undisturbed
