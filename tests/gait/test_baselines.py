"""Learned baselines: trained, kept without pickles, and the same when read again."""

from __future__ import annotations

import importlib
import pickle
import tracemalloc
import zipfile
from dataclasses import asdict, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.storage import DamagedFileError, write_document
from aquafish_gym.utils.validation import InvalidArgumentError, UnknownNameError
from gait import baselines
from gait.baselines import (
    PARAMETERS_FILE,
    SCHEMA,
    SPEC_FILE,
    Baseline,
    BaselineConfig,
    MissingExtraError,
)
from gait.rollout import swim
from gait.transfer import TransferConfig, transfer

HALF = Morphology.coerce({"left_pectoral": (0.4, 0.8, 0.1)})
CONFIG = BaselineConfig(algorithm="SAC", steps=160, environments=16, hidden=(8,), seed=1000)
POSE = (0.3, -0.2, 1.0)


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
    paths = [swim(one, HALF, POSE, "numba", 2.0).position for one in (again, trained)]
    np.testing.assert_array_equal(*paths)


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
    with pytest.raises(DamagedFileError, match="is not a whole archive of arrays"):
        Baseline.load(tmp_path)
    np.savez(path, other=np.zeros(3))
    with pytest.raises(DamagedFileError, match="must hold the arrays"):
        Baseline.load(tmp_path)
    path.unlink()
    with pytest.raises(InvalidArgumentError, match="baseline must be a file that can be read"):
        Baseline.load(tmp_path)


def header(shape: tuple[int, ...]) -> bytes:
    """Return a .npy file that says it has this shape, and holds nothing."""
    stream = BytesIO()
    about = {"descr": "<f4", "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(stream, about)
    return stream.getvalue()


@pytest.mark.parametrize("attack", ["bomb", "header", "twice", "path"])
def test_no_archive_takes_the_memory(tmp_path: Path, attack: str) -> None:
    """4 GB of zeros in 4 MB, a header of 10**12 numbers, names that are odd: 4.4 GB once."""
    pytest.importorskip("stable_baselines3")
    small = Baseline(HALF, replace(CONFIG, algorithm="PPO"))  # SAC has a large buffer of its own
    small.save(tmp_path)
    path, names = tmp_path / PARAMETERS_FILE, list(small.parameters())
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in names:
            if attack == "bomb":
                with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                    member.write(header((2**25,)))
                    for _ in range(16):
                        member.write(bytes(2**20))
            else:
                archive.writestr(f"{name}.npy", header((10**12,)))
        if attack == "twice":
            with pytest.warns(UserWarning, match="Duplicate name"):
                archive.writestr(f"{names[0]}.npy", header((1,)))
        if attack == "path":
            archive.writestr("../../outside.npy", header((1,)))
    tracemalloc.start()
    with pytest.raises(DamagedFileError, match=PARAMETERS_FILE):
        Baseline.load(tmp_path)
    assert tracemalloc.get_traced_memory()[1] < 64 * 2**20
    tracemalloc.stop()


@pytest.mark.parametrize("hidden", [[4096] * 30, [10**12], [0], "64", 64])
def test_networks_that_would_take_the_memory_are_refused(tmp_path: Path, hidden: object) -> None:
    """Allocated before they were checked, once."""
    spec = {"morphology": HALF.to_dict(), "config": asdict(CONFIG) | {"hidden": hidden}}
    write_document(tmp_path / SPEC_FILE, spec, SCHEMA)
    with pytest.raises(InvalidArgumentError, match="hidden must"):
        Baseline.load(tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"config": {}}, "baseline: config has missing or unknown fields: algorithm"),
        ({"config": None}, "baseline: config must be a JSON object"),
        ({"morphology": None}, "morphology's JSON"),
        ({"morphology": {}}, "morphology's JSON"),
        ({"extra": 1}, "baseline has missing or unknown fields: extra"),
        ({"config": asdict(CONFIG) | {"hidden": 64}}, "hidden must be at most 8 widths.* got 64"),
    ],
)
def test_a_broken_specification_is_refused(
    tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    spec = {"morphology": HALF.to_dict(), "config": asdict(CONFIG)}
    write_document(tmp_path / SPEC_FILE, spec | change, SCHEMA)
    with pytest.raises(InvalidArgumentError, match=message):
        Baseline.load(tmp_path)


def test_a_changed_or_foreign_specification_is_refused(tmp_path: Path) -> None:
    spec = {"morphology": HALF.to_dict(), "config": asdict(CONFIG)}
    path = tmp_path / SPEC_FILE
    write_document(path, spec, "gait.controller/2")
    with pytest.raises(DamagedFileError, match=r"must be of schema gait\.baseline/2"):
        Baseline.load(tmp_path)
    write_document(path, spec, SCHEMA)
    path.write_text(path.read_text().replace("SAC", "TD3"))
    with pytest.raises(DamagedFileError, match="does not match its checksum"):
        Baseline.load(tmp_path)


def test_a_baseline_swims_wherever_a_controller_does(trained: Baseline) -> None:
    whole = Morphology.nominal()
    config = TransferConfig(poses=1, seconds=2.0, target_engine="numba")
    both = transfer(trained, whole, config)
    assert both.native.distance == swim(trained, HALF, engine="numba", seconds=2.0).distance
    far = swim(trained, whole, both.poses[0], "numba", 2.0).distance
    assert both.target.random_distances == far != both.target.distance


def test_it_swims_in_the_environment_it_learned_in(trained: Baseline) -> None:
    env = gym.make("AquaFish-v0", morphology=HALF.to_dict(), engine="numba")
    observation, info = env.reset(options={"fin_angles": POSE})
    policy, over = trained.policy(), False
    while not over:
        action = np.asarray(policy(observation, 0.0), np.float32)
        observation, _, _, over, info = env.step(action)
    env.close()
    # The environment's observations are single precision, as are the policy's senses.
    assert info["y_position"] == pytest.approx(
        swim(trained, HALF, POSE, "numba").distance, abs=1e-6
    )


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
        ("steps", 10**400),
        ("environments", 0),
        ("environments", 10**8),
        ("seed", -1),
        ("seed", 2**32),
        ("hidden", (0,)),
        ("hidden", (1024,) * 9),
        ("hidden", 64),
        ("random_poses", "no"),
    ):
        with pytest.raises(InvalidArgumentError, match=f"^{name} must"):
            BaselineConfig(**{name: value})  # type: ignore[arg-type]
