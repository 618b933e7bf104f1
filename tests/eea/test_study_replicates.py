"""A replicate is a pure function of its description."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace

import pytest

from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from aquafish_gym.utils.validation import InvalidArgumentError
from eea.core.config import (
    CONDITIONS,
    EstimationConfig,
    ExplorationConfig,
    OutOfBandConfig,
    PaperConfig,
)
from eea.study.replicate import Replicate, StudyWorld, replicate, warm_up_replicates

CONFIG = PaperConfig(
    condition="recovery",
    steps=16,
    rounds=3,
    exploration=ExplorationConfig(4, 2),
    estimation=EstimationConfig(4, 3),
    out_of_band=OutOfBandConfig(period=2, inner_population=4, inner_generations=2, revisit=1),
)
WORLD = StudyWorld(Morphology.nominal(), Damage.parse("left_pectoral:length=0.5"))


def make(seed=0, condition="none"):
    return Replicate("arm", CONFIG.under(condition), seed, WORLD)


def run(job):
    """Return a replicate's document as JSON."""
    return json.dumps(replicate(job), allow_nan=False)


@pytest.fixture(scope="module")
def documents():
    """Every condition's."""
    return {condition: run(make(condition=condition)) for condition in CONDITIONS}


def test_the_same_description_gives_the_same_document(documents):
    job = make()
    copy = pickle.loads(pickle.dumps(job))
    assert (copy, hash(copy)) == (job, hash(job))
    assert run(copy) == documents["none"]


def test_a_document_has_a_record_a_round_without_a_clock(documents):
    document = json.loads(documents["none"])
    assert list(document) == ["arm", "steps", "seed", "stopped", "rounds"]
    assert [record["round"] for record in document["rounds"]] == [1, 2, 3]
    assert not any("seconds" in record for record in document["rounds"])


def test_the_seeds_and_the_conditions_differ_and_the_hidden_angles_are_paired(documents):
    assert run(make(seed=1)) != documents["none"]
    assert len(set(documents.values())) == len(CONDITIONS)
    angles = [
        [record["true_angles"] for record in json.loads(text)["rounds"]]
        for text in documents.values()
    ]
    assert all(a == angles[0] for a in angles)


def test_a_rehearsal_refuses_what_no_replicate_could_run():
    assert warm_up_replicates([make(), make(condition="in-band")]) is None
    nowhere = replace(make(), world=replace(WORLD, current=(0.0, 0.0, float("nan"))))
    with pytest.raises(InvalidArgumentError, match="current must be finite"):
        warm_up_replicates([nowhere])
