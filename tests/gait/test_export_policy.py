"""Policies of stable-baselines3 in C: the same bits as stated, and near those of PyTorch."""

from __future__ import annotations

import base64
import io
import json
import pickle
import shlex
import subprocess
import sys
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import aquafish_gym  # noqa: F401  # registers the environments
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.__main__ import main
from gait.controllers import export_policy
from gait.controllers.export_policy import policy_file
from gait.controllers.sb3_policy import SQUASHED
from gait.controllers.sb3_zip import read_policy
from test_export import CC, LIMITS_OF_AVR, STRICT, build, make_wrong, needs_cc

sb3 = pytest.importorskip("stable_baselines3")
contrib = pytest.importorskip("sb3_contrib")
torch = pytest.importorskip("torch")
vec_env = pytest.importorskip("stable_baselines3.common.vec_env")

CONTINUOUS = ("PPO", "SAC", "TD3", "A2C", "TQC", "DDPG", "TRPO")
DISCRETE = ("PPO", "A2C", "TRPO")
ENVIRONMENTS = {
    "Pendulum-v1": CONTINUOUS,
    "MountainCarContinuous-v0": CONTINUOUS,
    "AquaFish-v0": CONTINUOUS,
    "CartPole-v1": DISCRETE,
    "Acrobot-v1": DISCRETE,
}
SANITIZERS = ("-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
ACTIVATIONS = ("Tanh", "ReLU", "LeakyReLU", "ELU", "SiLU")


def make_model(algorithm: str, env: Any, seed: int, **keywords: Any) -> Any:
    """Return a policy with random weights, whose outputs have the size of 1."""
    sizes: dict[str, Any] = {"n_steps": 4}
    if algorithm in ("PPO", "TRPO"):
        sizes["batch_size"] = 4
    if algorithm in ("SAC", "TQC", "TD3", "DDPG"):
        sizes = {"buffer_size": 1}
    model = getattr(contrib if algorithm in ("TQC", "TRPO") else sb3, algorithm)(
        "MlpPolicy", env, device="cpu", seed=seed, policy_kwargs=keywords, **sizes
    )
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for parameter in model.policy.parameters():
            size = 1.5 / parameter.shape[1] ** 0.5 if parameter.ndim == 2 else 0.3
            parameter.copy_(size * torch.randn(parameter.shape, generator=generator))
    return model


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the file of a small policy."""
    path = tmp_path_factory.mktemp("policy") / "policy.zip"
    make_model("PPO", "Pendulum-v1", 0, net_arch=[4]).save(path)
    return path


def read_back(model: Any, folder: Path, *numbers: Any, **options: Any) -> Any:
    """Return what is read of a model's file."""
    model.save(folder / "policy.zip")
    return read_policy(folder / "policy.zip", *numbers, **options)


def assert_acts_as(policy: Any, model: Any) -> None:
    seen = np.random.default_rng(0).standard_normal((20, 3)).astype(np.float32)
    expected, _ = model.predict(seen, deterministic=True)
    np.testing.assert_allclose(policy.act(seen), expected, atol=1e-5)


def build_all(sources: list[Path]) -> list[str]:
    """Compile exported files as one program, for speed; return what each one's self-test prints."""
    lines = []
    for source in sources:
        name = source.stem
        lines += [f"#define {name}_TEST", f"#define main {name}_main", f'#include "{name}.c"']
        lines += ["#undef main"]
    names = ", ".join(f"{source.stem}_main" for source in sources)
    lines += [
        f"static int (*const tests[])(void) = {{{names}}};",
        "int main(int count, char **words)",
        "{",
        "    return tests[words[count - 1][0] - '0']();",
        "}",
    ]
    whole = sources[0].with_name("all.c")
    whole.write_text("\n".join(lines) + "\n")
    program = whole.with_suffix("")
    whole.with_name("float.h").write_text(LIMITS_OF_AVR)  # a policy does without double
    flags = [*STRICT, *SANITIZERS, "-fsingle-precision-constant"]
    subprocess.run([str(CC), *flags, str(whole), "-lm", "-o", str(program)], check=True)
    printed = []
    for i, source in enumerate(sources):
        with source.with_suffix(".csv").open() as vectors:
            ran = subprocess.run([program, str(i)], stdin=vectors, capture_output=True, text=True)
        printed.append(ran.stdout + ran.stderr)
    return printed


@needs_cc
@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_random_policies_are_equal_to_the_bit(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(export_policy, "VECTOR_COUNT", 200)
    env = vec_env.DummyVecEnv([lambda: gym.make(name)])
    rng = np.random.default_rng(5)
    different = []
    sources = []
    for i in range(5):
        algorithm = ENVIRONMENTS[name][i % len(ENVIRONMENTS[name])]
        keywords: dict[str, Any] = {"net_arch": rng.integers(4, 20, rng.integers(0, 4)).tolist()}
        if i >= 3:  # before, the algorithm's own
            keywords["activation_fn"] = getattr(torch.nn, ACTIVATIONS[i % len(ACTIVATIONS)])
        model = make_model(algorithm, env, i, **keywords)
        file = tmp_path / "policy.zip"
        model.save(file)
        normal = None
        numbers = None
        if i % 2:
            normal = vec_env.VecNormalize(env, clip_obs=float("inf") if i == 1 else 2.0)
            normal.obs_rms.mean = rng.normal(0.0, 3.0, env.observation_space.shape)
            normal.obs_rms.var = rng.uniform(0.1, 9.0, env.observation_space.shape)
            numbers = tmp_path / "normalize.npz"
            one = normal.obs_rms
            np.savez(numbers, mean=one.mean, var=one.var, epsilon=1e-8, clip=normal.clip_obs)
        policy = read_policy(file, numbers)
        source, _, table = policy_file(policy, tmp_path / f"policy{i}.c").write()
        sources.append(source)
        rows = np.loadtxt(table, delimiter=",", skiprows=1, dtype=np.float32)
        seen, actions = np.split(rows, [policy.widths[0]], axis=1)
        different.append(len(np.unique(actions)))
        given = seen if normal is None else normal.normalize_obs(seen).astype(np.float32)
        expected, _ = model.predict(given, deterministic=True)
        if ENVIRONMENTS[name] == DISCRETE:
            # Where two outputs are nearly equal, another order of sums may choose the other.
            assert np.mean(actions[:, 0] == expected) > 0.98
        else:
            np.testing.assert_allclose(actions, expected, rtol=1e-5, atol=2e-5)
    assert np.median(different) >= (2 if ENVIRONMENTS[name] == DISCRETE else 100)
    assert build_all(sources) == 5 * ["200 steps, 0 numbers differ, by at most 0\n"]


@pytest.mark.slow
@needs_cc
def test_the_self_test_of_a_policy_sees_a_wrong_number(pendulum: Path, tmp_path: Path) -> None:
    source, _, table = policy_file(read_policy(pendulum), tmp_path / "policy.c").write()
    assert table.read_text().startswith("observation_0,observation_1,observation_2,action_0\n")
    make_wrong(table, np.float32, -1)
    assert build(source).stdout.startswith("1000 steps, 1 numbers differ, by at most ")


def test_the_command_writes_a_policy_and_writes_it_again(
    pendulum: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    numbers, source = tmp_path / "normalize.npz", tmp_path / "policy.c"
    np.savez(numbers, mean=np.zeros(3), var=np.ones(3), epsilon=1e-8, clip=10.0)
    words = ["export", str(pendulum), "--c", str(source), "--normalize", str(numbers)]
    for _ in range(2):
        assert main(words) == 0
        assert len(capsys.readouterr().out.splitlines()) == 3
    text = source.read_text() + source.with_suffix(".h").read_text()
    assert "$" not in text
    assert "NAME" not in text
    assert "malloc" not in text
    assert "within 10 of 0" in text


@needs_cc
def test_the_commands_and_the_program_on_the_page_work(
    pendulum: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = (Path(__file__).parents[2] / "docs" / "howto" / "export.md").read_text(encoding="utf-8")
    page = page.partition("\n## A policy of Stable-Baselines3\n")[2]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "policy.zip").write_bytes(pendulum.read_bytes())
    np.savez("normalize.npz", mean=np.zeros(3), var=np.ones(3), epsilon=1e-8, clip=10.0)
    export, check = page.split("```sh\n")[1].split("```")[0].splitlines()
    assert main(shlex.split(export.removeprefix("aquafish "))) == 0
    checked = subprocess.run(check, shell=True, capture_output=True, text=True, check=True)
    assert checked.stdout.startswith("1000 steps, 0 numbers differ")
    Path("main.c").write_text(page.split("```c\n")[1].split("```")[0])
    subprocess.run([str(CC), *STRICT, "-c", "main.c"], check=True)
    subprocess.run([str(CC), *STRICT, "-Wmissing-prototypes", "-c", "policy.c"], check=True)


class Trap:
    """An object whose pickle writes a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return (Path.touch, (self.path,))


def rewritten(path: Path, name: str, content: bytes, into: Path) -> Path:
    """Return a copy of a zip with other content of one member."""
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(into, "w") as new:
        for member in old.namelist():
            new.writestr(member, content if member == name else old.read(member))
    return into


def test_no_pickle_is_loaded(pendulum: Path, tmp_path: Path) -> None:
    sprung = tmp_path / "sprung"
    trap = pickle.dumps(Trap(sprung))
    with zipfile.ZipFile(pendulum) as archive:
        data = json.loads(archive.read("data"))
    for entry in data.values():
        if isinstance(entry, dict) and ":serialized:" in entry:
            entry[":serialized:"] = base64.b64encode(trap).decode()
    read_policy(rewritten(pendulum, "data", json.dumps(data).encode(), tmp_path / "a.zip"))
    content = io.BytesIO()
    torch.save({"action_net.weight": Trap(sprung)}, content)
    path = rewritten(pendulum, "policy.pth", content.getvalue(), tmp_path / "b.zip")
    with pytest.raises(InvalidArgumentError, match="must be a file of stable-baselines3"):
        read_policy(path)
    bare = rewritten(pendulum, "policy.pth", trap, tmp_path / "c.zip")
    with pytest.raises(InvalidArgumentError, match="must be a file of stable-baselines3"):
        read_policy(bare)
    assert not sprung.exists()


def changed(
    path: Path, into: Path, change: Callable[[Any, Any], object], zipped: bool = True
) -> Path:
    """Return a copy with other settings and weights, these zipped or as PyTorch did before 1.6."""
    with zipfile.ZipFile(path) as archive:
        data = json.loads(archive.read("data"))
        weights = torch.load(io.BytesIO(archive.read("policy.pth")), weights_only=True)
    change(data, weights)
    content = io.BytesIO()
    torch.save(weights, content, _use_new_zipfile_serialization=zipped)
    half = rewritten(path, "data", json.dumps(data).encode(), into.with_suffix(".half"))
    return rewritten(half, "policy.pth", content.getvalue(), into)


def _named(name: str, shape: tuple[int, ...] = (2, 2)) -> Callable[[Any, Any], object]:
    return lambda _, weights: weights.update({name: torch.zeros(shape)})


def _setting(entry: str, **values: Any) -> Callable[[Any, Any], object]:
    return lambda data, _: data[entry].update(values)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (_named("features_extractor.cnn.0.weight"), r"features_extractor\.cnn\.0\.weight is no"),
        (_named("lstm_actor.weight_ih_l0"), "lstm_actor.weight_ih_l0 is no dense layer"),
        (_named("mlp_extractor.policy_net.1.weight", (4,)), r"policy_net\.1\.weight is no dense"),
        (_named("mlp_extractor.policy_net.6.weight"), r"policy_net\.6\.weight is no dense layer"),
        (_named("mlp_extractor.policy_net.0.weight", (4, 3, 1, 1)), r"policy_net\.0 must have"),
        (_named("mlp_extractor.policy_net.0.weight", (4, 2)), r"policy_net\.0 must have 3 inputs"),
        (_named("action_net.weight", (1, 5)), "action_net must have 4 inputs"),
        (lambda _, w: w.pop("action_net.weight"), "the policy must be one of PPO, A2C or TRPO;"),
        (lambda _, w: w.pop("action_net.bias"), "action_net.bias must be a tensor of float32"),
        (lambda _, w: w["action_net.bias"].fill_(np.nan), "action_net.bias must be finite"),
        (lambda _, w: w.update({"action_net.bias": w["action_net.bias"].double()}), "float32"),
        (_setting("policy_kwargs", activation_fn="<class 'torch.nn.modules.activation.GELU'>"),
         "activation_fn must be one of Tanh, ReLU, LeakyReLU, ELU, SiLU; got 'GELU'"),
        (_setting("policy_kwargs", activation_fn="<class '__main__.Tanh'>"),
         "activation must be one of Tanh, .* own activation_fn does, .*__main__.Tanh.*; got none"),
        (_setting("policy_kwargs", features_extractor_class="<class 'Mine'>"), "FlattenExtractor"),
        (_setting("policy_kwargs", dropout=0.5), "policy_kwargs must be one of"),
        (_setting("policy_kwargs", squash_output="?"), "squash_output must be True or False"),
        (_setting("policy_class", __module__="sb3_contrib.common"), "policy_class must be one of"),
        (_setting("observation_space", **{":type:": "<class 'gymnasium.spaces.dict.Dict'>"}),
         "the class of observation_space must be one of Box; got 'Dict'"),
        (_setting("observation_space", _shape=[3, 1, 1], dtype="uint8"), "it is of images"),
        (_setting("action_space", low="[-inf]"), "action_space's low must be 1 finite numbers"),
        (_setting("action_space", high="[-3.]"), "action_space must have each bound low below"),
        (lambda data, _: data.pop("policy_kwargs"), "policy_kwargs must be an object"),
    ],
)  # fmt: skip
def test_what_is_no_policy_of_dense_layers_is_refused_by_name(
    change: Callable[[Any, Any], object], sentence: str, pendulum: Path, tmp_path: Path
) -> None:
    path = changed(pendulum, tmp_path / "changed.zip", change)
    with pytest.raises(InvalidArgumentError, match=sentence):
        read_policy(path)


@pytest.mark.parametrize(
    ("algorithm", "env", "keywords", "sentence"),
    [
        ("SAC", "Pendulum-v1", {"use_sde": True}, "actor.mu must be a dense layer; with use_sde"),
        ("DQN", "CartPole-v1", {}, "the policy must be one of PPO, A2C or TRPO; SAC or TQC; TD3"),
    ],
)
def test_other_algorithms_are_refused(
    algorithm: str, env: str, keywords: dict[str, Any], sentence: str, tmp_path: Path
) -> None:
    model = getattr(sb3, algorithm)("MlpPolicy", env, buffer_size=1, device="cpu", **keywords)
    with pytest.raises(InvalidArgumentError, match=sentence):
        read_back(model, tmp_path)


def test_the_means_of_exploration_by_state_are_exported(tmp_path: Path) -> None:
    model = sb3.A2C("MlpPolicy", "Pendulum-v1", use_sde=True, device="cpu", seed=0)
    assert_acts_as(read_back(model, tmp_path), model)


def as_before_gym_0_21(data: Any, _: Any) -> None:
    """Name things as the files of 2020 do."""
    for name in ("observation_space", "action_space"):
        space = data[name]
        space[":type:"] = space[":type:"].replace("gymnasium", "gym")
        space["shape"] = space.pop("_shape")
    data["policy_kwargs"].update(device="cpu", use_sde=False)


def as_shared(_: Any, weights: Any) -> None:
    """Name hidden layers as those that actor and critic shared until version 1.8."""
    for name in list(weights):
        if name.startswith("mlp_extractor.policy_net"):
            weights[name.replace("policy_net", "shared_net")] = weights.pop(name)
        elif name.startswith("mlp_extractor.value_net"):
            del weights[name]


def as_half_shared(_: Any, weights: Any) -> None:
    """Share the first hidden layer, and number the second from 0."""
    for part in ("weight", "bias"):
        first = weights.pop(f"mlp_extractor.policy_net.0.{part}")
        weights[f"mlp_extractor.policy_net.0.{part}"] = weights.pop(
            f"mlp_extractor.policy_net.2.{part}"
        )
        weights[f"mlp_extractor.shared_net.0.{part}"] = first


@pytest.mark.parametrize("zipped", [True, False])
@pytest.mark.parametrize("change", [as_before_gym_0_21, as_shared, as_half_shared])
def test_files_of_older_versions_are_read(
    change: Callable[[Any, Any], object], zipped: bool, tmp_path: Path
) -> None:
    make_model("PPO", "Pendulum-v1", 0, net_arch=[5, 4]).save(tmp_path / "new.zip")
    new = read_policy(tmp_path / "new.zip")
    path = changed(tmp_path / "new.zip", tmp_path / "old.zip", change, zipped)
    old = read_policy(path)
    assert old.widths == new.widths == (3, 5, 4, 1)
    seen = np.random.default_rng(0).standard_normal((20, 3)).astype(np.float32)
    assert np.array_equal(old.act(seen), new.act(seen))


def test_a_policy_is_read_without_pytorch(pendulum: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    assert read_policy(pendulum).widths == (3, 4, 1)


def test_outputs_that_a_setting_squashes_are_squashed(tmp_path: Path) -> None:
    model = make_model("PPO", vec_env.DummyVecEnv([lambda: gym.make("Pendulum-v1")]), 0)
    squashed = sb3.PPO(
        "MlpPolicy", "Pendulum-v1", use_sde=True, device="cpu", n_steps=4, batch_size=4,
        policy_kwargs={"squash_output": True},
    )  # fmt: skip
    squashed.policy.load_state_dict(
        {**squashed.policy.state_dict(), **{
            name: tensor for name, tensor in model.policy.state_dict().items() if name != "log_std"
        }}
    )  # fmt: skip
    policy = read_back(squashed, tmp_path)
    assert policy.output == SQUASHED
    assert_acts_as(policy, squashed)


class CountedFromOne(gym.Env[Any, Any]):
    """An environment whose choices have numbers from 1 on, which Stable-Baselines3 ignores."""

    observation_space = gym.spaces.Box(-1.0, 1.0, (3,))
    action_space = gym.spaces.Discrete(4, start=1)


def test_a_choice_is_the_one_that_the_model_predicts(tmp_path: Path) -> None:
    env = vec_env.DummyVecEnv([CountedFromOne])
    model = make_model("PPO", env, 1, net_arch=[8])
    seen = np.random.default_rng(0).standard_normal((200, 3)).astype(np.float32)
    chosen = read_back(model, tmp_path).act(seen)[:, 0]
    assert np.mean(chosen == model.predict(seen, deterministic=True)[0]) > 0.98
    assert set(chosen) == {0, 1, 2, 3}


def test_the_numbers_of_a_normalization_are_asked_for(tmp_path: Path) -> None:
    env = vec_env.VecNormalize(vec_env.DummyVecEnv([lambda: gym.make("Pendulum-v1")]))
    model = make_model("PPO", env, 0)
    model.learn(4)
    with pytest.raises(InvalidArgumentError, match="normalize must be an npz file of VecNorm"):
        read_back(model, tmp_path)
    assert read_policy(tmp_path / "policy.zip", "none").normalization is None
    source = tmp_path / "policy.c"
    words = ["export", str(tmp_path / "policy.zip"), "--c", str(source)]
    assert main(words) == 2
    assert main([*words, "--normalize", "none"]) == 0
    assert "VecNormalize" not in source.with_suffix(".h").read_text()


class OwnLeakyReLU(torch.nn.LeakyReLU):  # type: ignore[misc, name-defined]
    """A function of a user's own."""


def test_an_activation_of_ones_own_is_asked_for(tmp_path: Path) -> None:
    model = make_model("SAC", "Pendulum-v1", 0, net_arch=[6], activation_fn=OwnLeakyReLU)
    with pytest.raises(InvalidArgumentError, match=r"activation must be one of .*; got none"):
        read_back(model, tmp_path)
    assert_acts_as(read_back(model, tmp_path, activation="LeakyReLU"), model)
    words = ["export", str(tmp_path / "policy.zip"), "--c", str(tmp_path / "policy.c")]
    assert main([*words, "--activation", "LeakyReLU"]) == 0


def test_an_activation_is_not_contradicted(pendulum: Path) -> None:
    assert read_policy(pendulum, activation="Tanh").activation == "Tanh"
    with pytest.raises(InvalidArgumentError, match=r"activation must be Tanh, as .*; got ReLU"):
        read_policy(pendulum, activation="ReLU")


class Wide(gym.Env[Any, Any]):
    """An environment whose actions have bounds with a difference beyond float32."""

    observation_space = gym.spaces.Box(-1.0, 1.0, (3,))
    action_space = gym.spaces.Box(np.float32(-3e38), np.float32(3e38), (1,))


def test_an_action_that_can_be_infinite_is_refused(tmp_path: Path) -> None:
    env = vec_env.DummyVecEnv([Wide])
    with pytest.raises(InvalidArgumentError, match=r"bounds within 1e\+38 of 0, .* got 3e\+38"):
        read_back(make_model("SAC", env, 0, net_arch=[4]), tmp_path)
    policy = read_back(make_model("PPO", env, 0, net_arch=[4]), tmp_path)  # clips
    assert np.isfinite(policy.act(np.full((1, 3), 1e3, np.float32))).all()


def many_layers(_: Any, weights: Any) -> None:
    """Put 600 layers of a million numbers each, which are all one number, or all one storage."""
    place = "mlp_extractor.policy_net"
    one = torch.zeros(1000, 1000)
    weights.update({f"{place}.0.weight": torch.zeros(1000, 3), f"{place}.0.bias": one[0]})
    for i in range(2, 1200, 2):
        weights.update({f"{place}.{i}.weight": one, f"{place}.{i}.bias": one[0]})


def repeated_number(_: Any, weights: Any) -> None:
    weights["action_net.weight"] = torch.zeros(1).expand(1, 4)


def wide_layers(_: Any, weights: Any) -> None:
    weights["mlp_extractor.policy_net.0.weight"] = torch.zeros(100_000, 3)
    weights["mlp_extractor.policy_net.0.bias"] = torch.zeros(100_000)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (many_layers, "the layers must have at most 2000000 weights and biases; they have 599"),
        (repeated_number, "action_net.weight must be stored by itself, row by row"),
        (wide_layers, r"net\.0 must have at most 16384 inputs and outputs; it has \(100000, 3\)"),
    ],
)
def test_layers_of_too_many_numbers_are_refused_before_they_take_memory(
    change: Callable[[Any, Any], object], sentence: str, pendulum: Path, tmp_path: Path
) -> None:
    path = changed(pendulum, tmp_path / "changed.zip", change)
    tracemalloc.start()
    try:
        with pytest.raises(InvalidArgumentError, match=sentence):
            read_policy(path)
        assert tracemalloc.get_traced_memory()[1] < 30e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("numbers", "sentence"),
    [
        ({}, "must hold the arrays clip, epsilon, mean, var and no others"),
        ({"mean": np.zeros(2)}, r"must have mean of shape \(3,\)"),
        ({"mean": np.full(3, np.nan)}, "must have finite mean"),
        ({"var": np.full(3, -1.0)}, "and var \\+ epsilon above 0"),
        ({"clip": 0.0}, "must have clip above 0; got 0"),
    ],
)
def test_wrong_numbers_of_a_normalization_are_refused(
    numbers: dict[str, Any], sentence: str, pendulum: Path, tmp_path: Path
) -> None:
    right = {"mean": np.zeros(3), "var": np.ones(3), "epsilon": 1e-8, "clip": 10.0}
    np.savez(tmp_path / "n.npz", **({**right, **numbers} if numbers else {}))
    with pytest.raises(InvalidArgumentError, match=sentence):
        read_policy(pendulum, tmp_path / "n.npz")


def test_a_layer_that_exceeds_float32_is_named(pendulum: Path, tmp_path: Path) -> None:
    path = changed(
        pendulum, tmp_path / "huge.zip", lambda _, weights: weights["action_net.weight"].fill_(3e38)
    )
    with pytest.raises(InvalidArgumentError, match="action_net must have outputs in the range"):
        policy_file(read_policy(path), tmp_path / "a.c")


def test_a_wrong_export_of_a_policy_is_refused_and_writes_nothing(
    pendulum: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """``test_export.py`` has what a controller refuses, too."""
    monkeypatch.chdir(tmp_path)
    for words, sentence in (
        ("--c a.c --model b.c", "--model takes the body of a controller.json; a policy"),
        ("--c 2a.c", "c must be a file name FILE.c"),
        ("--c a.c --normalize none.npz", "normalize must be a file that can be read"),
    ):
        assert main(["export", str(pendulum), *words.split()]) == 2
        assert sentence in capsys.readouterr().err
        assert list(tmp_path.iterdir()) == []
