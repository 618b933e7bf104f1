"""Files that an earlier version wrote are read, or refused by their schema.

``tests/old_files`` holds what the commands of ``golden.py`` wrote before the packages were
rearranged. They are not written again: a version with another schema refuses them, and no command
continues what other code began. (The case study's settings have the names of this version.)
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquafish_gym import Morphology
from aquafish_gym.bodies import read_bodies
from aquafish_gym.utils.storage import DamagedFileError, read_document
from eea import load_posterior
from eea.cli.study import Plot
from eea.study.results import read_study
from gait import Controller, swim
from tests.golden import (
    CMA,
    RECOVER,
    SMALL_STUDY,
    aquafish,
    canonical,
    eea,
    gait,
    without_joint_inference,
)

OLD = Path(__file__).parent / "old_files"
DOCUMENTS = [path for path in sorted(OLD.rglob("*.json")) if '"schema"' in path.read_text()]


def test_a_controller_swims_and_is_written_as_it_was(tmp_path: Path) -> None:
    controller = Controller.load(OLD / "evolve/controller.json")
    assert np.isfinite(swim(controller, Morphology.nominal(), seconds=1).position).all()
    controller.save(tmp_path / "controller.json")
    before, after = (
        json.loads((p / "controller.json").read_text()) for p in (OLD / "evolve", tmp_path)
    )
    assert after == before


def test_bodies_are_read() -> None:
    bodies = read_bodies(OLD / "infer/bodies.json")
    result = json.loads((OLD / "infer/result.json").read_text())
    body = Morphology.from_json((OLD / "infer/morphology.json").read_text())
    assert len(bodies) > 1
    np.testing.assert_allclose(body.to_array(), result["morphology"], atol=1e-4)  # as handed on


def test_a_posterior_of_another_schema_says_what_to_do() -> None:
    with pytest.raises(DamagedFileError, match=r"it is 'eea\.posterior/4': infer again"):
        load_posterior(OLD / "infer/posterior.npz")


def test_a_study_is_read() -> None:
    table = read_study(OLD / "study").table
    assert len(table) == len((OLD / "study/results.csv").read_text().splitlines()) - 1


def resumed(run: Callable[[Path], None], name: str, folder: Path) -> Path:
    """Resume a copy of a folder; return it."""
    out = folder / name
    shutil.copytree(OLD / name, out)
    run(out)
    return out


@pytest.mark.parametrize(
    ("run", "name"),
    [
        (gait(*CMA), "evolve"),
        (eea("study", "--preset", "smoke"), "study"),
        (aquafish(*RECOVER), "recovery"),
    ],
)
def test_what_other_code_began_is_not_continued(
    run: Callable[[Path], None], name: str, tmp_path: Path
) -> None:
    with pytest.raises(RuntimeError, match=r"other code made|initial_angles None, not 'zero'"):
        resumed(run, name, tmp_path)
    files = [path for path in (OLD / name).rglob("*") if path.is_file()]
    for path in files:
        assert (tmp_path / name / path.relative_to(OLD / name)).read_bytes() == path.read_bytes()


def test_a_finished_study_is_drawn_again(tmp_path: Path) -> None:
    out = resumed(lambda folder: Plot(folder).execute(), "study", tmp_path)
    assert (out / "results.csv").read_text() == (OLD / "study/results.csv").read_text()


def test_a_finished_recovery_is_reported_again(tmp_path: Path) -> None:
    out = resumed(aquafish("recover", *SMALL_STUDY, "--redraw"), "recovery", tmp_path)
    before, after = (without_joint_inference(each) for each in (OLD / "recovery", out))
    assert canonical(after) == canonical(before)


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(OLD)))
def test_another_schema_is_refused(path: Path, tmp_path: Path) -> None:
    document: dict[str, Any] = json.loads(path.read_text())
    schema = document["schema"]
    assert read_document(path, schema)
    del document["checksum"]
    newer = tmp_path / "newer.json"
    newer.write_text(json.dumps(document | {"schema": f"{schema}0"}))
    with pytest.raises(DamagedFileError, match=rf"must be of schema {schema}; it has"):
        read_document(newer, schema)
