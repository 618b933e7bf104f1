"""What a study is, what its folder says and may take in, its replicates and its statistics."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from aquafish_gym.utils.validation import InvalidArgumentError
from eea.core.checks import ConfigurationError
from eea.core.config import (
    CONDITIONS,
    EstimationConfig,
    ExplorationConfig,
    OutOfBandConfig,
    PaperConfig,
)
from eea.study.replicate import Replicate, StudyWorld, replicate, warm_up_replicates
from eea.study.statistics import (
    FEWEST_VALUES,
    curve_interval,
    interval,
    paired_difference,
    ratio_interval,
    sign_test,
    summary_statistics,
)
from eea.study.study import Study, extended, read_description, replicate_keys, write_description

WORLD = StudyWorld(Morphology.nominal(), Damage.parse("none"))
NONE = PaperConfig(condition="none", rounds=5)
STUDY = Study({"none": NONE}, (64, 128), 2, 4, WORLD)
SHORT = Damage.parse("left_pectoral:length=0.5")


def files(folder):
    """Return name to content."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_a_study_has_so_many_jobs_at_most():
    with pytest.raises(ConfigurationError, match="at most 100000"):
        replace(STUDY, replicates=10_000, steps=tuple(2**k for k in range(1, 13)))


def test_a_studys_jobs_are_its_plans_places():
    assert [job.key for job in STUDY.jobs()] == replicate_keys(STUDY.to_dict())
    assert {job.config.rounds for job in STUDY.jobs()} == {5}


@pytest.mark.parametrize(
    ("other", "difference"),
    [
        ({"arms": {"none": replace(NONE, rounds=6)}}, "rounds 5, not 6"),
        ({"world": replace(WORLD, target_engine="pybullet")}, "target_engine 'numba', not 'pyb"),
        ({"world": replace(WORLD, damage=SHORT)}, "with target_damage [], not [{"),
        ({"arms": {"none": PaperConfig("ideal", rounds=5)}}, "arms.none.condition 'none', not 'id"),
        ({"first_seed": 7}, "none with seeds 2 to 5; 7 to 10 would leave a gap"),
    ],
)
def test_another_study_in_the_folder_is_refused(tmp_path, other, difference):
    write_description(tmp_path, extended(tmp_path, STUDY))
    before = files(tmp_path)
    with pytest.raises(InvalidArgumentError) as refusal:
        extended(tmp_path, replace(STUDY, **other))
    assert difference in str(refusal.value)
    assert files(tmp_path) == before
    assert extended(tmp_path, STUDY) == read_description(tmp_path)


@pytest.mark.parametrize(
    ("other", "union"),
    [
        ({"steps": (256, 64)}, {"none": {"64": (2, 4), "128": (2, 4), "256": (2, 4)}}),
        ({"first_seed": 6, "steps": (64,)}, {"none": {"64": (2, 8), "128": (2, 4)}}),
        ({"first_seed": 0, "replicates": 20}, {"none": {"64": (0, 20), "128": (0, 20)}}),
        (
            {"arms": {"more": NONE.under("ideal")}, "first_seed": 0, "steps": (32,)},
            {"none": {"64": (2, 4), "128": (2, 4)}, "more": {"32": (0, 4)}},
        ),
    ],
)
def test_a_larger_study_is_the_union(tmp_path, other, union):
    write_description(tmp_path, extended(tmp_path, STUDY))
    document = extended(tmp_path, replace(STUDY, **other))
    assert list(document["arms"]) == list(union)
    assert document["replicates"] == {
        arm: {steps: {"first": first, "count": count} for steps, (first, count) in spans.items()}
        for arm, spans in union.items()
    }


TINY = PaperConfig(
    condition="recovery",
    steps=16,
    rounds=3,
    exploration=ExplorationConfig(4, 2),
    estimation=EstimationConfig(4, 3),
    out_of_band=OutOfBandConfig(period=2, inner_population=4, inner_generations=2, revisit=1),
)


def job_of(seed=0, condition="none"):
    world = StudyWorld(Morphology.nominal(), SHORT)
    return Replicate("arm", TINY.under(condition), seed, world)


def run(job):
    """Return a replicate's document as JSON."""
    return json.dumps(replicate(job), allow_nan=False)


@pytest.fixture(scope="module")
def documents():
    """Every condition's."""
    return {condition: run(job_of(condition=condition)) for condition in CONDITIONS}


def test_the_same_description_gives_the_same_document_without_a_clock(documents):
    job = job_of()
    copy = pickle.loads(pickle.dumps(job))
    assert (copy, hash(copy)) == (job, hash(job))
    assert run(copy) == documents["none"]
    document = json.loads(documents["none"])
    assert list(document) == ["arm", "steps", "seed", "stopped", "rounds"]
    assert [record["round"] for record in document["rounds"]] == [1, 2, 3]
    assert not any("seconds" in record for record in document["rounds"])


def test_the_seeds_and_the_conditions_differ_and_the_hidden_angles_are_paired(documents):
    assert run(job_of(seed=1)) != documents["none"]
    assert len(set(documents.values())) == len(CONDITIONS)
    angles = [
        [record["true_angles"] for record in json.loads(text)["rounds"]]
        for text in documents.values()
    ]
    assert all(a == angles[0] for a in angles)


def test_a_rehearsal_runs_and_a_world_that_no_replicate_could_run_is_refused():
    assert warm_up_replicates([job_of(), job_of(condition="in-band")]) is None
    with pytest.raises(InvalidArgumentError, match="current"):
        replace(WORLD, current=(0.0, 0.0, float("nan")))


SKEWED = np.array([1.0, 1.1, 1.2, 1.2, 1.3, 1.5, 2.0, 3.5, 6.0, 9.0])


def test_a_summary_by_hand():
    assert summary_statistics([1.0, 2.0, 6.0]) == {
        "replicates": 3,
        "mean": 3.0,
        "sd": pytest.approx(7**0.5),
        "interval": None,
    }
    assert summary_statistics([2.0])["sd"] is None
    assert len(summary_statistics(np.arange(float(FEWEST_VALUES)))["interval"]) == 2


def test_an_interval_is_of_enough_numbers_and_the_same_each_time():
    assert interval(SKEWED[: FEWEST_VALUES - 1]) is None
    assert interval(np.full(6, 0.3)) == [pytest.approx(0.3)] * 2
    assert interval(SKEWED) == interval(SKEWED.copy())
    almost = np.append(np.linspace(0.99, 0.992, 24), 0.6)  # a failure among equals
    low, high = interval(almost)
    assert 0.6 <= low < almost.mean() < high <= 0.992


@pytest.mark.parametrize(
    ("draw", "mean"),
    [
        (lambda rng, shape: rng.normal(size=shape), 0.0),
        (lambda rng, shape: 1 - rng.beta(1, 8, size=shape), 8 / 9),  # as OBJ_FIT: a tail below
    ],
    ids=["normal", "skewed"],
)
@pytest.mark.parametrize(("count", "least"), [(5, 0.85), (8, 0.90), (10, 0.90), (25, 0.90)])
def test_intervals_hold_the_mean_about_as_often_as_they_say(draw, mean, count, least):
    samples = draw(np.random.default_rng(5), (count, 800))

    def held(ends):
        return np.mean((ends[0] <= mean) & (mean <= ends[1]))

    ours = held(curve_interval(samples))
    assert least <= ours <= 0.985
    for method in ("percentile", "BCa"):
        plain = stats.bootstrap(
            (samples,), np.mean, method=method, n_resamples=1000, batch=200,
            rng=np.random.default_rng(0),
        ).confidence_interval  # fmt: skip
        assert held((plain.low, plain.high)) < ours - (0.03 if count <= 10 else 0.0)


def test_differences_are_taken_within_the_seeds_that_both_have():
    first = {0: 5.0, 1: 4.0, 2: 9.0, 7: 100.0}
    second = {2: 6.0, 1: 5.0, 0: 1.0, 8: -100.0}
    found = paired_difference(first, second)
    assert found["replicates"] == 3
    assert found["mean"] == pytest.approx((4 - 1 + 3) / 3)
    assert (found["wins"], found["losses"]) == (2, 1)
    assert found["sign_test_p"] == 1.0


def test_the_sign_test_by_hand():
    assert sign_test([1.0] * 10) == pytest.approx(2 / 2**10)
    assert sign_test([1.0] * 8 + [-1.0, 0.0, 0.0]) == pytest.approx(2 * (1 + 9) / 2**9)
    assert sign_test([1.0, -1.0, 0.0]) == 1.0
    assert sign_test([0.0]) == 1.0


def test_a_curves_interval_is_that_of_each_of_its_points():
    curves = np.random.default_rng(0).normal([0.0, 5.0, 1.0], [1.0, 0.1, 0.0], (25, 3))
    low, high = curve_interval(curves)
    assert (low[2], high[2]) == (1.0, 1.0)
    assert [low[1], high[1]] == pytest.approx(interval(curves[:, 1]), abs=0.003)
    few = curve_interval(curves[:4])
    assert [side.tolist() for side in few] == [curves[:4].mean(axis=0).tolist()] * 2


def test_a_ratio_holds_the_ratio_of_the_means():
    rng = np.random.default_rng(1)
    low, high = ratio_interval(rng.normal(3, 0.1, 10), rng.normal(6, 0.1, 10))
    assert 0.47 < low < 0.5 < high < 0.53
    assert ratio_interval(SKEWED[:4], SKEWED[:4]) is None
