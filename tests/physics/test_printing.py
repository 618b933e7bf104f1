"""The printed JavaScript and C swim as plain Python and the lanes do; C to the bit."""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from numpy.typing import NDArray

from aquafish_gym.code_generation import robot_code
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.physics.arithmetic import Number, floor, fma, square_root, where_less
from aquafish_gym.physics.layout import layout, state_of
from aquafish_gym.physics.printing import C99, JAVASCRIPT, printed, trace
from aquafish_gym.plans import AQUAFISH, BodyPlan
from aquafish_gym.scenario import Scenario
from aquafish_gym.sense import observe
from tests.plans import COMPILED_PLANS, plans

CC, NODE = shutil.which("cc"), shutil.which("node")
robot = robot_code()
NAMES = [function.__name__ for function in robot.functions]
Array = NDArray[np.float64]
# Calls a function for each robot some times: (the arrays by parameter, (B, n) each, times).
Caller = Callable[[dict[str, Array], int], None]

C_LOOP = """
void loop(int robots, int times, double **arrays, const int *sizes)
{
    for (int i = 0; i < robots; i++)
        for (int t = 0; t < times; t++)
            fish_NAME(ARGUMENTS);
}
"""
JAVASCRIPT_LOOP = """
const fs = require("fs");
const file = process.argv[2];
const {robots, times, sizes} = JSON.parse(process.argv[3]);
const bytes = fs.readFileSync(file);
const numbers = new Float64Array(bytes.buffer, bytes.byteOffset, bytes.length / 8);
let first = 0;
const arrays = sizes.map((size) => {
    const table = numbers.subarray(first, first + robots * size);
    first += robots * size;
    return table;
});
for (let i = 0; i < robots; i++) {
    const own = arrays.map((table, k) => table.subarray(i * sizes[k], (i + 1) * sizes[k]));
    for (let t = 0; t < times; t++)
        NAME(...own);
}
fs.writeFileSync(file, numbers);
"""


def function_of(plan: BodyPlan, name: str) -> Callable[..., None]:
    function: Callable[..., None] = getattr(robot_code(plan), name)
    return function


def in_python(name: str, _folder: Path, plan: BodyPlan = AQUAFISH) -> Caller:
    function = function_of(plan, name)

    def call(arrays: dict[str, Array], times: int) -> None:
        lists = {key: table.tolist() for key, table in arrays.items()}
        for rows in zip(*lists.values(), strict=True):
            for _ in range(times):
                function(*rows)
        for key, table in arrays.items():
            table[:] = lists[key]

    return call


def in_c(name: str, folder: Path, plan: BodyPlan = AQUAFISH) -> Caller:
    if CC is None:
        pytest.skip("there is no C compiler, cc")
    code_of, function = robot_code(plan), function_of(plan, name)
    sizes = code_of.functions[function]
    arguments = ", ".join(f"arrays[{k}] + i * sizes[{k}]" for k in range(len(sizes)))
    loop = C_LOOP.replace("NAME", name).replace("ARGUMENTS", arguments)
    stem = f"{name}_{hash(plan)}"
    code, library = folder / f"{stem}.c", folder / f"{stem}.so"
    code.write_text("#include <math.h>\n" + code_of.source(C99, function, prefix="fish_") + loop)
    warnings = ("-Wall", "-Wextra", "-Wconversion", "-Werror", "-pedantic")
    flags = ("-std=c99", "-O1", "-ffp-contract=off", "-fPIC", "-shared")
    if not library.exists():
        subprocess.run([CC, *warnings, *flags, code, "-lm", "-o", library], check=True)

    def call(arrays: dict[str, Array], times: int) -> None:
        pointers = [table.ctypes.data for table in arrays.values()]
        ctypes.CDLL(str(library)).loop(
            len(next(iter(arrays.values()))), times, (ctypes.c_void_p * len(sizes))(*pointers),
            (ctypes.c_int * len(sizes))(*sizes.values()),
        )  # fmt: skip

    return call


def in_javascript(name: str, folder: Path, plan: BodyPlan = AQUAFISH) -> Caller:
    if NODE is None:
        pytest.skip("there is no JavaScript engine, node")
    code_of, function = robot_code(plan), function_of(plan, name)
    sizes = code_of.functions[function]
    code, file = folder / f"{name}.js", folder / "numbers"
    code.write_text(code_of.javascript(function) + JAVASCRIPT_LOOP.replace("NAME", name))

    def call(arrays: dict[str, Array], times: int) -> None:
        file.write_bytes(b"".join(table.tobytes() for table in arrays.values()))
        robots = len(next(iter(arrays.values())))
        asked = f'{{"robots": {robots}, "times": {times}, "sizes": {list(sizes.values())}}}'
        subprocess.run([NODE, code, file, asked], check=True)
        numbers = np.fromfile(file)
        for table in arrays.values():
            table.ravel()[:], numbers = np.split(numbers, [table.size])[0], numbers[table.size :]

    return call


LANGUAGES = {"c": in_c, "javascript": in_javascript}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder that keeps what is compiled."""
    return tmp_path_factory.mktemp("printed")


def random_arrays(name: str, count: int, plan: BodyPlan = AQUAFISH) -> dict[str, Array]:
    """Return the arrays of a function for random robots in any motion."""
    rng = np.random.default_rng(0)
    fins, rows = len(plan.fins), layout(plan).state_numbers
    bodies = rng.uniform(0, plan.maxima, (count, 3 * fins)) * (rng.random((count, 3 * fins)) < 0.9)
    drag, density = rng.uniform(0.2, 2.0, (count, 2)), rng.uniform(0.5, 2.0, (count, 1))
    states = layout(plan).start(
        rng.uniform(-np.pi, np.pi, (count, fins)), rng.normal(0, 2, (count, 3)),
        rng.normal(0, 3, (count, 3)), rng.normal(0, 3, (count, fins)),
    ).T[:, :rows]  # fmt: skip
    turned = rng.normal(size=(count, 4))
    states[:, :4] = turned / np.linalg.norm(turned, axis=1, keepdims=True)
    states[:, 4:7] = rng.normal(0, 10, (count, 3))
    found = {
        "sizes": bodies,
        "density": density,
        "drag": drag,
        "fin_angles": rng.uniform(-7, 7, (count, fins)),
        "state": states,
        "robot": layout(plan).robots(bodies, drag, density[:, 0]).T,
        "current": rng.normal(0, 0.3, (count, 3)),
        "command": rng.uniform(plan.command_low, plan.command_high, (count, fins)),
        "goal": rng.normal(0, 60, (count, 3)),
        "observation": np.zeros((count, 12)),
    }
    return {key: found[key].copy() for key in robot_code(plan).functions[function_of(plan, name)]}


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("plan", COMPILED_PLANS)
def test_a_call_is_plain_pythons(plan: BodyPlan, name: str, language: str, folder: Path) -> None:
    """For 200 random bodies, states and commands."""
    assert_calls_agree(plan, name, language, folder, 200)


def assert_calls_agree(
    plan: BodyPlan, name: str, language: str, folder: Path, count: int, times: int = 1
) -> None:
    """Check calls against plain Python's: C to the bit, JavaScript to 1e-12."""
    arrays, expected = (random_arrays(name, count, plan) for _ in range(2))
    in_python(name, folder, plan)(expected, times)
    LANGUAGES[language](name, folder, plan)(arrays, times)
    for key, table in arrays.items():
        if language == "c":
            np.testing.assert_array_equal(table, expected[key])
        else:
            np.testing.assert_allclose(table, expected[key], rtol=1e-12, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("name", ["step", "step_reactive"])
@settings(deadline=None, max_examples=12, suppress_health_check=[HealthCheck.too_slow])
@given(plan=plans())
def test_steps_of_random_plans_are_plain_pythons(
    name: str, language: str, folder: Path, plan: BodyPlan
) -> None:
    assert_calls_agree(plan, name, language, folder, 5, 10)


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize(("name", "count"), [("step", 200), ("step_reactive", 30)])
def test_twenty_seconds_are_the_lanes(name: str, count: int, language: str, folder: Path) -> None:
    """Of random robots. Float64 lanes are plain Python to the bit, as ``tests/engines`` shows."""
    arrays, rows = random_arrays(name, count), random_arrays("robot_rows", count)
    angles = random_arrays("start", count)["fin_angles"]
    arrays["state"] = layout(AQUAFISH).start(angles).T[:, : layout(AQUAFISH).state_numbers].copy()
    scenario = Scenario.create(
        rows["sizes"], drag=rows["drag"], fin_density=rows["density"][:, 0],
        current=arrays["current"], fin_angles=angles, reactive=name == "step_reactive",
    )  # fmt: skip
    lanes = LaneBatch(scenario, np.float64)
    lanes.advance(arrays["command"], 2000)
    LANGUAGES[language](name, folder)(arrays, 2000)
    expected = lanes.states[: layout(AQUAFISH).state_numbers].T
    if language == "c":
        np.testing.assert_array_equal(arrays["state"], expected)
    else:
        np.testing.assert_allclose(arrays["state"], expected, rtol=0, atol=1e-12)


def test_senses_are_those_of_an_observation() -> None:
    arrays = random_arrays("sense", 100)
    for state, goal, seen in zip(*(table.tolist() for table in arrays.values()), strict=True):
        robot.sense(state, goal, seen)
        expected = observe(state_of(state), goal=tuple(goal))
        np.testing.assert_array_equal(np.array(seen, np.float32), expected)


def test_a_start_is_that_of_a_trial() -> None:
    begin = [math.nan] * layout(AQUAFISH).state_numbers
    robot.start([0.5, -1.0, 9.0], begin)
    expected = layout(AQUAFISH).start(np.array([[0.5, -1.0, 9.0]]))[
        : layout(AQUAFISH).state_numbers, 0
    ]
    np.testing.assert_allclose(begin, expected, rtol=0, atol=1e-15)


def test_every_primitive_is_printed() -> None:
    """Equal operations once, constants computed; nothing unused, nor idle by a 0 or a 1."""

    def function(a: list[Number], b: list[Number]) -> None:
        unused = a[0] / a[1]
        assert unused is not a[0]
        once = fma(2, a[0], 0.5 * 3)
        again = fma(2, a[0], 0.5 * 3)
        b[0] = where_less(once, again, floor(a[1]), -1)
        b[1] = square_root(abs(-a[0]))
        b[2] = fma(1.0, 0.0 + a[0], 0.0 * a[1]) + 1 / a[1]

    traced = trace(function, a=2, b=3)
    assert printed("f", traced, C99) == (
        "void f(const double a[2], double b[3])\n{\n"
        "    const double a_0 = a[0];\n"
        "    const double a_1 = a[1];\n"
        "    const double t2 = fma(2.0, a_0, 1.5);\n"
        "    const double t3 = floor(a_1);\n"
        "    const double t4 = t2 < t2 ? t3 : (-1.0);\n"
        "    const double t5 = -a_0;\n"
        "    const double t6 = fabs(t5);\n"
        "    const double t7 = sqrt(t6);\n"
        "    const double t8 = 1.0 / a_1;\n"
        "    const double t9 = a_0 + t8;\n"
        "    b[0] = t4;\n"
        "    b[1] = t7;\n"
        "    b[2] = t9;\n"
        "}\n"
    )
    assert "const t2 = 2.0 * a_0 + 1.5;\n" in printed("f", traced, JAVASCRIPT)
    assert traced.operations.total() == 8


def test_what_is_read_may_be_written() -> None:
    """A swap reads both entries first."""

    def swap(a: list[Number]) -> None:
        a[0], a[1] = a[1], a[0]

    assert printed("swap", trace(swap, a=2), JAVASCRIPT) == (
        "function swap(a) {\n    const a_0 = a[0];\n    const a_1 = a[1];\n"
        "    a[0] = a_1;\n    a[1] = a_0;\n}\n"
    )


def test_a_branch_on_a_symbol_is_refused() -> None:
    with pytest.raises(TypeError, match="choose by where_less"):
        trace(lambda a: a[0] if a[0] < 1.0 else None, a=1)


@pytest.mark.parametrize("wrong", [None, "1", np.zeros(2)])
def test_a_symbol_and_no_number_are_refused(wrong: object) -> None:
    with pytest.raises(TypeError, match="takes symbols and numbers"):
        trace(lambda a: a[0] * wrong, a=1)
    with pytest.raises(TypeError):
        trace(lambda a: fma(a[0], 1.0, wrong), a=1)


def test_sizes_of_other_parameters_are_refused() -> None:
    with pytest.raises(TypeError, match=r"must be those of \['state', .*got \['state'\]"):
        trace(robot.step, state=22)
