"""Other people's trainers and wrappers take the environments as they are, single and in batches."""

from __future__ import annotations

import pathlib
import re
import shlex
import subprocess
import sys
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import wrappers
from gymnasium.vector import SyncVectorEnv
from gymnasium.wrappers import vector as several

from aquafish_gym import IDS, Morphology
from gait.controllers.controller import Controller
from tests.trainers import __main__ as command
from tests.trainers.page import PAGE as BLOCKS
from tests.trainers.page import Trainer, form, read_trainers, score, shown_line

COUNT = 4
TRAINERS = read_trainers(BLOCKS.read_text(encoding="utf-8"))
SHOWN = shown_line(BLOCKS.read_text(encoding="utf-8"))
PAGE = pathlib.Path(__file__).parents[2] / "docs" / "howto" / "train.md"


def cleanrl(name: str) -> gym.Env[Any, Any]:
    """As CleanRL's continuous PPO wraps what it makes."""
    env: gym.Env[Any, Any] = gym.make(f"aquafish_gym:{name}", engine="numba", fin_angles="random")
    env = wrappers.FlattenObservation(env)
    env = wrappers.RecordEpisodeStatistics(env)
    env = wrappers.ClipAction(env)
    env = wrappers.NormalizeObservation(env)
    env = wrappers.TransformObservation(env, lambda o: o.clip(-10, 10), env.observation_space)
    env = wrappers.NormalizeReward(env, gamma=0.99)
    return wrappers.TransformReward(env, lambda r: float(np.clip(r, -10, 10)))


def batch(name: str, **kwargs: Any) -> gym.vector.VectorEnv[Any, Any, Any]:
    """The same of the batched environment, by Gymnasium's vector wrappers."""
    envs: gym.vector.VectorEnv[Any, Any, Any] = gym.make_vec(name, num_envs=COUNT, **kwargs)
    return several.NormalizeReward(
        several.NormalizeObservation(several.RecordEpisodeStatistics(envs))
    )


@pytest.mark.parametrize("native", [False, True])
@pytest.mark.parametrize("name", ["AquaFish-v0", "AquaFishReturn-v0"])
def test_the_loop_of_cleanrl(name: str, native: bool) -> None:
    envs: Any = batch(name) if native else SyncVectorEnv([lambda: cleanrl(name)] * COUNT)
    assert isinstance(envs.single_action_space, gym.spaces.Box)
    size = int(np.prod(envs.single_observation_space.shape))
    seen, _ = envs.reset(seed=1)
    rng, returns = np.random.default_rng(0), []
    lasts = 100 if name == "AquaFish-v0" else 300
    for step in range(lasts + 5):
        actions = rng.normal(0.0, 1.0, (COUNT, 3)).astype(np.float32)
        seen, rewards, terminations, truncations, infos = envs.step(actions)
        assert seen.shape == (COUNT, size)
        assert np.isfinite(seen).all()
        assert rewards.shape == (COUNT,)
        done = np.logical_or(terminations, truncations)
        assert done.tolist() == [step == lasts - 1] * COUNT
        if "episode" in infos:
            returns += infos["episode"]["r"][infos["_episode"]].tolist()
            assert infos["episode"]["l"].tolist() == [lasts] * COUNT
    assert len(set(returns)) == COUNT
    envs.close()


@pytest.mark.parametrize("name", ["AquaFish-v0", "AquaFishReturn-v0"])
def test_stable_baselines(name: str) -> None:
    pytest.importorskip("stable_baselines3")
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_util import make_vec_env

    kwargs = {"engine": "numba", "fin_angles": "random"}
    envs = make_vec_env(name, n_envs=2, seed=0, env_kwargs=kwargs)
    model = PPO("MlpPolicy", envs, n_steps=320, batch_size=64, n_epochs=1, device="cpu", seed=0)
    model.learn(640)
    assert model.num_timesteps == 640
    assert len(model.ep_info_buffer) >= 2
    lengths = {episode["l"] for episode in model.ep_info_buffer}
    assert lengths == {100 if name == "AquaFish-v0" else 300}


@pytest.mark.slow
def test_a_video_of_one_and_of_several(tmp_path: pathlib.Path) -> None:
    pytest.importorskip("moviepy")
    env = gym.make("AquaFish-v0", engine="numba", render_mode="rgb_array", frame_skip=1000)
    one = wrappers.RecordVideo(env, str(tmp_path / "one"), episode_trigger=lambda _: True)
    one.reset(seed=0)
    over = False
    while not over:
        *_, over, _ = one.step(one.action_space.sample())
    one.close()
    envs = gym.make_vec("AquaFish-v0", num_envs=2, render_mode="rgb_array", frame_skip=1000)
    two = several.RecordVideo(envs, str(tmp_path / "two"), episode_trigger=lambda _: True)
    two.reset(seed=0)
    for _ in range(3):
        two.step(two.action_space.sample())
    two.close()
    for folder, episodes in (("one", 1), ("two", 2)):
        films = list((tmp_path / folder).glob("*.mp4"))
        assert len(films) == episodes
        assert all(film.stat().st_size > 1000 for film in films)


@pytest.mark.parametrize("mode", ["SameStep", "Disabled"])
@pytest.mark.parametrize("name", ["AquaFish-v0", "AquaFishReturn-v0"])
def test_torchrl_wraps_a_batch(name: str, mode: str) -> None:
    pytest.importorskip("torchrl")
    from torchrl.envs import GymWrapper
    from torchrl.envs.utils import check_env_specs

    def make(**kwargs: Any) -> Any:
        kwargs = {"fin_angles": "random", "max_episode_steps": 20, **kwargs}
        return gym.make_vec(name, num_envs=COUNT, **kwargs)

    env = GymWrapper(make(autoreset_mode=mode))
    check_env_specs(env)
    env.set_seed(0)
    found = env.rollout(45, break_when_any_done=False)
    assert found.batch_size == (COUNT, 45)
    ends = found["next", "done"].squeeze(-1).numpy()
    assert (ends == (np.arange(1, 46) % 20 == 0)).all()
    # What follows the last action of an episode is its end, not the start of the next one.
    after, before = (found[key].numpy() for key in (("next", "observation"), "observation"))
    assert (after[:, :-1] == before[:, 1:]).all(axis=-1).tolist() == (~ends[:, :-1]).tolist()
    assert np.isfinite(found["next", "reward"].numpy()).all()


FEW = {
    "ppo": ["n_envs:2", "n_steps:100", "batch_size:100"],
    "sac": ["n_envs:2", "learning_starts:100", "batch_size:16"],
    "ppo_lstm": ["n_envs:2", "n_steps:100", "batch_size:100"],
}


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", FEW)
def test_rl_zoo_trains_and_keeps_what_it_learned(tmp_path: pathlib.Path, algorithm: str) -> None:
    """By the command that the page shows, in short."""
    pytest.importorskip("rl_zoo3")
    text = PAGE.read_text(encoding="utf-8")
    (line,) = re.findall(r"^python (-m rl_zoo3.train .*)$", text, re.MULTILINE)
    line = line.replace("--algo ppo ", f"--algo {algorithm} ")
    line = line.replace("rl_zoo_ppo.yml", f"rl_zoo_{algorithm}.yml")
    words = [*shlex.split(line), "-n", "512", "-f", str(tmp_path / "logs"), "--hyperparams"]
    words += FEW[algorithm]
    root = PAGE.parents[2]
    done = subprocess.run([sys.executable, *words], cwd=root, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert list(tmp_path.rglob("AquaFish-v0.zip"))
    settings = (root / "examples" / f"rl_zoo_{algorithm}.yml").read_text()
    assert re.findall(r"^(\S+-v0):", settings, re.M) == list(IDS)


@pytest.mark.parametrize(("trainer", "package"), [("torchrl", "torchrl"), ("minari", "minari")])
def test_a_block_of_the_page_scores_its_policy(
    trainer: str, package: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip(package)
    monkeypatch.chdir(PAGE.parents[2])
    exec(compile(TRAINERS[trainer].code, trainer, "exec"), {"__name__": "trainers"})
    assert score(capsys.readouterr().out, SHOWN)


@pytest.mark.slow
def test_a_minari_dataset(tmp_path: pathlib.Path) -> None:
    """Its infos hold the truth, with the same keys at a reset as after a step."""
    minari = pytest.importorskip("minari")
    pytest.importorskip("jax")
    body = Morphology.nominal()
    still = Controller(np.zeros((3, 14)), np.zeros(3), np.ones(3), 0.7, body, 0, interval=20)
    still.save(tmp_path / "controller.json")
    example = pathlib.Path(__file__).parents[2] / "examples" / "minari_dataset.py"
    code = [sys.executable, str(example), str(tmp_path / "controller.json")]
    code += ["--out", str(tmp_path / "sets"), "--episodes", "2", "--damage", "caudal:missing@2"]
    done = subprocess.run(code, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("2 episodes, 200 steps, mean return")
    dataset = minari.load_dataset(str(tmp_path / "sets" / "aquafish" / "damaged-v0"))
    (first, second) = dataset.iterate_episodes()
    assert first.infos["faults"].tolist() == [0] * 10 + [1] * 91
    assert first.infos["fin_angles"].shape == (101, 3)
    assert (first.observations[0] == second.observations[0]).all()  # upright, at rest
    assert (first.infos["fin_angles"][0] != second.infos["fin_angles"][0]).all()
    again = subprocess.run(code, capture_output=True, text=True, check=False)
    assert again.returncode == 2
    assert "name must be a new one" in again.stderr


def test_the_dataset_that_is_here_can_be_swum_again() -> None:
    """What the environment answers to its actions is what it says, in every episode."""
    minari = pytest.importorskip("minari")
    folder = pathlib.Path(__file__).parents[2] / "docs" / "results" / "minari"
    dataset = minari.load_dataset(str(folder / "aquafish" / "damaged-v0"))
    env = dataset.recover_environment()
    assert dataset.total_episodes == 10
    for seed, episode in enumerate(dataset.iterate_episodes()):
        seen, info = env.reset(seed=seed)
        rows, earned = [seen], []
        for action in episode.actions:
            seen, reward, *_, info = env.step(action)
            rows.append(seen)
            earned.append(reward)
        np.testing.assert_allclose(rows, episode.observations, rtol=1e-4, atol=1e-4)
        np.testing.assert_allclose(earned, episode.rewards, rtol=1e-4, atol=1e-4)
        assert info["faults"] == episode.infos["faults"][-1] > 0


def test_each_trainer_has_a_block_of_at_most_15_lines() -> None:
    lengths = {name: len(one.code.splitlines()) for name, one in TRAINERS.items()}
    names = "stable-baselines3 cleanrl torchrl skrl tianshou rllib minari"
    assert list(lengths) == names.split()
    assert max(lengths.values()) <= 15
    assert all("print(evaluate(" in one.code for one in TRAINERS.values())


def test_a_score_is_found_by_its_form() -> None:
    assert form(SHOWN) == "# [#, #] in # episodes"
    assert score("50%\r100%\n-0.4 [-1.0, 1.4] in 10 episodes\nclosed\n", SHOWN) == (
        "-0.4 [-1.0, 1.4] in 10 episodes"
    )
    assert score("nan [nan, nan] in 10 episodes\n", SHOWN) is None


@pytest.mark.parametrize(
    ("code", "status"),
    [(f"print({SHOWN!r})", 0), ("print('trained')", 1), ("raise ValueError('no such env')", 1)],
)
def test_the_command_fails_where_a_block_does(
    code: str, status: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    block = Trainer("Mine", "-e .", "py", code)
    monkeypatch.setattr(command, "read_trainers", lambda _: {"mine": block})
    monkeypatch.setattr(command, "install", lambda *_: pathlib.Path(sys.executable))
    assert command.main(["Mine"]) == status
    said = capsys.readouterr()
    assert (f"Mine: {SHOWN}" in said.out) == (status == 0)
    assert ("failed: mine" in said.err) == (status == 1)
