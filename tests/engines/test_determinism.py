"""Bit identity: no result depends on lanes, threads, batches, processes or the kind of CPU."""

from __future__ import annotations

import copy
import hashlib
import json
import os
import pathlib
import pickle
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from llvmlite import binding

from aquafish_gym.imu import ImuLog
from aquafish_gym.morphology import MAXIMA
from instruments.verification.trials import lane_batch, random_trials

FIELDS = ("rpy", "gyro", "position", "quaternion", "fin_angles")
DTYPES = (np.float32, np.float64)
COUNT = 150

dtypes = pytest.mark.parametrize("dtype", DTYPES, ids=("float32", "float64"))


@pytest.fixture(scope="module")
def trials():  # type: ignore[no-untyped-def]
    found = random_trials(COUNT)
    found.morphologies[0], found.morphologies[1] = 0.0, MAXIMA
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
@pytest.mark.parametrize("width", [1, 2, 4, 8, 16])
def test_lane_width_changes_nothing(trials, dtype, width: int) -> None:  # type: ignore[no-untyped-def]
    assert whole_log(trials, dtype, width=width) == whole_log(trials, dtype)


@dtypes
@pytest.mark.parametrize("threads", [2, 3, 7])
def test_threads_change_nothing(trials, dtype, threads: int) -> None:  # type: ignore[no-untyped-def]
    """The batch has work enough for each of them: 1000 steps of at least ten groups."""
    one, many = (whole_log(trials, dtype, 1000, threads=n) for n in (1, threads))
    assert many == one


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


@dtypes
@pytest.mark.parametrize(
    "again", [copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))], ids=["copy", "pickle"]
)
def test_a_copied_batch_goes_on_identically(trials, dtype, again) -> None:  # type: ignore[no-untyped-def]
    lanes = lane_batch(trials.morphologies, trials.fin_angles, (0.1, 0.2, 0.0), dtype)
    lanes.advance(trials.commands, 37)
    twin = again(lanes)
    first = as_bytes(twin.log(trials.commands, 50, "pose"))
    assert as_bytes(lanes.log(trials.commands, 50, "pose")) == first
    assert twin.steps_done == lanes.steps_done == 87


SCRIPT = """
import hashlib, json
import numpy as np
from aquafish_gym.engines.compiled import lanes
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
