"""What a study is, what its folder says and may take in, and how it is shown."""

from __future__ import annotations

from dataclasses import replace

import pytest

from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from aquafish_gym.utils.validation import InvalidArgumentError
from eea.core.checks import ConfigurationError
from eea.core.config import PaperConfig
from eea.study.replicate import StudyWorld
from eea.study.study import (
    Study,
    extended,
    read_description,
    replicate_keys,
    write_description,
)

WORLD = StudyWorld(Morphology.nominal(), Damage.parse("none"))
NONE = PaperConfig(condition="none", rounds=5)
STUDY = Study({"none": NONE}, (64, 128), 2, 4, WORLD)


def changed(**settings):
    return replace(STUDY, **settings)


def files(folder):
    """Return name to content."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"steps": (64, 65)}, "steps must be a power of two; got 65"),
        ({"replicates": 10**9}, "replicates must be a whole number .* at most 10000"),
        ({"replicates": 10_000, "steps": tuple(2**k for k in range(1, 13))}, "at most 100000"),
    ],
)
def test_a_study_checks_itself(wrong, message):
    with pytest.raises(ConfigurationError, match=message):
        changed(**wrong)


def test_a_studys_jobs_are_its_plans_places():
    assert [job.key for job in STUDY.jobs()] == replicate_keys(STUDY.to_dict())
    assert {job.config.rounds for job in STUDY.jobs()} == {5}


@pytest.mark.parametrize(
    ("other", "difference"),
    [
        (changed(arms={"none": replace(NONE, rounds=6)}), "rounds 5, not 6"),
        (
            changed(world=replace(WORLD, target_engine="pybullet")),
            "target_engine 'numba', not 'pyb",
        ),
        (
            changed(world=replace(WORLD, damage=Damage.parse("left_pectoral:length=0.5"))),
            "with target_damage [], not [{",
        ),
        (
            changed(arms={"ideal": PaperConfig(rounds=5), "none": PaperConfig("ideal", rounds=5)}),
            "arms.none.condition 'none', not 'ideal'",
        ),
        (changed(first_seed=7), "none with seeds 2 to 5; 7 to 10 would leave a gap"),
    ],
)
def test_another_study_in_the_folder_is_refused(tmp_path, other, difference):
    write_description(tmp_path, extended(tmp_path, STUDY))
    before = files(tmp_path)
    with pytest.raises(InvalidArgumentError) as refusal:
        extended(tmp_path, other)
    assert difference in str(refusal.value)
    assert files(tmp_path) == before
    assert extended(tmp_path, STUDY) == read_description(tmp_path)


def span(first, count):
    return {"first": first, "count": count}


@pytest.mark.parametrize(
    ("other", "union"),
    [
        (
            changed(steps=(256, 64)),
            {"none": {"64": span(2, 4), "128": span(2, 4), "256": span(2, 4)}},
        ),
        (
            changed(first_seed=6, replicates=1, steps=(64,)),
            {"none": {"64": span(2, 5), "128": span(2, 4)}},
        ),
        (
            changed(first_seed=0, replicates=20),
            {"none": {"64": span(0, 20), "128": span(0, 20)}},
        ),
        (
            changed(arms={"more": PaperConfig(rounds=5)}, first_seed=0, replicates=1, steps=(32,)),
            {"none": {"64": span(2, 4), "128": span(2, 4)}, "more": {"32": span(0, 1)}},
        ),
    ],
)
def test_a_larger_study_is_the_union(tmp_path, other, union):
    write_description(tmp_path, extended(tmp_path, STUDY))
    document = extended(tmp_path, other)
    assert document["replicates"] == union
    assert list(document["arms"]) == list(union)
