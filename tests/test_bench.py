"""The benchmark command: rows take turns, ratios are of this run, mistakes are told in a line."""

from __future__ import annotations

import functools
import importlib
import io
import json
import pathlib
import platform
import re
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from aquafish_gym.engines.base import simulate
from aquafish_gym.engines.packages import load_pybullet
from tests.benchmarks import replicate, starting
from tests.benchmarks.__main__ import Bench, main
from tests.benchmarks.gait import NO_LEARNING
from tests.benchmarks.measure import Timing, measure
from tests.benchmarks.report import format_count, format_time, make_records, make_table
from tests.benchmarks.rows import GROUPS, NO_MUJOCO, Group, Row, Settings, load_provider

TINY = Settings(robots=17, steps=4, seed=0, cores=2, quick=True)
NEEDS = {"mujoco": "mujoco", "learning": "stable_baselines3"}


def command_line(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "tests.benchmarks", *arguments],
        capture_output=True,
        text=True,
        cwd=pathlib.Path(__file__).parents[1],
    )


def make_row(name: str, call: Callable[[], object] = lambda: None, **fields: Any) -> Row:
    return Row(name, "numba", "float32", 1, 1, 10.0, call, **fields)


@pytest.fixture
def new_processes_do_little(monkeypatch: pytest.MonkeyPatch) -> None:
    """They would compile for seconds."""
    monkeypatch.setattr(
        starting, "_FIRST_RESULT", "import os; assert os.environ['NUMBA_CACHE_DIR']"
    )


@pytest.fixture
def without(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Let a package look as if it were not installed."""

    def hide(package: str) -> None:
        monkeypatch.setitem(sys.modules, package, None)
        if package == "pybullet":
            fresh = functools.cache(load_pybullet.__wrapped__)
            monkeypatch.setattr("tests.benchmarks.rows.load_pybullet", fresh)

    return hide


def test_ratios_are_taken_in_the_run_and_survive_json(tmp_path: pathlib.Path) -> None:
    pytest.importorskip("pybullet")
    out = tmp_path / "bench.json"
    done = command_line("--quick", "--robots", "32", "--steps", "8", "--turns", "1",
                        "--only", "physics", "bodies", "--out", str(out))  # fmt: skip
    assert done.returncode == 0, done.stderr
    text = out.read_text()
    document = json.loads(text)
    assert document.keys() == {"config", "machine", "notes", "rows"}
    wanted = {"robots": 32, "steps": 8, "turns": 1, "seed": 0, "groups": ["physics", "bodies"]}
    assert wanted.items() <= document["config"].items()
    assert document["machine"]["lanes"]["float32"] * 32 >= document["machine"]["vector_bits"]
    assert document["machine"]["versions"]["numpy"] == np.__version__
    assert platform.node() not in text
    rows = document["rows"]
    assert [r["number"] for r in rows] == list(range(1, len(rows) + 1))
    assert rows[0]["engine"] == "pybullet"
    assert rows[0]["ratio"] is None
    assert {r["dtype"] for r in rows if r["engine"] == "numba"} == {"float32", "float64"}
    compared = [r for r in rows if r["ratio_to"] is not None]
    assert len(compared) >= 8
    for r in compared:
        reference = rows[r["ratio_to"] - 1]
        assert reference["group"] == r["group"]
        assert r["ratio"] == pytest.approx(r["rate"] / reference["rate"])
    for r in compared:
        if r["group"] == "physics":
            reference = rows[r["ratio_to"] - 1]
            assert reference["threads"] == 1
            assert reference["engine"] == ("pybullet" if r["threads"] == 1 else "numba")
    assert "best of 1 turn," in done.stdout
    assert re.search(r" \d[\d.,]* x #1 *\n", done.stdout)
    assert max(map(len, done.stdout.splitlines())) <= 80


@pytest.mark.usefixtures("new_processes_do_little")
# A kernel for each width takes a minute to compile.
@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=pytest.mark.slow) if n == "widths" else n for n in GROUPS],
)
def test_every_group_runs(name: str) -> None:
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    with ExitStack() as cleanup:
        group = load_provider(name)(TINY, cleanup)
        ticks: list[None] = []
        timings = measure(group, turns=1, least_seconds=0, tick=lambda: ticks.append(None))
    assert [t.row for t in timings] == group.rows
    assert len(ticks) == 2 * len(group.rows)
    records = make_records(name, group, timings)
    assert all(r["rate"] > 0 for r in records)
    assert any(r["ratio"] for r in records)
    lines = [(r["what"], r["engine"], r["dtype"], r["batch"], r["threads"]) for r in records]
    assert len(set(lines)) == len(lines)


def test_one_core_has_no_row_of_all_cores() -> None:
    settings = Settings(robots=20, steps=2, seed=0, cores=1, quick=True)
    for name in ("physics", "neat", "environments"):
        with ExitStack() as cleanup:
            assert {r.threads for r in load_provider(name)(settings, cleanup).rows} == {1}


def test_a_row_swims_as_many_robots_as_it_says() -> None:
    """Also where a batch is smaller than another row's."""
    with ExitStack() as cleanup:
        rows = load_provider("physics")(TINY, cleanup).rows
    logged = [row for row in rows if row.what != "our law, no log"]
    assert {len(row.call()) == row.batch for row in logged} == {True}  # type: ignore[arg-type]
    assert {row.batch for row in rows if row.engine == "numba"} == {1, 16, 17}
    assert {row.amount / row.batch for row in rows} == {TINY.steps}


def test_rows_take_turns() -> None:
    calls: list[str] = []
    first = make_row("a", lambda: calls.append("a"))
    other = make_row("b", lambda: calls.append("b"), most_turns=1)
    elsewhere = make_row("c", lambda: calls.append("c") or 2.0, own_clock=True)
    timings = measure(Group("", "", [first, other, elsewhere]), turns=2, least_seconds=0)
    assert "".join(calls) == "aabb" + "abc" + "ac"
    assert [len(t.seconds) for t in timings] == [2, 1, 2]
    assert timings[2].seconds == (2.0, 2.0)


def test_a_short_call_is_repeated(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[None] = []
    monkeypatch.setattr("time.perf_counter", lambda: 0.25 * len(calls))
    row = make_row("a", lambda: calls.append(None))
    (timing,) = measure(Group("", "", [row]), turns=3, least_seconds=1.0)
    assert len(calls) == 2 + 3 * 4
    assert timing.seconds == (0.25,) * 3


def test_the_best_turn_counts_unless_the_typical_one_is_asked_for() -> None:
    best = Timing(make_row("a"), (2.0, 1.0, 5.0))
    assert (best.rate, best.median_rate) == (10.0, 5.0)
    typical = Timing(make_row("b", typical=True), (2.0, 1.0, 5.0))
    assert (typical.rate, typical.median_rate) == (5.0, 5.0)


def test_a_ratio_is_how_many_times_as_fast() -> None:
    slow = make_row("slow")
    fast = make_row("fast", against=slow)
    timings = [Timing(slow, (4.0, 8.0, 9.0)), Timing(fast, (1.0, 4.0, 5.0))]
    records = make_records("g", Group("", "", [slow, fast]), timings, first=7)
    found = [(r["number"], r["ratio"], r["median_ratio"], r["ratio_to"]) for r in records]
    assert found == [(7, None, None, None), (8, 4.0, 2.0, 7)]


def test_a_share_is_of_the_time() -> None:
    whole = make_row("whole")
    part = make_row("part", against=whole, share=True)
    timings = [Timing(whole, (4.0, 8.0, 9.0)), Timing(part, (1.0, 4.0, 5.0))]
    group = Group("", "", [whole, part])
    records = make_records("g", group, timings)
    assert [(r["ratio"], r["median_ratio"]) for r in records] == [(None, None), (0.25, 0.5)]
    console = Console(width=80, file=io.StringIO())
    console.print(make_table("", {"g": group}, records))
    assert "25.0% of #1" in console.file.getvalue()  # type: ignore[attr-defined]


def test_a_stopwatch_gives_each_moment_to_the_innermost_part(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = 10.0
    monkeypatch.setattr("time.perf_counter", lambda: now)

    def wait(seconds: float) -> None:
        nonlocal now
        now += seconds

    def fail() -> None:
        wait(16.0)
        raise ArithmeticError

    watch = replicate.Stopwatch()
    inner = watch.timed("Eq. 1", wait)

    def outer(seconds: float) -> str:
        wait(seconds)
        inner(4.0)
        wait(seconds)
        return "done"

    wait(1.0)
    assert watch.timed("GA", outer)(2.0) == "done"
    with pytest.raises(ArithmeticError):
        watch.timed("Eq. 2", fail)()
    wait(32.0)
    assert watch.stop() == 57.0
    spent = {part: seconds for part, seconds in watch.seconds.items() if seconds}
    assert spent == {"Eq. 2": 16.0, "Eq. 1": 4.0, "GA": 4.0, replicate.REST: 33.0}


def test_what_is_timed_is_put_back() -> None:
    places = [place for found in replicate.PARTS.values() for place in found]
    before = [vars(owner)[name] for owner, name in places]

    def in_place() -> set[bool]:
        return {vars(o)[n] is old for (o, n), old in zip(places, before, strict=True)}

    def break_off() -> None:
        with replicate.taken_apart():
            assert in_place() == {False}
            raise ArithmeticError

    with pytest.raises(ArithmeticError):
        break_off()
    assert in_place() == {True}


def test_a_replicates_parts_are_its_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """And every function that a part is made of does run in it."""
    called: set[str] = set()

    def noted(key: str, function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def call(*args: Any, **kwargs: Any) -> Any:
            called.add(key)
            return function(*args, **kwargs)

        return call

    places = [place for found in replicate.PARTS.values() for place in found]
    keys = {f"{owner.__name__}.{name}": (owner, name) for owner, name in places}
    with ExitStack() as cleanup:
        group = load_provider("replicate")(TINY, cleanup)
        for key, (owner, name) in keys.items():
            monkeypatch.setattr(owner, name, noted(key, vars(owner)[name]))
        whole, *parts = group.rows[: len(replicate.PARTS) + 2]
        timings = measure(Group("", "", [whole, *parts]), turns=2)
    assert called == keys.keys()
    assert not whole.share
    assert all(part.share and part.against is whole for part in parts)
    records = make_records("replicate", group, timings)
    assert {r["turns"] for r in records} == {1}
    assert sum(r["ratio"] for r in records[1:]) == pytest.approx(1.0)


def test_the_table_fits_80_columns_and_drops_nothing() -> None:
    slow = Row("neat-python's network", "pybullet", "float64", 1, 1, 1.0, lambda: None)
    fast = Row("256 robots, 12 nodes", "pybullet", "float64", 40960, 128, 1.0, lambda: None, slow)
    groups = {"g": Group("256 bodies: robot-steps", "body", [slow, fast])}
    timings = [Timing(slow, (1.0,)), Timing(fast, (1 / 123_456,))]
    console = Console(width=80, file=io.StringIO())
    console.print(make_table("", groups, make_records("g", groups["g"], timings, first=44)))
    said = console.file.getvalue()  # type: ignore[attr-defined]
    lines = [line.split() for line in said.splitlines()]
    first = ["44", "neat-python's", "network", "pybullet", "float64", "1", "1", "1.00/s", "-"]
    assert first in lines
    wanted = "45 256 robots, 12 nodes pybullet float64 40960 128 123 k/s 123 k x #44"
    assert wanted.split() in lines


def test_without_mujoco_a_sentence_says_how_to_get_it(
    without: Callable[[str], None], capsys: pytest.CaptureFixture[str]
) -> None:
    without("mujoco")
    Bench(
        robots=16, steps=2, turns=1, quick=True, only=("bodies", "mujoco", "environments")
    ).execute()
    said = capsys.readouterr().out
    assert said.count(NO_MUJOCO + "\n") == 1
    assert "Swimmer" not in said
    assert "rollout" not in said
    assert said.count("our law, pose") >= 2


@pytest.mark.parametrize("name", ["physics", "bodies", "environments", "neat"])
def test_without_pybullet_the_other_rows_stay(name: str, without: Callable[[str], None]) -> None:
    without("pybullet")
    with ExitStack() as cleanup:
        group = load_provider(name)(TINY, cleanup)
    assert {r.engine for r in group.rows} <= {"numba", "mujoco"}
    assert any("pip install pybullet" in note for note in group.notes)
    assert all(r.against is None or r.against in group.rows for r in group.rows)


def test_without_stable_baselines_a_sentence_says_how_to_get_it(
    without: Callable[[str], None],
) -> None:
    without("stable_baselines3.common.vec_env")
    with ExitStack() as cleanup:
        group = load_provider("learning")(TINY, cleanup)
    assert (group.rows, group.notes) == ([], [NO_LEARNING])


def test_the_usual_way_to_score_neat_is_the_same_swim() -> None:
    """It would be no comparison if its robot heard or did something else."""
    pytest.importorskip("pybullet")
    from aquafish_gym.engines.bullet.world import BulletWorld
    from aquafish_gym.morphology import Morphology
    from gait.evolve import EvolveConfig
    from gait.rollout import swim
    from gait.search.neat import Evolution, genome_to_controller
    from tests.benchmarks.gait import swim_as_usual

    body = Morphology.nominal()
    world = BulletWorld()
    genomes = Evolution(10, seed=3).ask()[:3]
    found = [swim_as_usual(world, genome, body, steps=203) for genome in genomes]
    world.close()
    controllers = [genome_to_controller(g, EvolveConfig.clock, body, 0) for g in genomes]
    wanted = [swim(c, body, seconds=2.03).distance for c in controllers]
    assert min(map(abs, wanted)) > 0.01
    assert found == pytest.approx(wanted, abs=1e-6)


def test_mujoco_turns_the_same_fins_of_different_bodies() -> None:
    """It would be no comparison if its servos did not follow, or if it had given up."""
    pytest.importorskip("mujoco")
    from aquafish_gym.physics.kinematics import SWEEP
    from tests.benchmarks.mujoco_rollout import Rollout
    from tests.benchmarks.rows import random_trials

    trials = random_trials(40, seed=1)
    log = simulate(trials.morphologies, trials.commands, trials.fin_angles, steps=200,
                   dtype="float64", record="pose")  # fmt: skip
    assert log.fin_angles is not None
    with ExitStack() as cleanup:
        work = Rollout(trials, 200, 1.0, 1, cleanup)
        states = work.run()
        dry = Rollout(trials, 200, 0.0, 1, cleanup).run()
    assert work.broken_off == 0
    assert states.shape == (40, 200, 20)
    away = states[:, :, 8:10] - log.fin_angles[:, :, :2]
    assert abs(np.sin(away / 2)).max() < 1e-4
    assert abs(states[:, :, 10] - SWEEP * np.sin(log.fin_angles[:, :, 2])).max() < 1e-4
    assert len(np.unique(states[:, -1, 1])) == 40
    assert abs(states[:, -1, 1:4] - dry[:, -1, 1:4]).max() > 0.01  # there is water


@pytest.mark.parametrize(
    ("value", "text"),
    [(25_006_037, "25.0 M"), (1_234_567, "1.23 M"), (29_047.4, "29.0 k"), (7_823, "7,823"),
     (860.9, "861"), (12.34, "12.3"), (0.987, "0.99")],
)  # fmt: skip
def test_counts_keep_three_digits(value: float, text: str) -> None:
    assert format_count(value) == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(6.312, "6.31 s"), (0.442, "442 ms"), (9.69e-4, "969 us"), (1.3e-7, "0.13 us")],
)
def test_times_have_a_unit_that_fits(seconds: float, text: str) -> None:
    assert format_time(seconds) == text


@pytest.mark.parametrize(
    ("program", "first"),
    [("benchmarks",
      "Time engines, bodies, gaits, environments and new processes, and print one table."),
     ("verification",
      "Compare the simulator with its oracles and print what was found.")],
)  # fmt: skip
def test_help_says_what_it_does(
    program: str, first: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert importlib.import_module(f"tests.{program}.__main__").main(["--help"]) == 0
    said = capsys.readouterr().out
    assert " ".join(said.split("\n\n")[1].split()) == first


def test_help_names_every_group(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help-verbose"]) == 0
    said = capsys.readouterr().out
    assert all(name in said for name in GROUPS)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--turns", "0"), "turns must be a whole number of at least 1; got 0"),
        (("--robots", "0"), "robots must be a whole number of at least 1; got 0"),
        (("--seed", "-1"), "seed must be a whole number of at least 0; got -1"),
        (("--out", "tests"), "out must be a file; tests is a directory"),
        (
            ("--only", "physics", "bodys"),
            f"only must be one of {', '.join(GROUPS)}; got 'bodys'; did you mean 'bodies'?",
        ),
    ],
)
def test_a_mistake_is_one_line(
    arguments: tuple[str, ...],
    sentence: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(pathlib.Path(__file__).parents[1])
    assert main(arguments) == 2
    assert capsys.readouterr().err.splitlines() == [f"tests.benchmarks: {sentence}"]
