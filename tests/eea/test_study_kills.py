"""Whatever is killed, and wherever the replicates are made, the files are the same to the byte."""

from __future__ import annotations

import os
import random
import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from eea.__main__ import main
from test_study_command import SMALL, files

REPLICATES = 12
LONG = [
    "study",
    *("--conditions", "in-band", "out-of-band", "--steps", "16", "--rounds", "12"),
    *("--replicates", str(REPLICATES)),
    *SMALL,
]


def start(arguments):
    return subprocess.Popen(
        [sys.executable, "-m", "eea", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finished_in(folder):
    return len(list(folder.glob("runs/*/*/*.json")))


def wait_for(folder, count, process):
    deadline = time.monotonic() + 180
    while finished_in(folder) < count and process.poll() is None:
        assert time.monotonic() < deadline
        time.sleep(0.005)


def children(process):
    """Return a command's workers."""
    return [
        int(entry.name)
        for entry in Path("/proc").iterdir()
        if entry.name.isdecimal()
        and _stat(entry)[1:2] == [str(process)]
        and b"spawn_main" in (entry / "cmdline").read_bytes()
    ]


def _stat(entry):
    try:
        return (entry / "stat").read_text().rpartition(")")[2].split()
    except OSError:
        return []


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("undisturbed")
    assert main([*LONG, "--workers", "1", "--out", str(folder)]) == 0
    return files(folder)


@pytest.mark.slow
def test_sigkill_at_any_moment_changes_no_byte(tmp_path, undisturbed):
    rng = random.Random(0)
    kills = 0
    for victim in ("command", "worker", "command", "stopped worker"):
        process = start([*LONG, "--workers", "2", "--out", str(tmp_path)])
        try:
            wait_for(tmp_path, finished_in(tmp_path) + rng.randrange(1, 4), process)
            time.sleep(rng.uniform(0.0, 0.05))
            if victim != "command":
                # Its replicate is taken up by another process, and the command goes on.
                how = signal.SIGKILL if victim == "worker" else signal.SIGSTOP
                child = children(process.pid)[0]
                os.kill(child, how)
                deadline = time.monotonic() + 120
                while Path(f"/proc/{child}").exists():  # a stopped one is killed by the command
                    assert time.monotonic() < deadline
                    time.sleep(0.05)
                wait_for(tmp_path, finished_in(tmp_path) + 2, process)
            kills += process.poll() is None
        finally:
            workers = children(process.pid)
            process.kill()
            for worker in workers:  # one that is stopped would hold the pipes open for ever
                with suppress(ProcessLookupError):
                    os.kill(worker, signal.SIGCONT)
            process.communicate()
    assert kills >= 2
    assert main([*LONG, "--workers", "2", "--out", str(tmp_path)]) == 0
    assert files(tmp_path) == undisturbed


def test_ctrl_c_stops_at_once_and_says_how_to_go_on(tmp_path):
    process = start(
        [*LONG, "--rounds", "10000", "--workers", "2", "--replicates", "5", "--out", str(tmp_path)]
    )
    try:
        deadline = time.monotonic() + 180
        while not (tmp_path / "study.json").exists() and process.poll() is None:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        while len(workers := children(process.pid)) < 2:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=30)
    finally:
        process.kill()
    assert process.returncode == 130
    assert said.startswith("eea: stopped with 0 of 10 replicates")
    assert said.endswith(
        f"; every finished replicate is in {tmp_path}, and the same command resumes\n"
    )
    assert said.count("\n") == 1
    assert not [worker for worker in workers if Path(f"/proc/{worker}").exists()]
    assert list(files(tmp_path)) == ["study.json"]


@contextmanager
def cluster(folder):
    """Run a dask scheduler and two workers; give its address and the workers."""
    pytest.importorskip("distributed")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])

    def run(program, *arguments):
        return subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.dask_{program}", *arguments],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    address = f"tcp://127.0.0.1:{port}"
    programs = [run("scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard")]
    options = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", str(folder))
    programs += [run("worker", address, *options) for _ in range(2)]
    try:
        deadline = time.monotonic() + 60
        while True:
            with socket.socket() as one:
                if one.connect_ex(("127.0.0.1", int(port))) == 0:
                    break
            assert time.monotonic() < deadline
            time.sleep(0.1)
        yield address, programs[1:]
    finally:
        for program in programs:
            program.kill()
            program.wait()


@pytest.mark.slow
def test_a_cluster_one_of_whose_workers_is_killed_makes_the_same_bytes(
    tmp_path, tmp_path_factory, undisturbed
):
    with cluster(tmp_path_factory.mktemp("dask")) as (address, hands):
        process = start([*LONG, "--scheduler", address, "--out", str(tmp_path)])
        try:
            wait_for(tmp_path, 3, process)
            alive = process.poll() is None
            hands[0].kill()
            said, wrong = process.communicate(timeout=240)
        finally:
            process.kill()
    assert alive, "the worker was killed before the end"
    assert process.returncode == 0, wrong
    assert "24 of 24 replicates" in said
    assert files(tmp_path) == undisturbed
