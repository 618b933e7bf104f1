"""Bit identity: no result depends on lanes, threads, batches, processes or the kind of CPU."""

from __future__ import annotations

import hashlib
import json
import os
import pathlib
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from llvmlite import binding
from numpy.testing import assert_array_equal

import aquafish_gym
from aquafish_gym import simulate
from aquafish_gym.imu import ImuLog
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.utils.validation import InvalidArgumentError
from instruments.verification.trials import lane_batch, random_trials

FIELDS = ("rpy", "gyro", "position", "quaternion", "fin_angles")
DTYPES = (np.float32, np.float64)
COUNT = 150

dtypes = pytest.mark.parametrize("dtype", DTYPES, ids=("float32", "float64"))


@pytest.fixture(scope="module")
def trials():  # type: ignore[no-untyped-def]
    found = random_trials(COUNT)
    found.morphologies[0], found.morphologies[1] = 0.0, AQUAFISH.maxima
    return found


def whole_log(trials, dtype, steps=100, rows=slice(None), **options) -> bytes:  # type: ignore[no-untyped-def]
    """Return all that a batch logs, as bytes."""
    lanes = lane_batch(trials.morphologies[rows], trials.fin_angles[rows], dtype=dtype, **options)
    return as_bytes(lanes.log(trials.commands[rows], steps, "pose"))


def as_bytes(log: ImuLog, robot: int | slice = slice(None)) -> bytes:
    return b"".join(np.ascontiguousarray(getattr(log, f)[robot]).tobytes() for f in FIELDS)


# Each width is compiled by itself, for half a minute; a width of one is scalar code.
@pytest.mark.slow
@dtypes
@pytest.mark.parametrize(
    ("width", "reactive"), [(1, False), (2, False), (4, False), (4, True), (8, False), (16, False)]
)
def test_lane_width_changes_nothing(trials, dtype, width: int, reactive: bool) -> None:  # type: ignore[no-untyped-def]
    one, other = (whole_log(trials, dtype, width=each, reactive=reactive) for each in (width, None))
    assert one == other


@dtypes
def test_threads_change_nothing(trials, dtype) -> None:  # type: ignore[no-untyped-def]
    """The batch has work enough for each of them: 1000 steps of at least ten groups."""
    one = whole_log(trials, dtype, 1000, threads=1)
    assert all(whole_log(trials, dtype, 1000, threads=n) == one for n in (2, 3, 7))


@pytest.fixture(scope="module")
def alone(trials):  # type: ignore[no-untyped-def]
    """Return every robot's log by itself."""
    logs = {}
    for dtype in DTYPES:
        lanes = lane_batch(trials.morphologies, trials.fin_angles, dtype=dtype)
        log = lanes.log(trials.commands, 40, "pose")
        logs[dtype] = [as_bytes(log, i) for i in range(COUNT)]
    return logs


@dtypes
@given(rows=st.lists(st.integers(0, COUNT - 1), min_size=1, max_size=70))
@settings(max_examples=25, deadline=None)
def test_no_robot_minds_its_batch(trials, alone, dtype, rows: list[int]) -> None:  # type: ignore[no-untyped-def]
    """In any order, batch size and company, even its own."""
    lanes = lane_batch(trials.morphologies[rows], trials.fin_angles[rows], dtype=dtype)
    log = lanes.log(trials.commands[rows], 40, "pose")
    assert [as_bytes(log, i) for i in range(len(rows))] == [alone[dtype][i] for i in rows]


def test_a_run_in_parts_is_the_run_in_one(trials) -> None:  # type: ignore[no-untyped-def]
    bodies, commands, angles = trials[:3]
    whole = lane_batch(bodies, angles).log(commands, 100, "pose")
    parts = lane_batch(bodies, angles)
    logs = [parts.log(commands, n, "pose") for n in (1, 37, 62)]
    assert_array_equal(np.concatenate([log.rpy for log in logs], axis=1), whole.rpy)
    for name in ("gyro", "position", "quaternion"):
        joined = np.concatenate([getattr(log, name) for log in logs], axis=1)
        assert_array_equal(joined, getattr(whole, name))


def test_an_empty_batch_gives_an_empty_log() -> None:
    log = aquafish_gym.simulate(np.empty((0, 9)), np.empty((0, 3)), np.empty((0, 3)), steps=5)
    assert log.rpy.shape == (0, 5, 3)


def test_a_batch_refuses_commands_for_another_number_of_robots() -> None:
    """They would be read beyond their end."""
    lanes = lane_batch(np.ones((5, 9)) * 0.3, np.zeros((5, 3)))
    for call in (lambda c: lanes.advance(c, 8), lambda c: lanes.spectra(c, 8)):
        with pytest.raises(ValueError, match="commands must be those of 5 robots; got 1"):
            call(np.zeros((1, 3)))


def test_a_log_larger_than_the_memory_is_refused_before_it_is_made() -> None:
    commands = np.broadcast_to((0.1, 0.1, 0.5), (100_000, 3))
    with pytest.raises(InvalidArgumentError, match=r"would take [\d,]+ GiB"):
        simulate(None, commands, steps=10**6, record="pose")


SCRIPT = """
import hashlib, json
import numpy as np
from aquafish_gym.engines.compiled import lanes
from aquafish_gym.plans import AQUAFISH
from instruments.verification.trials import lane_batch, random_trials

used, inner = [], lanes.compile_kernel
lanes.compile_kernel = lambda *a, **k: used.append(inner(*a, **k)) or used[-1]
trials, found = random_trials(40), {}
for dtype in (np.float32, np.float64):
    batch = lane_batch(trials.morphologies, trials.fin_angles, dtype=dtype)
    log = batch.log(trials.commands, 200, "pose")
    fields = ("rpy", "gyro", "position", "quaternion", "fin_angles")
    parts = [np.ascontiguousarray(getattr(log, f)).tobytes() for f in fields]
    code = "".join(used[-1].inspect_asm(s) for s in used[-1].signatures) if INSPECT else ""
    wide = sum(code.count(register) for register in ("%ymm", "%zmm"))
    found[np.dtype(dtype).name] = {
        "hash": hashlib.sha256(b"".join(parts)).hexdigest(),
        "narrow": code.count("%xmm"), "wide": wide, "fused": code.count("vfmadd"),
    }
print(json.dumps(found))
"""


def in_a_process(inspect: bool, **environment: str) -> dict[str, dict[str, object]]:
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT.replace("INSPECT", str(inspect))],
        env={**os.environ, **environment}, check=True, capture_output=True, text=True,
    )  # fmt: skip
    return json.loads(done.stdout)  # type: ignore[no-any-return]


@pytest.fixture(scope="module")
def hashes() -> dict[str, str]:
    """Return the hash of each precision's log in this process."""
    few = random_trials(40)
    return {
        np.dtype(dtype).name: hashlib.sha256(whole_log(few, dtype, 200)).hexdigest()
        for dtype in DTYPES
    }


def test_another_process_computes_the_same_bits(hashes: dict[str, str]) -> None:
    found = in_a_process(inspect=False)
    assert {name: entry["hash"] for name, entry in found.items()} == hashes


@pytest.mark.slow  # it compiles kernels of its own
def test_the_plainest_cpu_computes_the_same_bits(
    tmp_path: pathlib.Path, hashes: dict[str, str]
) -> None:
    """Compiled for any x86-64: no AVX, and fused multiply-adds by the C library."""
    found = in_a_process(True, NUMBA_CPU_NAME="generic", NUMBA_CACHE_DIR=str(tmp_path))
    for entry in found.values():
        assert entry["narrow"] > 0, "it is compiled in this process"  # type: ignore[operator]
        assert entry["wide"] == entry["fused"] == 0, "and without AVX"
    assert {name: entry["hash"] for name, entry in found.items()} == hashes


@pytest.mark.slow
@pytest.mark.parametrize("cpu", ["haswell", "skylake-avx512"])
def test_other_cpus_compute_the_same_bits(
    tmp_path: pathlib.Path, hashes: dict[str, str], cpu: str
) -> None:
    host = binding.get_host_cpu_features()
    if not host.get("avx512f" if "avx512" in cpu else "avx2"):
        pytest.skip(f"this machine cannot run {cpu}'s instructions")
    found = in_a_process(
        True, NUMBA_CPU_NAME=cpu, NUMBA_CPU_FEATURES="", NUMBA_CACHE_DIR=str(tmp_path)
    )
    for entry in found.values():
        assert entry["wide"] > 0  # type: ignore[operator]
    assert {name: entry["hash"] for name, entry in found.items()} == hashes
