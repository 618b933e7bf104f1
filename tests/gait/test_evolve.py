"""Evolution of a gait: its swims, its files, its resumption, and what it refuses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from aquafish_gym.bodies import median_body, read_bodies, sample_stamp
from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import AQUAFISH, BodyPlan
from aquafish_gym.utils.storage import DamagedFileError, read_document, write_document
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.controllers.controller import Controller
from gait.files import BODIES_FILE, CONTROLLER_FILE
from gait.search.evolve import EvolveConfig, Generation, damaged_at_random, evolve_gait
from gait.search.history import CHECKPOINT_FILE, CHECKPOINT_SCHEMA, HISTORY_FILE
from gait.swims.poses import random_poses, stream, zero_pose
from gait.swims.scores import DIVERGED_SPEED, distances
from gait.swims.swim import SECONDS
from gait_fakes import WeightScorer, contents, evolve_with, read_history

CONFIG = EvolveConfig(paper=True, seed=1000, generations=6, population=20, poses=2)
CMA = EvolveConfig(
    seed=7, controller="linear", generations=60, population=10, random_candidates=30, poses=1
)
TUNED = EvolveConfig(
    seed=7, search="neat", restarts=2, generations=16, cma_generations=6, population=20, poses=1
)
BODIES = np.random.default_rng(5).uniform(0.2, 0.9, (20, 9)) * AQUAFISH.maxima


class Recorder(WeightScorer):
    """Keeps the swims that it was asked for and their distances."""

    def __init__(self) -> None:
        super().__init__()
        self.bodies: list[NDArray[np.float64]] = []
        self.poses: list[NDArray[np.float64]] = []
        self.distances: list[NDArray[np.float64]] = []

    def __call__(
        self,
        plan: BodyPlan,
        controllers: Sequence[Controller],
        bodies: NDArray[np.float64],
        fin_angles: NDArray[np.float64],
        *_: Any,
        **__: Any,
    ) -> NDArray[np.float64]:
        self.bodies.append(bodies)
        self.poses.append(fin_angles)
        self.distances.append(super().__call__(plan, controllers, bodies, fin_angles))
        return self.distances[-1]


def test_files_hold_the_result(tmp_path: Path) -> None:
    seen: list[Generation] = []
    result = evolve_with(WeightScorer(), None, CONFIG, out=tmp_path, on_generation=seen.append)
    assert read_history(tmp_path / HISTORY_FILE) == result.history == tuple(seen)
    assert Controller.load(tmp_path / CONTROLLER_FILE).to_dict() == result.controller.to_dict()
    assert result.fitness == max(row.final for row in seen)
    assert len(repr(result)) < 130


@pytest.mark.parametrize(
    ("bodies", "config"),
    [(None, CMA), (None, TUNED), pytest.param(BODIES, CONFIG, marks=pytest.mark.slow)],
    ids=["cma", "neat", "sample"],
)
def test_interrupted_run_ends_in_the_same_files(
    bodies: Any, config: EvolveConfig, tmp_path: Path
) -> None:
    straight = evolve_with(WeightScorer(), bodies, config, out=tmp_path / "straight")
    assert len(straight.history) == config.choices.rows
    for stop in (2, config.choices.rows // 2):  # in scorings
        out = tmp_path / str(stop)
        with pytest.raises(KeyboardInterrupt):
            evolve_with(WeightScorer(stop + 1), bodies, config, out=out)
        done = read_history(out / HISTORY_FILE)
        Controller.load(out / CONTROLLER_FILE)

        def interrupt(row: Generation, last: int = len(done) - 1) -> None:
            if row.generation == last:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):  # once more, while it is being restored
            evolve_with(WeightScorer(), bodies, config, out=out, on_generation=interrupt)
        assert read_history(out / HISTORY_FILE) == done
        resumed = evolve_with(WeightScorer(), bodies, config, out=out)
        assert contents(out) == contents(tmp_path / "straight")
        np.testing.assert_array_equal(resumed.distances, straight.distances)


@pytest.mark.parametrize(
    ("config", "last"), [(CMA, "generations"), (TUNED, "cma_generations"), (CONFIG, "generations")]
)
def test_last_stage_may_be_prolonged(config: EvolveConfig, last: str, tmp_path: Path) -> None:
    longer = replace(config, **{last: getattr(config, last) + 5})  # type: ignore[arg-type]
    evolve_with(WeightScorer(), None, config, out=tmp_path)
    grown = evolve_with(WeightScorer(), None, longer, out=tmp_path)
    assert grown.history == evolve_with(WeightScorer(), None, longer).history
    with pytest.raises(InvalidArgumentError, match=f"{last} must be at least the"):
        evolve_with(WeightScorer(), None, config, out=tmp_path)


def test_several_runs_of_neat_cannot_be_prolonged(tmp_path: Path) -> None:
    several = replace(CONFIG, restarts=2)
    evolve_with(WeightScorer(), None, several, out=tmp_path)
    with pytest.raises(InvalidArgumentError, match="generations"):
        evolve_with(WeightScorer(), None, replace(several, generations=11), out=tmp_path)


def test_random_swims_change_and_final_swims_do_not() -> None:
    several, one = Recorder(), Recorder()
    evolve_with(several, BODIES, CONFIG)
    evolve_with(one, None, CONFIG)
    trials, finals = several.bodies[:-1:2], several.bodies[1:-1:2]
    assert len({bodies.tobytes() for bodies in trials}) == 6
    assert len({bodies.tobytes() for bodies in finals}) == 1
    assert len({poses.tobytes() for poses in several.poses[1:-1:2]}) == 1
    # 33 swims at least, and each of the 20 bodies equally often.
    _, times = np.unique(finals[0], axis=0, return_counts=True)
    assert times.tolist() == [2] * 20
    assert len(several.bodies[-1]) == 20 * 33
    for ours, theirs in zip(several.poses[:-1:2], one.poses[:-1:2], strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_copies_of_one_body_are_that_body() -> None:
    body = Morphology.coerce({"left_pectoral": (0.4, 0.8, 0.1)})
    config = EvolveConfig(paper=True, seed=3, generations=3, population=12, poses=4, seconds=1.0)
    one, three = evolve_gait(body, config), evolve_gait([body] * 3, config)
    assert one.history == three.history
    stamp = sample_stamp(np.tile(body.to_array(), (3, 1)))
    assert three.controller.to_dict() == {**one.controller.to_dict(), "sample": stamp}
    assert one.distances == pytest.approx([one.fitness], abs=1e-12)


def test_result_has_the_distance_on_each_body(tmp_path: Path) -> None:
    config = EvolveConfig(paper=True, seed=3, generations=2, population=12, poses=2, seconds=1.0)
    evolved = evolve_gait(BODIES[:4], config, out=tmp_path)
    poses = np.vstack([zero_pose(), random_poses(32, stream(3, 1))])
    again = distances([evolved.controller], BODIES[:4], poses, seconds=1.0)
    np.testing.assert_array_equal(evolved.distances, again[0])
    kept = np.array([body.to_array() for body in read_bodies(tmp_path / BODIES_FILE)])
    np.testing.assert_array_equal(kept, BODIES[:4])
    assert evolved.controller.morphology == median_body(BODIES[:4])


def test_diverged_robot_is_the_worst_and_does_not_spread_nan() -> None:
    class Diverging(WeightScorer):
        def __call__(self, *swims: Any, **options: Any) -> NDArray[np.float64]:
            found = super().__call__(*swims, **options)
            found[::3, 0], found[1::3, 0] = np.nan, np.inf
            return found

    result = evolve_with(Diverging(), None, EvolveConfig(paper=True, generations=3, population=20))
    assert np.isfinite([row.mean for row in result.history]).all()
    assert result.fitness > DIVERGED_SPEED * SECONDS / 2


def test_paper_is_plain_neat_and_cma_the_default() -> None:
    assert EvolveConfig().choices.rows == 2 + 6 * 50 + 3 * 100 + 590
    assert EvolveConfig(search="neat").choices.rows == 6 * 12 + 6 * 50 + 2 * 60 + 240
    plain = EvolveConfig(search="neat", restarts=1, cma_generations=0, generations=60)
    assert EvolveConfig(paper=True).settings == plain.settings
    assert EvolveConfig(paper=True).choices.rows == 60


def test_another_run_in_the_folder_is_refused(tmp_path: Path) -> None:
    evolve_with(WeightScorer(), BODIES, CONFIG, out=tmp_path)
    before = contents(tmp_path)
    for bodies, config, message in (
        (BODIES, replace(CONFIG, seed=1001), "with seed 1000"),
        (BODIES[::-1], CONFIG, "with sample '20 bodies"),  # the same median
        (None, CONFIG, r"with morphology\."),
    ):
        with pytest.raises(InvalidArgumentError, match=message):
            evolve_with(WeightScorer(), bodies, config, out=tmp_path)
    assert contents(tmp_path) == before


def test_damaged_checkpoint_is_refused(tmp_path: Path) -> None:
    evolve_with(WeightScorer(), None, CONFIG, out=tmp_path)
    path = tmp_path / CHECKPOINT_FILE
    sound = read_document(path)
    for document in ({**sound, "generations": [1]}, {}):
        write_document(path, document, CHECKPOINT_SCHEMA)
        with pytest.raises(DamagedFileError, match="delete it to start again"):
            evolve_with(WeightScorer(), None, CONFIG, out=tmp_path)
    path.write_text("{")
    with pytest.raises(DamagedFileError, match="delete it to start again"):
        evolve_with(WeightScorer(), None, CONFIG, out=tmp_path)


def test_random_damages_are_a_sample_that_grows() -> None:
    body = Morphology.nominal()
    few, many = damaged_at_random(body, 3, 5), damaged_at_random(body, 8, 5)
    assert many[:3] == few
    assert len({str(one.to_array()) for one in many}) == 8
    assert damaged_at_random(body, 3, 6) != few


def test_a_sample_needs_poses_before_anything_swims() -> None:
    scorer = WeightScorer()
    with pytest.raises(InvalidArgumentError, match="poses must be at least 1 for a sample of 20"):
        evolve_with(scorer, BODIES, replace(CONFIG, poses=0))
    assert scorer.calls == 0
