"""Learned baselines: trained, kept without pickles, and the same when read again."""

from __future__ import annotations

import importlib
import json
import pickle
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquafish_gym.morphology import Morphology
from aquafish_gym.utils.validation import InvalidArgumentError, UnknownNameError
from gait import baselines
from gait.baselines import (
    PARAMETERS_FILE,
    SPEC_FILE,
    Baseline,
    BaselineConfig,
    MissingExtraError,
)

HALF = Morphology.coerce({"left_pectoral": (0.4, 0.8, 0.1)})
CONFIG = BaselineConfig(algorithm="SAC", steps=160, environments=16, hidden=(8,), seed=1000)
POSE = np.array([[0.3, -0.2, 1.0]])


@pytest.fixture(scope="module")
def trained() -> Baseline:
    pytest.importorskip("stable_baselines3")
    baseline = Baseline(HALF, CONFIG)
    baseline.train()
    return baseline


def test_training_changes_the_policy(trained: Baseline) -> None:
    before, after = Baseline(HALF, CONFIG).parameters(), trained.parameters()
    assert before.keys() == after.keys()
    assert any(not np.array_equal(before[name], after[name]) for name in before)


def test_what_was_saved_swims_as_what_was_trained(trained: Baseline, tmp_path: Path) -> None:
    trained.save(tmp_path)
    again = Baseline.load(tmp_path)
    assert again.config == trained.config
    assert again.morphology == HALF
    np.testing.assert_array_equal(again.evaluate(HALF, POSE), trained.evaluate(HALF, POSE))


def test_no_file_is_a_pickle(trained: Baseline, tmp_path: Path) -> None:
    trained.save(tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {SPEC_FILE, PARAMETERS_FILE}
    with np.load(tmp_path / PARAMETERS_FILE, allow_pickle=False) as archive:
        assert all(archive[name].dtype == np.float32 for name in archive.files)


def test_the_lanes_pass_stable_baselines_own_check() -> None:
    pytest.importorskip("stable_baselines3")
    env = importlib.import_module("gait.sb3_env").LaneVecEnv(2, HALF, "random")
    env.seed(5)
    first = env.reset()
    for step in range(400):
        observations, rewards, done, infos = env.step(np.zeros((2, 3), np.float32))
        assert observations.shape == (2, 9)
        assert rewards.shape == (2,)
        assert done.all() == (step == 399)
    assert [info["TimeLimit.truncated"] for info in infos] == [True, True]
    assert not np.array_equal(infos[0]["terminal_observation"], observations[0])
    np.testing.assert_array_equal(observations, first)  # upright again, at rest
    assert env.env_is_wrapped(object) == [False, False]
    with pytest.raises(AttributeError, match="share one environment"):
        env.set_attr("frame_skip", 1)
    env.close()


def test_a_foreign_or_hostile_archive_is_refused(trained: Baseline, tmp_path: Path) -> None:
    trained.save(tmp_path)
    path = tmp_path / PARAMETERS_FILE
    path.write_bytes(pickle.dumps({"a": 1}))
    with pytest.raises(InvalidArgumentError, match="not an archive of arrays"):
        Baseline.load(tmp_path)
    np.savez(path, other=np.zeros(3))
    with pytest.raises(InvalidArgumentError, match="does not fit the networks"):
        Baseline.load(tmp_path)
    path.unlink()
    with pytest.raises(InvalidArgumentError, match="cannot read"):
        Baseline.load(tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": 2}, "is not a baseline of schema 1"),
        ({"kind": "x"}, "is not a baseline of schema 1"),
        ({"config": {}}, "config must have the fields algorithm"),
        ({"morphology": None}, "does not say what body"),
        ({"morphology": {}}, "morphology's JSON"),
        ({"config": asdict(CONFIG) | {"hidden": 64}}, "hidden must be a row of widths; got 64"),
    ],
)
def test_a_broken_specification_is_refused(
    trained: Baseline, tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    trained.save(tmp_path)
    spec = json.loads((tmp_path / SPEC_FILE).read_text())
    (tmp_path / SPEC_FILE).write_text(json.dumps(spec | change))
    with pytest.raises(InvalidArgumentError, match=message):
        Baseline.load(tmp_path)


def test_a_missing_library_is_named_with_its_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(module: str) -> object:
        raise ModuleNotFoundError(f"No module named {module!r}")

    monkeypatch.setattr(baselines, "import_module", absent)
    with pytest.raises(MissingExtraError, match=r'pip install -e "\.\[rl\]"'):
        Baseline(HALF, CONFIG)


def test_bad_settings_are_refused_by_name() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'PPO'"):
        BaselineConfig(algorithm="PPA")
    for name, value in (
        ("steps", 0),
        ("environments", 0),
        ("seed", -1),
        ("hidden", (0,)),
        ("hidden", 64),
        ("random_poses", "no"),
    ):
        with pytest.raises(InvalidArgumentError, match=f"^{name} must"):
            BaselineConfig(**{name: value})  # type: ignore[arg-type]
