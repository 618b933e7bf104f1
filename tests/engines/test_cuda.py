"""Robots on a GPU have the bits of the lanes.

Where there is no GPU, the same tests run the lanes' own kernel behind a stand-in for CUDA's
functions, so that all but the compilation for the GPU is tested; and the kernels are compiled
without a driver.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import re
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numba import njit, typeof

from aquafish_gym import Damage, Morphology, simulate
from aquafish_gym.engines import packages
from aquafish_gym.engines.compiled.kernel import compile_kernel
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.engines.compiled.spectrum import pack_spectra, partial_distances
from aquafish_gym.envs.tasks import check_task
from aquafish_gym.physics import simd
from aquafish_gym.physics.arithmetic import put
from aquafish_gym.plans import AQUAFISH, BodyPlan
from aquafish_gym.rollout import rollout
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.validation import (
    EngineUnavailableError,
    InvalidArgumentError,
    UnknownNameError,
)
from gait.controllers.controller import Controller, program_of
from gait.swims.poses import random_poses
from gait.swims.scores import scores
from instruments.verification.trials import random_trials
from tests.plans import COMPILED_PLANS

if importlib.util.find_spec("numba_cuda") is None:
    pytest.skip("numba-cuda is not installed", allow_module_level=True)
engine: Any = importlib.import_module("aquafish_gym.engines.cuda")
FIELDS = ("rpy", "gyro", "position", "quaternion", "fin_angles", "diverged")


def make_controller(seed: int) -> Controller:
    """Return a random network without hidden nodes."""
    weights = np.zeros((3, 14))
    weights[:, :11] = np.random.default_rng(seed).standard_normal((3, 11))
    return Controller(weights, np.zeros(3), np.ones(3), 0.7, Morphology.nominal(), seed=seed)


class OnGpu(np.ndarray):
    """An array as the stand-in gives it: a copy that only ``copy_to_host`` brings back."""

    def copy_to_host(self, to: np.ndarray | None = None) -> np.ndarray:
        if to is None:
            return np.array(self)
        to[...] = self
        return to


class StandIn:
    """The functions of ``numba.cuda`` that the engine calls, for a GPU of four multiprocessors."""

    free = 2**40  # bytes
    swum = 0  # parts

    def to_device(self, array: np.ndarray) -> OnGpu:
        return np.array(array).view(OnGpu)

    def device_array(self, shape: Any, dtype: Any) -> OnGpu:
        return np.full(shape, np.nan, dtype).view(OnGpu)

    def current_context(self) -> Any:
        return SimpleNamespace(get_memory_info=lambda: SimpleNamespace(free=self.free))

    def get_current_device(self) -> Any:
        return SimpleNamespace(
            name=b"a stand-in", MAX_REGISTERS_PER_MULTIPROCESSOR=65536, MULTIPROCESSOR_COUNT=4
        )

    def event(self) -> Any:
        return SimpleNamespace(record=lambda: None, synchronize=lambda: None)

    def event_elapsed_time(self, *_: Any) -> float:
        return 2000.0  # ms

    def loop_kernel(self, plan: BodyPlan, policy: Any, reactive: bool, *rest: Any) -> Any:
        """Return the lanes' kernel at the GPU's width; ``last`` holds its arguments."""
        *task, _dtype = rest
        kernel = compile_kernel(plan, policy, engine.WIDTH, reactive, *task)

        def launch(*arguments: Any) -> None:
            self.last, self.swum = arguments, self.swum + 1
            *tables, works, groups = arguments
            assert works.shape[0] <= 4 * 4 * 8
            plain = [table.view(np.ndarray) for table in tables[:4]]
            kernel(*plain, *map(plainly, tables[4:]), plainly(works)[0], 0, groups)

        return {(-(-n // 8), 128): launch for n in range(1, 4 * 4 * 8 + 1)}

    def distance_kernel(self) -> Any:
        def compare(spectra: Any, observed: Any, which: Any, rows: int, partial: Any) -> None:
            zero = simd.zero_lanes(partial, 16)
            for b in range(len(which)):
                put(partial, b, partial_distances(spectra, b, observed, which[b], rows, zero))

        def launch(*arguments: Any) -> None:
            njit(compare)(*map(plainly, arguments))

        return {(-(-n // 8), 128): launch for n in range(1, 4 * 4 * 8 + 1)}


def plainly(argument: Any) -> Any:
    """Return an argument with numpy's arrays in place of the stand-in's."""
    if isinstance(argument, tuple):
        parts = map(plainly, argument)
        return type(argument)(*parts) if hasattr(argument, "_fields") else tuple(parts)
    return argument.view(np.ndarray) if isinstance(argument, OnGpu) else argument


@pytest.fixture(params=["stand-in", "gpu"])
def gpu(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return the stand-in, or None on a GPU."""
    if request.param == "gpu":
        try:
            packages.check_gpu()
        except EngineUnavailableError as error:
            pytest.skip(f"no GPU is here: {error}")
        return None
    stand_in = StandIn()
    for name in ("loop_kernel", "distance_kernel"):
        monkeypatch.setattr(engine, name, getattr(stand_in, name))
    monkeypatch.setattr(engine, "cuda", stand_in)
    monkeypatch.setattr(packages, "check_gpu", lambda: None)
    return stand_in


def assert_same_log(robots: int, steps: int, plan: BodyPlan = AQUAFISH, **options: Any) -> None:
    trials = random_trials(robots, 5, plan)[:3]
    ours, lanes = (
        simulate(*trials, steps=steps, plan=plan, engine=name, **options)
        for name in ("cuda", "numba")
    )
    for name in FIELDS:
        one, other = getattr(ours, name), getattr(lanes, name)
        assert (one is None) == (other is None), name
        if one is not None:
            assert one.dtype == other.dtype
            np.testing.assert_array_equal(one, other, err_msg=name)


@pytest.mark.usefixtures("gpu")
@pytest.mark.parametrize("dtype", ["float32", pytest.param("float64", marks=pytest.mark.slow)])
def test_a_thousand_robots_swim_five_seconds_as_in_the_lanes(dtype: str) -> None:
    assert_same_log(1000, 500, dtype=dtype)


@pytest.mark.usefixtures("gpu")
@pytest.mark.parametrize("plan", COMPILED_PLANS)
@pytest.mark.parametrize("reactive", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_what_differs_from_robot_to_robot_is_as_in_the_lanes(
    reactive: bool, plan: BodyPlan
) -> None:
    rng = np.random.default_rng(9)
    fins = len(plan.fins)
    assert_same_log(
        43, 77, plan, reactive=reactive, record="pose", substeps=2,
        current=rng.uniform(-0.5, 0.5, (43, 3)), drag=rng.uniform(0.0, 3.0, (43, 2)),
        servo_gain=rng.uniform(-2.0, 2.0, (43, fins)), lag=rng.uniform(0.0, 0.3, 43),
        velocity=rng.uniform(-1.0, 1.0, (43, 3)),
    )  # fmt: skip


@pytest.mark.usefixtures("gpu")
def test_series_that_have_begun_are_as_in_the_lanes() -> None:
    rng = np.random.default_rng(3)
    series = rng.uniform(AQUAFISH.command_low, AQUAFISH.command_high, (5, 12, 3))
    ours, lanes = (
        simulate(None, series, steps=60, interval=5, begun=13, lag=0.037, engine=name)
        for name in ("cuda", "numba")
    )
    np.testing.assert_array_equal(ours.rpy, lanes.rpy)


@pytest.mark.usefixtures("gpu")
@pytest.mark.parametrize(
    "task", ["forward", "return", pytest.param("station", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("damage", ["", "gyro:noise=0.05; left_pectoral:seized@1; up_x:stuck@2"])
@pytest.mark.parametrize("dtype", ["float32", pytest.param("float64", marks=pytest.mark.slow)])
def test_programs_swim_as_in_the_lanes(dtype: str, damage: str, task: str) -> None:
    controllers = [make_controller(seed) for seed in range(3)]
    poses = random_poses(7, 2)
    ours, lanes = (
        scores(controllers, None, poses, task=task, damage=damage, engine=name, dtype=dtype)
        for name in ("cuda", "numba")
    )
    assert np.ptp(lanes) > 0.0
    np.testing.assert_array_equal(ours, lanes)


@pytest.mark.usefixtures("gpu")
@pytest.mark.parametrize("dtype", ["float32", pytest.param("float64", marks=pytest.mark.slow)])
def test_distances_of_logs_are_as_in_the_lanes(dtype: str) -> None:
    trials = random_trials(70, 5)
    robots = Scenario.create(trials.morphologies, fin_angles=trials.fin_angles)
    kind = getattr(np, dtype)
    lanes, ours = LaneBatch(robots, kind), engine.CudaBatch(robots, kind)
    spectra = lanes.spectra(trials.commands, 64, 2.0)
    count = 3 * (64 // 2 + 1)
    seen = spectra[[4, 9], 0, :count] + 1j * spectra[[4, 9], 1, :count]
    which = np.arange(70) % 2
    asked = (trials.commands, 64, 2.0, pack_spectra(seen, kind), which)
    lanes, ours = LaneBatch(robots, kind), engine.CudaBatch(robots, kind)
    one, other = ours.distances(*asked), lanes.distances(*asked)
    np.testing.assert_array_equal(one, other)
    assert one[4] == one[9] == 0.0 < one[5]
    again = engine.CudaBatch(robots, kind).spectra(trials.commands, 64, 2.0)
    np.testing.assert_array_equal(again, spectra)


def test_a_batch_that_does_not_fit_swims_in_parts(
    gpu: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    if gpu is None:
        monkeypatch.setattr(engine, "SHARE_OF_MEMORY", 1e-6)
    else:
        gpu.free = 60_000
    assert_same_log(131, 20, record="pose", lag=0.013)
    if gpu is not None:
        assert gpu.swum > 3


@pytest.mark.usefixtures("gpu")
def test_memory_that_is_not_there_is_one_sentence(monkeypatch: Any) -> None:
    def no_memory(*_: Any) -> None:
        raise engine.CudaAPIError(engine.OUT_OF_MEMORY, "CUDA_ERROR_OUT_OF_MEMORY")

    monkeypatch.setattr(engine.cuda, "device_array", no_memory)
    with pytest.raises(EngineUnavailableError, match="not enough free memory for 3 robots"):
        simulate(np.full((3, 9), 0.3), (0.1, 0.1, 0.1), steps=4, engine="cuda")


@pytest.mark.usefixtures("gpu")
def test_no_robots_have_empty_logs_and_no_distances() -> None:
    assert_same_log(0, 5)
    nobody = Scenario.create(np.zeros((0, 9)))
    batch = engine.CudaBatch(nobody, np.float32)
    seen = np.zeros((1, 2, 32), np.float32)
    assert batch.distances(np.zeros((0, 3)), 16, 1.0, seen, np.zeros(0, np.intp)).shape == (0,)


@pytest.mark.usefixtures("gpu")
def test_what_a_gpu_cannot_swim_is_refused() -> None:
    with pytest.raises(InvalidArgumentError, match='threads must be None for the engine "cuda"'):
        simulate(None, (0.1, 0.1, 0.1), steps=4, engine="cuda", threads=2)
    robot = Scenario.create(Morphology.nominal())
    still = [lambda *_: (0.0, 0.0, 0.0)]
    with pytest.raises(InvalidArgumentError, match='engine must be "numba" or "pybullet" for'):
        rollout(still, robot, seconds=1.0, engine="cuda")
    program = program_of([make_controller(0)], 1)
    late = Damage.parse("gyro:delay=0.1").edit(robot, 5)
    rng = [np.random.default_rng(0)]
    with pytest.raises(InvalidArgumentError, match="late, slow or scaled channels: a GPU swims"):
        rollout(program, late, check_task("forward"), engine="cuda", rngs=rng)
    with pytest.raises(InvalidArgumentError, match='threads must be None for the engine "cuda"'):
        rollout(program, robot, seconds=1.0, engine="cuda", threads=1)
    with pytest.raises(UnknownNameError, match="numba, pybullet; got 'cuda'"):
        packages.check_engine("cuda")


@pytest.mark.parametrize("wrong", ["--robots 10 0", "--mjx -1", "--double -1", "--lanes 0"])
def test_the_benchmark_refuses_numbers_of_robots(
    wrong: str, capsys: pytest.CaptureFixture[str]
) -> None:
    bench = importlib.import_module("instruments.benchmarks.gpu")
    assert bench.main(wrong.split()) == 2
    assert f"{wrong.split()[0][2:]} must be" in capsys.readouterr().err


@pytest.mark.slow
def test_the_benchmark_prints_and_writes_each_row(
    gpu: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bench = importlib.import_module("instruments.benchmarks.gpu")
    monkeypatch.setattr(bench, "SPECTRUM_STEPS", 16)
    if gpu is not None:
        monkeypatch.setattr(bench, "cuda", gpu)
    few = ["--robots", "40", "--steps", "8", "--double", "40", "--lanes", "40", "--mjx"]
    assert bench.main([*few, "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    rows = json.loads((tmp_path / "gpu.json").read_text())["rows"]
    assert len(rows) == 20  # of four batches
    assert "cuda   float64         40 robots,   8 steps, closed, logged : " in printed
    assert (tmp_path / "table.md").read_text() == f"```text\n{printed}```\n"
    if gpu is not None:
        assert rows[-1]["kernel seconds"] == 2.0
    robots = Scenario.create(random_trials(20).morphologies)
    logs = [bench.closed_loop(kind(robots))(8, 3) for kind in (engine.CudaBatch, LaneBatch)]
    for one, other in zip(*logs, strict=True):
        np.testing.assert_array_equal(one, other)
    assert np.ptp(logs[0][0][:, :, 1:], axis=2).min() > 0.0  # written in each step


def test_a_missing_package_driver_or_gpu_is_one_sentence(monkeypatch: Any) -> None:
    check = packages.check_gpu.__wrapped__
    monkeypatch.setattr(packages, "find_spec", lambda _: None)
    with pytest.raises(EngineUnavailableError, match=r'pip install "aquafish-gym\[gpu\]", or use'):
        check()
    monkeypatch.undo()

    class NoDriver:
        def __len__(self) -> int:
            raise ImportError("\nError at driver init: \n\nlibcuda is not found.\n:")

    for gpus, said in (
        (NoDriver(), r"driver of an NVIDIA GPU, which does not load \(Error at .* not found.\)"),
        ([], "needs an NVIDIA GPU, and the driver finds none"),
    ):
        monkeypatch.setattr(engine.cuda, "gpus", gpus)
        with pytest.raises(EngineUnavailableError, match=said):
            check()


def instructions(kernel: Any, arguments: Any, monkeypatch: Any) -> Counter[str]:
    """Return how many of each instruction a kernel has that is compiled for some arguments."""
    from numba import cuda, void
    from numba.cuda import dispatcher

    chip = SimpleNamespace(compute_capability=(9, 0))
    monkeypatch.setattr(dispatcher, "get_current_device", lambda: chip)
    kinds = [typeof(plainly(argument)) for argument in arguments]
    code, _ = cuda.compile(
        kernel.py_func, void(*kinds), device=False, abi="numba", cc=chip.compute_capability
    )
    return Counter(re.findall(r"^\s+(?:@\S+ )?([a-z][\w.]*)\s", code, re.MULTILINE))


@pytest.mark.parametrize("loops", ["open", pytest.param("closed", marks=pytest.mark.slow)])
@pytest.mark.slow  # it compiles eight kernels that no other test has
def test_kernels_compile_without_a_driver_and_round_each_operation(
    loops: str, monkeypatch: Any
) -> None:
    """No instruction may be fused that is not fused in the lanes; nothing is called or spilled."""
    original, stand_in = engine.loop_kernel, StandIn()
    made = []

    def noted(*how: Any) -> Any:
        made.append(how)
        return stand_in.loop_kernel(*how)

    with monkeypatch.context() as patched:
        patched.setattr(engine, "loop_kernel", noted)
        patched.setattr(engine, "cuda", stand_in)
        patched.setattr(packages, "check_gpu", lambda: None)
        found = {}
        for dtype in ("float32", "float64"):
            if loops == "open":
                simulate(None, (0.1, 0.1, 0.1), steps=4, engine="cuda", dtype=dtype)
            else:
                scores([make_controller(0)], None, seconds=0.1, engine="cuda", dtype=dtype)
            found[dtype] = stand_in.last
    counts = {
        key: instructions(original(*how), arguments, monkeypatch)
        for (key, arguments), how in zip(found.items(), made, strict=True)
    }
    for dtype, count in counts.items():
        kind = dtype.replace("float", "f")
        assert count[f"fma.rn.{kind}"] > 300
        assert count[f"sqrt.rn.{kind}"] >= 19
        # All that a thread computes of its robot is rounded where it stands, ...
        if kind == "f32":
            fusable = [count[f"{name}.f32"] for name in ("add", "sub", "mul")]
            assert fusable == [0, 0, 0]
            assert count["fma.rn.f64"] == 0
        assert not [name for name in count if name.startswith(("call", "ld.local", "st.local"))]
    # ... also in double precision, where the loop's own clock has such instructions.
    assert counts["float32"]["fma.rn.f32"] == counts["float64"]["fma.rn.f64"]
