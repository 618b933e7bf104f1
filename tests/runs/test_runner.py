"""The runner: whatever stops it and whoever does the jobs, the folder ends with the same bytes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from run_jobs_here import COMMAND, Task, work

from aquafish_gym.runs.executors import workers
from aquafish_gym.runs.folder import held
from aquafish_gym.runs.runner import Event, finished, merge_results, read_result, run_jobs
from aquafish_gym.runs.storage import DamagedFileError
from aquafish_gym.utils.validation import InvalidArgumentError

JOBS = [Task(number) for number in range(6)]


def contents(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*.json")
    }


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The bytes of the jobs' files when nothing goes wrong."""
    folder = tmp_path_factory.mktemp("undisturbed")
    with ThreadPoolExecutor(1) as executor:
        assert run_jobs(JOBS, work, folder, executor) == []
    return contents(folder)


def test_what_the_work_returns_is_what_is_read(tmp_path, undisturbed):
    events = []
    with ThreadPoolExecutor(1) as executor:
        assert run_jobs(JOBS, work, tmp_path, executor, events.append) == []
    assert contents(tmp_path) == undisturbed
    rng = np.random.default_rng(4)
    expected = {"number": 4, "values": rng.random((3, 4)).tolist(), "best": rng.random()}
    assert read_result(tmp_path, JOBS[4]) == expected
    assert events == [
        Event("done", job, share=1.0, document=read_result(tmp_path, job)) for job in JOBS
    ]
    assert read_result(tmp_path, Task(99)) is None


def test_only_what_is_missing_or_damaged_is_done(tmp_path, undisturbed):
    with ThreadPoolExecutor(1) as executor:
        run_jobs(JOBS[:4], work, tmp_path, executor)
        damaged = tmp_path / JOBS[1].file
        damaged.write_bytes(damaged.read_bytes().replace(b"1", b"7", 1))
        (tmp_path / JOBS[2].file).unlink()
        assert finished(tmp_path, JOBS) == {JOBS[0], JOBS[3]}
        with pytest.raises(DamagedFileError, match=r"1\.json"):
            read_result(tmp_path, JOBS[1])
        events = []
        assert run_jobs(JOBS, work, tmp_path, executor, events.append) == []
    assert [event.job.number for event in events] == [1, 2, 4, 5]
    assert contents(tmp_path) == undisturbed


def test_a_result_in_anothers_place_is_found(tmp_path):
    with ThreadPoolExecutor(1) as executor:
        run_jobs(JOBS[:2], work, tmp_path, executor)
    (tmp_path / JOBS[0].file).rename(tmp_path / JOBS[1].file)
    with pytest.raises(DamagedFileError, match=r"1\.json holds the result of another job"):
        read_result(tmp_path, JOBS[1])


def test_every_failure_is_named_and_the_others_are_done(tmp_path, undisturbed):
    bad = [Task(0, action) for action in ("err", "eof", "nan", "object", "leave", "die")]
    memories = [Task(0, "die once", str(tmp_path / "once"))]
    events = []
    with workers(2) as executor:
        failures = run_jobs([*bad, *JOBS, *memories], work, tmp_path, executor, events.append)
    assert sorted(failures) == [
        "die 0: its process was killed by SIGKILL, 3 times",
        failures_of("eof", failures, "EOFError: the log ends early (run_jobs_here.py, line "),
        failures_of("err", failures, "ValueError: no such luck (run_jobs_here.py, line "),
        "leave 0: its process ended with code 7, 3 times",
        failures_of("nan", failures, "ValueError: Out of range float values are not JSON compl"),
        failures_of("object", failures, "TypeError: a object cannot be written as JSON"),
    ]
    done = contents(tmp_path)
    assert done.keys() == undisturbed.keys() | {memories[0].file}
    assert {name: done[name] for name in undisturbed} == undisturbed
    kinds = {job: [e.kind for e in events if e.job == job] for job in (*bad, *JOBS, *memories)}
    assert kinds[memories[0]] == ["began", "said", "retried", "began", "said", "done"]
    assert kinds[bad[-1]] == ["began", "said", "retried"] * 2 + ["began", "said", "failed"]
    assert kinds[JOBS[0]] == ["began", "said", "done"]


def failures_of(action, failures, beginning):
    """Return the failure of an action, which must begin so."""
    (found,) = [failure for failure in failures if failure.startswith(f"{action} 0: ")]
    assert found.startswith(f"{action} 0: {beginning}")
    return found


@pytest.mark.parametrize("file", ["../a.json", "/a.json", "", "a/../../b.json"])
def test_a_file_outside_the_folder_is_refused(tmp_path, file):
    class Outside(Task):
        file = "x"

    Outside.file = file
    with (
        ThreadPoolExecutor(1) as executor,
        pytest.raises(InvalidArgumentError, match="must be in the folder"),
    ):
        run_jobs([Outside(1)], work, tmp_path, executor)


def test_two_jobs_of_one_file_are_refused(tmp_path):
    twice = [Task(1), replace(Task(1), memory="elsewhere")]
    with (
        ThreadPoolExecutor(1) as executor,
        pytest.raises(InvalidArgumentError, match="count 1 and count 1 both have"),
    ):
        run_jobs(twice, work, tmp_path, executor)


def test_folders_are_merged(tmp_path, undisturbed):
    folders = [tmp_path / name for name in ("one", "two", "three")]
    with ThreadPoolExecutor(1) as executor:
        for folder, jobs in zip(folders, (JOBS[:3], JOBS[2:], JOBS[:1]), strict=True):
            folder.mkdir()
            run_jobs(jobs, work, folder, executor)
    one, two, three = folders
    damaged = one / JOBS[2].file  # the other's is sound
    damaged.write_bytes(b"{")
    assert merge_results(one, two, JOBS) == 4
    assert contents(one) == undisturbed
    assert merge_results(one, two, JOBS) == 0
    other = three / JOBS[0].file
    other.write_bytes(other.read_bytes().rstrip() + b"   \n")  # sound, but not the same bytes
    with pytest.raises(InvalidArgumentError, match=r"different results of count 0 \(runs/count/0"):
        merge_results(one, three, JOBS)
    (three / JOBS[0].file).write_bytes(b"{")
    with pytest.raises(DamagedFileError, match=r"three/runs/count/0\.json"):
        merge_results(one, three, JOBS)
    assert contents(one) == undisturbed


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_is_answered_at_once_and_stops_the_workers(start, tmp_path, how):
    command = start(COMMAND, tmp_path, "sleep", 3)
    while not command.stdout.readline().startswith("said"):
        assert command.poll() is None
    children = children_of(command.pid)
    assert len(children) >= 2
    began = time.monotonic()
    command.send_signal(how)
    _, errors = command.communicate()
    assert (command.returncode, errors) == (130, "")
    assert time.monotonic() - began < 5
    assert_gone(children)
    assert not (tmp_path / "lock").exists()


def test_sigterm_before_the_workers_start_is_an_interruption(start, tmp_path):
    command = start(COMMAND, tmp_path, "sleep", 2)
    assert command.stdout.readline() == "held\n"
    while not command.stdout.readline().startswith("began"):
        assert command.poll() is None
    command.send_signal(signal.SIGTERM)  # their processes are still importing
    _, errors = command.communicate()
    assert (command.returncode, errors) == (130, "")


def test_workers_end_when_their_parent_is_killed(start, tmp_path):
    command = start(COMMAND, tmp_path, "sleep", 2)
    for _ in range(2):
        while not command.stdout.readline().startswith("said"):
            assert command.poll() is None
    children = children_of(command.pid)
    command.kill()
    command.wait()
    assert_gone(children)
    with held(tmp_path):  # a dead command holds nothing
        pass


def test_a_second_command_is_refused(start, tmp_path):
    first = start(COMMAND, tmp_path, "sleep", 1)
    assert first.stdout.readline() == "held\n"
    second = start(COMMAND, tmp_path, "count", 1)
    _, errors = second.communicate()
    assert second.returncode == 2
    assert errors.startswith(f"out: {tmp_path} is in use by another command, process {first.pid} ")
    assert errors.count("\n") == 1


def test_of_commands_that_race_for_a_folder_one_wins(start, tmp_path, undisturbed):
    commands = [start(COMMAND, tmp_path, "count", 6) for _ in range(3)]
    said = [command.communicate()[1] for command in commands]
    codes = [command.returncode for command in commands]
    assert 0 in codes
    assert set(codes) <= {0, 2}
    assert all(
        ("is in use by another command" in words) == (code == 2)
        for words, code in zip(said, codes, strict=True)
    )
    assert contents(tmp_path) == undisturbed


def test_a_command_that_was_stopped_itself_takes_nobody_for_stopped(start, tmp_path):
    """Ctrl-Z stops the parent and its workers for longer than their silence may last."""
    code = COMMAND.replace(
        "if __name__",
        "from aquafish_gym.runs import executors, processes\n"
        "executors.ProcessExecutor = lambda count: processes.ProcessExecutor(count, silence=2)\n"
        "if __name__",
    )
    command = start(code, tmp_path, "doze", 2)
    for _ in range(2):
        while not command.stdout.readline().startswith("said"):
            assert command.poll() is None
    everyone = [command.pid, *children_of(command.pid)]
    for process in everyone:
        os.kill(process, signal.SIGSTOP)
    time.sleep(3.5)
    for process in everyone:
        os.kill(process, signal.SIGCONT)
    said, errors = command.communicate()
    assert (command.returncode, errors) == (0, "")
    assert "retried" not in said


@pytest.mark.slow
def test_kills_at_random_instants_change_no_byte(start, tmp_path):
    """Of the command and of its workers, until the jobs are done."""
    rng = np.random.default_rng(8)
    folder = tmp_path / "out"
    folder.mkdir()
    for attempt in range(60):
        command = start(COMMAND, folder, "short sleep", 24)
        try:
            command.wait(rng.uniform(0.3, 2.0))
        except subprocess.TimeoutExpired:
            victims = [*children_of(command.pid), command.pid]
            with_parent = attempt % 2
            for victim in victims if with_parent else victims[-2:-1]:
                try:
                    os.kill(victim, signal.SIGKILL)
                except ProcessLookupError:
                    continue
            if not with_parent:
                command.wait(60)
        if command.returncode == 0:
            break
    assert command.returncode == 0
    expected = tmp_path / "expected"
    jobs = [Task(number, "short sleep") for number in range(24)]
    with ThreadPoolExecutor(8) as executor:
        run_jobs(jobs, work, expected, executor)
    assert contents(folder) == contents(expected)
    assert not list(folder.rglob(".*"))


def children_of(process):
    """Return the living children of a process, without the one that tracks its resources."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
            command = (stat.parent / "cmdline").read_text()
        except OSError:
            continue
        if int(fields[1]) == process and "spawn_main" in command:
            found.append(int(stat.parent.name))
    return found


def assert_gone(processes):
    deadline = time.monotonic() + 30
    while any(_alive(process) for process in processes):
        assert time.monotonic() < deadline, "they live on"
        time.sleep(0.05)


def _alive(process):
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_the_files_are_plain_json(tmp_path):
    with ThreadPoolExecutor(1) as executor:
        run_jobs(JOBS[:1], work, tmp_path, executor)
    document = json.loads((tmp_path / JOBS[0].file).read_text())
    assert list(document)[:3] == ["schema", "checksum", "job"]
    assert document["job"] == JOBS[0].file
