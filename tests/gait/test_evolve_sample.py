"""Evolving a gait for a sample of bodies: who swims what, what counts, and the files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from aquafish_gym.bodies import median_body, read_bodies, sample_stamp
from aquafish_gym.morphology import MAXIMA, Morphology
from aquafish_gym.utils.validation import InvalidArgumentError, UnknownNameError
from gait.controller import Controller
from gait.evolve import EvolveConfig, damaged_at_random, evolve_gait
from gait.fitness import distances
from gait.records import BODIES_FILE, CONTROLLER_FILE, FILES
from gait.rollout import ZERO_POSE, random_poses, stream
from gait_fakes import WeightScorer, contents

CONFIG = EvolveConfig(seed=1000, generations=6, population=20, poses=2, starts=1, polish=0)
BODIES = np.random.default_rng(5).uniform(0.2, 0.9, (20, 9)) * MAXIMA


class Noting(WeightScorer):
    """Keeps what it was asked and what it said."""

    def __init__(self, interrupt_at: int | None = None) -> None:
        super().__init__(interrupt_at)
        self.bodies: list[NDArray[np.float64]] = []
        self.poses: list[NDArray[np.float64]] = []
        self.said: list[NDArray[np.float64]] = []

    def __call__(
        self,
        controllers: Sequence[Controller],
        bodies: NDArray[np.float64],
        fin_angles: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        self.bodies.append(bodies)
        self.poses.append(fin_angles)
        self.said.append(super().__call__(controllers, bodies, fin_angles))
        return self.said[-1]


def test_copies_of_one_body_are_that_body() -> None:
    body = Morphology.coerce({"left_pectoral": (0.4, 0.8, 0.1)})
    config = EvolveConfig(
        seed=3, generations=3, population=12, poses=4, seconds=1.0, starts=1, polish=0
    )
    one, three = evolve_gait(body, config), evolve_gait([body] * 3, config)
    assert one.history == three.history
    assert one.controller.sample is None
    expected = {
        **one.controller.to_dict(),
        "sample": sample_stamp(np.tile(body.to_array(), (3, 1))),
    }
    assert three.controller.to_dict() == expected
    np.testing.assert_array_equal(three.distances, np.tile(one.distances, 3))
    assert one.distances == pytest.approx([one.fitness], abs=1e-12)


def test_bodies_are_other_ones_every_generation_and_the_finals_are_always_the_same() -> None:
    scorer = Noting()
    evolve_gait(BODIES, CONFIG, scorer=scorer)
    trials, finals = scorer.bodies[:-1:2], scorer.bodies[1::2]
    assert all(len(np.unique(bodies, axis=0)) == 3 for bodies in trials)
    assert len({bodies.tobytes() for bodies in trials}) == 6
    # 33 swims at least, and each of the 20 bodies equally often.
    assert len({bodies.tobytes() for bodies in finals}) == 1
    assert len({poses.tobytes() for poses in scorer.poses[1:-1:2]}) == 1
    assert len(np.unique(scorer.poses[1], axis=0)) == 40
    _, times = np.unique(finals[0], axis=0, return_counts=True)
    assert times.tolist() == [2] * 20
    # In the end, every body from the zero pose and 32 others.
    assert len(scorer.bodies[-1]) == 20 * 33


def test_the_poses_are_those_of_one_body() -> None:
    several, one = Noting(), Noting()
    evolve_gait(BODIES, CONFIG, scorer=several)
    evolve_gait(None, CONFIG, scorer=one)
    for mine, theirs in zip(several.poses[0:-1:2], one.poses[0:-1:2], strict=True):
        np.testing.assert_array_equal(mine, theirs)
    np.testing.assert_array_equal(several.poses[1][:33], one.poses[1])


def test_distances_say_how_the_winner_does_on_each_body() -> None:
    config = EvolveConfig(
        seed=3, generations=2, population=12, poses=2, seconds=1.0, starts=1, polish=0
    )
    evolved = evolve_gait(BODIES[:4], config)
    poses = np.vstack([ZERO_POSE, random_poses(32, stream(3, 1))])
    again = distances([evolved.controller], BODIES[:4], poses, seconds=1.0)
    np.testing.assert_array_equal(evolved.distances, again[0])
    assert "on 4 bodies after 2 generations" in repr(evolved)


def test_the_quantile_prefers_the_steady_one() -> None:
    """One kind of controller swims far on most bodies, the other not so far, but on all."""

    def scorer(
        controllers: Sequence[Controller],
        bodies: NDArray[np.float64],
        fin_angles: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        gambles = np.array([c.bias[-1] > 0 for c in controllers])[:, None]
        hard = (bodies[:, 0] < np.quantile(BODIES[:, 0], 0.25))[None]
        return np.where(gambles, np.where(hard, 0.0, 10.0), 5.0) + 0.0 * fin_angles[:, 0]

    found: dict[str, Any] = {}
    for aggregate in ("mean", "quantile"):
        config = replace(CONFIG, aggregate=aggregate, poses=19)
        found[aggregate] = evolve_gait(BODIES, config, scorer=scorer)
    assert found["mean"].controller.bias[-1] > 0
    assert found["mean"].fitness == 7.5
    assert found["quantile"].controller.bias[-1] <= 0
    assert found["quantile"].fitness == 5.0
    assert sorted(set(found["mean"].distances)) == [0.0, 10.0]


def test_fitness_is_the_quantile_that_was_asked_for() -> None:
    scorer = Noting()
    config = replace(CONFIG, aggregate="quantile", quantile=0.1)
    evolved = evolve_gait(BODIES, config, scorer=scorer)
    trials, finals = scorer.said[:-1:2], scorer.said[1:-1:2]
    for row, trial, final in zip(evolved.history, trials, finals, strict=True):
        assert row.best == np.quantile(trial, 0.1, axis=1).max()
        assert row.mean == np.quantile(trial, 0.1, axis=1).mean()
        assert row.final == np.quantile(final, 0.1, axis=1).max()
    assert evolved.fitness == max(row.final for row in evolved.history)


@pytest.mark.parametrize("aggregate", ["mean", "quantile"])
def test_an_interrupted_run_ends_in_the_same_files(tmp_path: Path, aggregate: Any) -> None:
    config = replace(CONFIG, aggregate=aggregate)
    straight = evolve_gait(BODIES, config, out=tmp_path / "straight", scorer=WeightScorer())
    with pytest.raises(KeyboardInterrupt):
        evolve_gait(BODIES, config, out=tmp_path / "stopped", scorer=WeightScorer(7))
    resumed = evolve_gait(BODIES, config, out=tmp_path / "stopped", scorer=WeightScorer())
    assert contents(tmp_path / "stopped") == contents(tmp_path / "straight")
    np.testing.assert_array_equal(resumed.distances, straight.distances)
    assert {BODIES_FILE, *FILES} < set(contents(tmp_path / "straight"))


def test_files_tell_which_sample_it_was(tmp_path: Path) -> None:
    evolve_gait(BODIES, CONFIG, out=tmp_path, scorer=WeightScorer())
    kept = np.array([body.to_array() for body in read_bodies(tmp_path / BODIES_FILE)])
    np.testing.assert_array_equal(kept, BODIES)
    controller = Controller.load(tmp_path / CONTROLLER_FILE)
    assert controller.sample == sample_stamp(BODIES)
    assert controller.morphology == median_body(BODIES)


def test_another_sample_or_aggregate_is_refused(tmp_path: Path) -> None:
    evolve_gait(BODIES, CONFIG, out=tmp_path, scorer=WeightScorer())
    before = contents(tmp_path)
    swapped = BODIES[::-1]  # the same median, and other pairs
    for bodies, config, message in (
        (swapped, CONFIG, r"with sample '20 bodies, \w{16}', not '20 bodies, \w{16}'"),
        (median_body(BODIES), CONFIG, r"with sample '20 bodies, \w{16}', not None"),
        (BODIES[1:], CONFIG, r"with morphology\."),
        (BODIES, replace(CONFIG, aggregate="quantile"), "with aggregate None, not 'quantile'"),
    ):
        with pytest.raises(InvalidArgumentError, match=message):
            evolve_gait(bodies, config, out=tmp_path, scorer=WeightScorer())
    assert contents(tmp_path) == before


def test_a_sample_that_cannot_be_told_apart_is_refused() -> None:
    scorer = WeightScorer()
    with pytest.raises(InvalidArgumentError, match="poses must be at least 1 for a sample of 20"):
        evolve_gait(BODIES, replace(CONFIG, poses=0), scorer=scorer)
    for bodies, count in ((np.zeros((0, 9)), 0), (np.zeros((1001, 9)), 1001)):
        with pytest.raises(InvalidArgumentError, match=f"must be 1 to 1000 bodies; got {count}"):
            evolve_gait(bodies, CONFIG, scorer=scorer)
    with pytest.raises(InvalidArgumentError, match="morphologies must have shape"):
        evolve_gait([], CONFIG, scorer=scorer)
    assert scorer.calls == 0


def test_a_setting_without_a_say_is_refused() -> None:
    with pytest.raises(InvalidArgumentError, match=r"quantile has a say only with .*; got 0.1"):
        EvolveConfig(quantile=0.1)
    with pytest.raises(InvalidArgumentError, match="poses must be at least 1 with aggregate"):
        EvolveConfig(aggregate="quantile", poses=0)
    with pytest.raises(InvalidArgumentError, match=r"quantile must lie in \[0, 1\]"):
        EvolveConfig(aggregate="quantile", quantile=1.5)
    with pytest.raises(UnknownNameError, match="did you mean 'mean'"):
        EvolveConfig(aggregate="men")  # type: ignore[arg-type]


def test_random_damages_are_a_sample_that_grows() -> None:
    body = Morphology.nominal()
    few, many = damaged_at_random(body, 3, 5), damaged_at_random(body, 8, 5)
    assert many[:3] == few
    assert len({str(one.to_array()) for one in many}) == 8
    assert damaged_at_random(body, 3, 6) != few
