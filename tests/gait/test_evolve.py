"""A run of evolution: its files, its interruptions, its refusals."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.folder import SETTINGS
from aquafish_gym.runs.storage import DamagedFileError, read_document, write_document
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.controller import Controller
from gait.evolve import EvolveConfig, evolve_gait
from gait.fitness import DIVERGED_SPEED
from gait.records import (
    CHECKPOINT_FILE,
    CHECKPOINT_SCHEMA,
    CONTROLLER_FILE,
    FILES,
    HISTORY_FILE,
    Generation,
)
from gait.rollout import SECONDS, random_poses, stream
from gait_fakes import WeightScorer, contents, read_history

PLAIN: dict[str, Any] = {"starts": 1, "polish": 0}  # NEAT alone, so that rows are generations
CONFIG = EvolveConfig(seed=1000, generations=6, population=20, poses=2, **PLAIN)


def test_files_say_what_the_result_says(tmp_path: Path) -> None:
    seen: list[Generation] = []
    result = evolve_gait(
        None, CONFIG, out=tmp_path, scorer=WeightScorer(), on_generation=seen.append
    )
    assert set(contents(tmp_path)) == {*FILES, SETTINGS}
    assert read_history(tmp_path / HISTORY_FILE) == result.history == tuple(seen)
    assert Controller.load(tmp_path / CONTROLLER_FILE).to_dict() == result.controller.to_dict()
    assert result.controller.morphology == Morphology.nominal()
    assert result.controller.seed == 1000
    assert [row.generation for row in seen] == list(range(6))
    assert result.fitness == max(row.final for row in seen)


def test_poses_are_other_ones_every_generation_and_the_finals_are_always_the_same() -> None:
    class Noting(WeightScorer):
        seen: list[NDArray[np.float64]] = []  # noqa: RUF012

        def __call__(
            self,
            controllers: Sequence[Controller],
            bodies: NDArray[np.float64],
            fin_angles: NDArray[np.float64],
        ) -> NDArray[np.float64]:
            self.seen.append(fin_angles)
            return super().__call__(controllers, bodies, fin_angles)

    evolve_gait(None, CONFIG, scorer=Noting())
    trials, finals = Noting.seen[:-1:2], Noting.seen[1::2]
    assert Noting.seen[-1].tobytes() == finals[0].tobytes()  # the result's distances
    assert all((poses[0] == 0.0).all() for poses in Noting.seen)
    assert {len(poses) for poses in trials} == {3}
    assert len({poses.tobytes() for poses in trials}) == len(trials) == 6
    assert len({poses.tobytes() for poses in finals}) == 1


def test_without_random_poses_the_finals_change_nothing() -> None:
    config = EvolveConfig(seed=1000, generations=4, population=20, poses=0, **PLAIN)
    for row in evolve_gait(None, config, scorer=WeightScorer()).history:
        assert row.final == row.distance == row.best


def test_same_seed_same_files_and_another_seed_another_run(tmp_path: Path) -> None:
    for name in ("a", "b"):
        evolve_gait(None, CONFIG, out=tmp_path / name, scorer=WeightScorer())
    assert contents(tmp_path / "a") == contents(tmp_path / "b")
    other = evolve_gait(
        None, EvolveConfig(seed=1001, generations=6, population=20, **PLAIN), scorer=WeightScorer()
    )
    assert other.history != read_history(tmp_path / "a" / HISTORY_FILE)


@pytest.mark.parametrize("at", [2, 4, 6])
def test_an_interrupted_run_ends_in_the_same_files(tmp_path: Path, at: int) -> None:
    evolve_gait(None, CONFIG, out=tmp_path / "straight", scorer=WeightScorer())
    with pytest.raises(KeyboardInterrupt):
        evolve_gait(None, CONFIG, out=tmp_path / "stopped", scorer=WeightScorer(2 * at - 1))
    # What is there reads well, and holds every generation that was finished.
    assert len(read_history(tmp_path / "stopped" / HISTORY_FILE)) == at - 1
    Controller.load(tmp_path / "stopped" / CONTROLLER_FILE)
    seen: list[Generation] = []
    scorer = WeightScorer()
    evolve_gait(None, CONFIG, out=tmp_path / "stopped", scorer=scorer, on_generation=seen.append)
    assert scorer.calls == 2 * (6 - (at - 1)) + 1
    assert len(seen) == 6
    assert contents(tmp_path / "stopped") == contents(tmp_path / "straight")


def test_a_run_may_be_prolonged(tmp_path: Path) -> None:
    short = EvolveConfig(seed=1000, generations=3, population=20, poses=2, threads=1, **PLAIN)
    evolve_gait(None, short, out=tmp_path / "grown", scorer=WeightScorer())
    grown = evolve_gait(None, CONFIG, out=tmp_path / "grown", scorer=WeightScorer())
    assert grown.history == evolve_gait(None, CONFIG, scorer=WeightScorer()).history


def test_files_behind_the_checkpoint_are_brought_up_to_date(tmp_path: Path) -> None:
    evolve_gait(None, CONFIG, out=tmp_path, scorer=WeightScorer())
    before = contents(tmp_path)
    (tmp_path / HISTORY_FILE).write_text("torn")
    (tmp_path / CONTROLLER_FILE).unlink()
    evolve_gait(None, CONFIG, out=tmp_path, scorer=WeightScorer())
    assert contents(tmp_path) == before


def test_a_diverged_robot_is_the_worst_and_does_not_spread_nan() -> None:
    class Diverging(WeightScorer):
        def __call__(
            self,
            controllers: Sequence[Controller],
            bodies: NDArray[np.float64],
            fin_angles: NDArray[np.float64],
        ) -> NDArray[np.float64]:
            distances = super().__call__(controllers, bodies, fin_angles)
            distances[::3, 0] = np.nan
            distances[1::3, 0] = np.inf
            return distances

    result = evolve_gait(
        None, EvolveConfig(generations=3, population=20, **PLAIN), scorer=Diverging()
    )
    assert np.isfinite([row.mean for row in result.history]).all()
    assert result.fitness > DIVERGED_SPEED * SECONDS / 2


def test_another_run_in_the_directory_is_refused(tmp_path: Path) -> None:
    evolve_gait(None, CONFIG, out=tmp_path, scorer=WeightScorer())
    before = contents(tmp_path)
    half = Morphology.coerce({"left_pectoral": (0.4, 0.8, 0.1)})
    for body, config, message in (
        (
            None,
            EvolveConfig(seed=1001, generations=6, population=20, poses=2, **PLAIN),
            "with seed 1000",
        ),
        (
            None,
            EvolveConfig(seed=1000, generations=6, population=21, poses=2, **PLAIN),
            "population 20",
        ),
        (half, CONFIG, "with morphology.left_pectoral"),
        (
            None,
            EvolveConfig(seed=1000, generations=5, population=20, poses=2, **PLAIN),
            "at least the 6",
        ),
    ):
        with pytest.raises(InvalidArgumentError, match=message):
            evolve_gait(body, config, out=tmp_path, scorer=WeightScorer())
    assert contents(tmp_path) == before


def test_a_damaged_checkpoint_is_refused(tmp_path: Path) -> None:
    evolve_gait(None, CONFIG, out=tmp_path, scorer=WeightScorer())
    path = tmp_path / CHECKPOINT_FILE
    sound = json.loads(path.read_text())
    for text, message in (
        ("{", "is not JSON"),
        ("[" * 10**6, "nested too deep"),
        ("[]", "must hold a JSON object"),
        (json.dumps({**sound, "schema": 9}), "is damaged"),
        (json.dumps({**sound, "fitness": 99.0}), "is damaged"),
        (json.dumps({k: v for k, v in sound.items() if k != "checksum"}), "has no checksum"),
    ):
        path.write_text(text)
        with pytest.raises(DamagedFileError, match=f"{message}.*delete it to start again"):
            evolve_gait(None, CONFIG, out=tmp_path, scorer=WeightScorer())


@pytest.mark.parametrize("lost", ["settings", "history", "best", "answers"])
def test_a_checkpoint_that_lacks_something_is_refused(tmp_path: Path, lost: str) -> None:
    evolve_gait(None, CONFIG, out=tmp_path, scorer=WeightScorer())
    path = tmp_path / CHECKPOINT_FILE
    data = read_document(path)
    del data[lost]
    write_document(path, data, CHECKPOINT_SCHEMA)
    with pytest.raises(InvalidArgumentError, match=r"out: .* lacks something"):
        evolve_gait(None, CONFIG, out=tmp_path, scorer=WeightScorer())


def test_a_checkpoint_from_elsewhere_is_refused(tmp_path: Path) -> None:
    for name, seed in (("a", 1), ("b", 2)):
        config = EvolveConfig(seed=seed, generations=2, population=20, **PLAIN)
        evolve_gait(None, config, out=tmp_path / name, scorer=WeightScorer())
    (tmp_path / "a" / CHECKPOINT_FILE).replace(tmp_path / "b" / CHECKPOINT_FILE)
    with pytest.raises(InvalidArgumentError, match="another run's checkpoint"):
        evolve_gait(None, config, out=tmp_path / "b", scorer=WeightScorer())


def test_a_directory_is_held_while_a_run_fills_it(tmp_path: Path) -> None:
    class Meanwhile(WeightScorer):
        """Begins the run again while it is running."""

        def __call__(
            self,
            controllers: Sequence[Controller],
            bodies: NDArray[np.float64],
            fin_angles: NDArray[np.float64],
        ) -> NDArray[np.float64]:
            with pytest.raises(InvalidArgumentError, match="in use by another command"):
                evolve_gait(None, CONFIG, out=tmp_path, scorer=WeightScorer())
            return super().__call__(controllers, bodies, fin_angles)

    evolve_gait(None, CONFIG, out=tmp_path, scorer=Meanwhile())
    assert set(contents(tmp_path)) == {*FILES, SETTINGS}


def test_what_came_of_it_is_spelled_in_a_line_and_drawn() -> None:
    from matplotlib.figure import Figure

    evolved = evolve_gait(None, CONFIG, scorer=WeightScorer())
    assert repr(evolved).startswith(f"Evolved(fitness {evolved.fitness:.2f} after 6 generations")
    assert len(repr(evolved)) < 130
    axes = Figure().add_subplot()
    assert evolved.plot(axes) is axes
    assert len(axes.lines) == 3


def test_random_streams_are_no_other_packages() -> None:
    """One seed often serves the estimation, which spawns its streams of it, and the gait."""
    found = [
        np.random.default_rng(source).random(100).tobytes()
        for seed in (0, 1)
        for source in (
            *(stream(seed, k) for k in range(4)),
            stream(seed),
            np.random.SeedSequence(seed),
            *np.random.SeedSequence(seed).spawn(4),
        )
    ]
    assert len(set(found)) == len(found)
    assert random_poses(2, 5).tobytes() == random_poses(2, stream(5)).tobytes()


def test_a_body_is_whatever_makes_one() -> None:
    config = EvolveConfig(seed=1000, generations=1, population=10, poses=0, **PLAIN)
    whole = Morphology.coerce({"caudal": (0.0, 0.0, 0.0)})
    for body in (whole, {"caudal": (0, 0, 0)}, whole.to_array()):
        evolved = evolve_gait(body, config, scorer=WeightScorer())
        assert evolved.controller.morphology == whole
    with pytest.raises(InvalidArgumentError, match="morphologies must have shape"):
        evolve_gait(np.zeros(8), config)


def test_an_unwritable_directory_is_refused_before_anything_swims(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    scorer = WeightScorer()
    with pytest.raises(InvalidArgumentError, match="out must be a directory"):
        evolve_gait(None, CONFIG, out=tmp_path / "file", scorer=scorer)
    assert scorer.calls == 0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("seed", -1),
        ("generations", 0),
        ("population", 9),
        ("poses", -1),
        ("clock", float("nan")),
        ("clock", 51.0),
        ("seconds", 0.0),
        ("threads", 0),
        ("threads", 10**8),
        ("generations", 10**8),
        ("population", 10**12),
        ("poses", 10**400),
        ("seed", 10**400),
        ("seed", np.arange(3)),
        ("seed", 1.5),
        ("starts", 0),
        ("polish", -1),
        ("harmonics", 0),
        ("hidden", 0),
        ("search", "random"),
        ("senses", ()),
        ("senses", "imu"),
        ("senses", ("imu", "sonar")),
        ("controller", "mlp"),
    ],
)
def test_a_bad_setting_is_refused_by_name(name: str, value: Any) -> None:
    with pytest.raises(InvalidArgumentError, match=f"^{name} must"):
        EvolveConfig(**{name: value})
