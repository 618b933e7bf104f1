"""A specification is true, and what is written of it makes the same environment, or is refused."""

from __future__ import annotations

import copy
import json
import subprocess
import sys
from enum import IntEnum, StrEnum
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from fault_fakes import swim
from gymnasium.envs.registration import EnvSpec
from gymnasium.wrappers import TimeLimit
from tasks_of_ones_own import Along, Axis, Engine, Kept, Plain

import aquafish_gym
from aquafish_gym import Damage, FaultWrapper, Morphology, VectorFaultWrapper, tasks
from aquafish_gym.envs.autoreset import AutoresetMode
from aquafish_gym.envs.env import AquaFishEnv
from aquafish_gym.envs.tasks import TASKS, SwimForward
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.plans import BodyPlan
from aquafish_gym.utils.validation import InvalidArgumentError
from tests.plans import ODD


class Which(StrEnum):
    NUMBA = "numba"
    FORWARD = "forward"


class Skip(IntEnum):
    TEN = 10


def read_again(env: Any) -> EnvSpec:
    return EnvSpec.from_json(json.dumps(json.loads(env.spec.to_json())))


KWARGS: list[dict[str, Any]] = [
    {"morphology": Morphology.coerce({"caudal": (0.1, 2.0, 1.0)})},
    {"morphology": Morphology.nominal().to_array() * np.float32(0.9)},
    {"morphology": {"caudal": np.array([0.1, 2.0, 1.0])}},
    {"damage": Damage.parse("random:severe@2-10; gyro_x:delay=0.4@1")},
    {"damage": list(Damage.parse("caudal:seized@1+2;gyro_z:bias=0.1"))},
    {"damage": Damage.parse("caudal:seized@1+2;gyro_z:bias=0.1").to_list()},
    {"engine": Engine},
    {"engine": Which.NUMBA, "task": Which.FORWARD},
    {"current": np.array([0.1, 0.0, -0.1], np.float32)},
    {"current": (np.float32(0.1), 0, np.float64(0.2))},
    {"fin_angles": np.array([0.1, 0.2, 0.3])},
    {"fin_angles": range(3)},
    {"observe_fins": np.bool_(True), "reactive": np.bool_(True)},
    {"frame_skip": np.int64(40)},
    {"plan": "four-fins"},
    {"plan": ODD},
    {"frame_skip": Skip.TEN, "observe_fins": np.str_("reckoned")},
    *({"task": task} for task in TASKS.values()),
    {"task": SwimForward(seconds=np.float64(6), forward_weight=2, ctrl_weight=np.float32(0.5))},  # type: ignore[arg-type]
    {"task": tasks.HoldStation(turning=0.2), "damage": "caudal:missing@30"},
    {"task": Along((1, 2.5, 0), axis=Axis.X)},
    {"task": Along(np.array([1.0, 0.0, 2.0]))},  # type: ignore[arg-type]
    {"task": Plain(0.1)},
    {"task": Kept(given={"a": [1, None, "b"]}, seconds=4.0)},
]


@pytest.mark.parametrize("kwargs", KWARGS, ids=lambda one: "-".join(one))
def test_what_is_written_makes_the_same_environment(kwargs: dict[str, Any]) -> None:
    made = {"engine": "numba", **kwargs}
    env = gym.make("AquaFish-v0", **made)
    spec = read_again(env)
    again = gym.make(spec)
    assert swim(env, 12) == swim(again, 12)
    assert vars(env.unwrapped.task) == vars(again.unwrapped.task)
    assert type(env.unwrapped.task) is type(again.unwrapped.task)
    assert spec.max_episode_steps == env.spec.max_episode_steps
    assert read_again(again) == spec
    still = np.zeros(env.action_space.shape)
    several = FaultWrapper(env, "observation:noise=0.1", dt=np.float32(0.5), neutral=still)
    assert swim(several, 12) == swim(gym.make(read_again(several)), 12)


@pytest.mark.parametrize("name", [name for name in aquafish_gym.IDS if "AquaFish" in name])
def test_what_is_read_equals_what_was_written(name: str) -> None:
    for kwargs in KWARGS:
        flows = "current" in kwargs and name in ("AquaFishStation-v0", "AquaFishReturn-v0")
        given = {"engine": "numba", "damage": None} | kwargs
        given |= {"task": "forward"} if flows else {}
        made = gym.make(name, **given)
        neutral = np.zeros(made.action_space.shape)
        for envs in (
            made,
            gym.make(name, max_episode_steps=7, **given),
            FaultWrapper(made, "observation:noise=0.1", dt=np.float32(0.5), neutral=neutral),
            gym.make_vec(name, num_envs=2, autoreset_mode=AutoresetMode.SAME_STEP, **given),
        ):
            spec = envs.spec
            assert spec is not None
            assert read_again(envs) == spec
            assert spec == read_again(envs)
            assert spec == copy.deepcopy(spec)
            other = copy.deepcopy(spec)
            other.kwargs["frame_skip"] = 7
            assert read_again(envs) != other


def test_a_plan_of_a_file_is_written_itself(tmp_path: Path) -> None:
    path = tmp_path / "odd.json"
    path.write_text(ODD.to_json())
    env = gym.make("AquaFish-v0", plan=str(path), engine="numba")
    envs = gym.make_vec("AquaFish-v0", num_envs=2, plan=str(path))
    path.unlink()
    for one, make in ((env, gym.make), (envs, gym.make_vec)):
        written = json.loads(one.spec.to_json())["kwargs"]["plan"]
        assert BodyPlan.from_dict(written) == ODD
        assert make(read_again(one)).unwrapped.plan == ODD
        assert make(one.spec).unwrapped.plan == ODD
    assert gym.make(envs.get_attr("spec")[1]).unwrapped.plan == ODD
    assert json.loads(gym.make("FourFins-v0").spec.to_json())["kwargs"]["plan"] == "four-fins"


def test_specifications_that_cannot_be_written_are_equal_by_what_they_hold() -> None:
    spec = gym.make("AquaFish-v0", engine="numba", task=Kept(given=(1, 2))).spec
    assert spec == copy.deepcopy(spec)
    assert spec != gym.make("AquaFish-v0", engine="numba", task=Kept(given=(1, 3))).spec
    assert spec != "AquaFish-v0"


def test_a_batch_is_read_again_too() -> None:
    bodies = np.array([Morphology.nominal().to_array()] * 2) * [[1.0], [0.9]]
    envs = gym.make_vec(
        "AquaFish-v0",
        num_envs=2,
        morphology=bodies,
        task=Along(),
        autoreset_mode=AutoresetMode.SAME_STEP,
        damage=[Damage.parse("gyro_x:hold=0.5@1"), "none"],
        threads=np.int64(1),
        max_episode_steps=7,
    )
    again = gym.make_vec(read_again(envs))
    assert read_again(again) == envs.spec == again.spec
    for each in (envs, again):
        each.reset(seed=0)
    assert again.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    for _ in range(9):
        one, two = (each.step(np.full((2, 3), 0.3)) for each in (envs, again))
        np.testing.assert_array_equal(one[0], two[0])
        np.testing.assert_array_equal(one[3], two[3])


def local_task() -> Any:
    class Hidden(Plain):
        pass

    return Hidden(0.1)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (local_task, "task cannot be written into a spec, as no other program could import"),
        (lambda: Kept(given=(1, 2)), r"task.given would be .* as \[1, 2\].*got \(1, 2\)"),
        (lambda: Kept(given=np.zeros(2)), "task.given would be read"),
        (lambda: Kept(given=np.sin), "task.given cannot be written as JSON"),
        (lambda: Kept(given=Axis.X), "task.given would be read"),
    ],
)  # fmt: skip
def test_what_could_not_be_read_is_refused_when_it_is_written(make: Any, message: str) -> None:
    env = gym.make("AquaFish-v0", engine="numba", task=make())
    assert env.spec is not None
    with pytest.raises(InvalidArgumentError, match=message):
        env.spec.to_json()
    assert swim(env, 5) == swim(gym.make(env.spec), 5)  # by itself it serves as before


def test_a_class_of_the_main_program_is_refused() -> None:
    code = (
        "import gymnasium as gym, aquafish_gym\n"
        "class Mine(aquafish_gym.tasks.SwimForward): pass\n"
        "env = gym.make('AquaFish-v0', engine='numba', task=Mine())\n"
        "try: env.spec.to_json()\n"
        "except ValueError as error: print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "no other program could import __main__:Mine" in done.stdout


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"task": {"radius": 3.0}}, "task must be a Task, its name, or an object of class and"),
        ({"task": {"class": "os:PathLike", "fields": {}}}, "must be the place of a Task"),
        ({"task": {"class": "no.such:Task", "fields": {}}}, "'no.such:Task' cannot be imported"),
        ({"task": {"class": "tasks_of_ones_own:Along", "fields": {"way": 1}}}, "cannot be made"),
        ({"engine": "no.such:World"}, "engine 'no.such:World' cannot be imported"),
        ({"engine": "os:PathLike"}, "engine must be the place of a World"),
    ],
)
def test_a_bad_specification_is_refused(kwargs: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidArgumentError, match=message):
        AquaFishEnv(**kwargs)


def test_an_entry_point_is_the_public_name() -> None:
    public = {spec.entry_point for name, spec in gym.registry.items() if name in aquafish_gym.IDS}
    assert public == {"aquafish_gym:AquaFishEnv"}
    spec = {"id": "AquaFish-v0", "entry_point": "aquafish_gym:AquaFishEnv",
            "additional_wrappers": [], "kwargs": {
        "engine": "numba", "damage": {"faults": Damage.parse("caudal:missing@2").to_list()}
    }}  # fmt: skip
    env = gym.make(EnvSpec.from_json(json.dumps(spec)))
    assert type(env.unwrapped) is AquaFishEnv
    assert swim(env, 12) == swim(AquaFishEnv(engine="numba", damage="caudal:missing@2"), 12)


@pytest.mark.parametrize("name", aquafish_gym.IDS)
def test_a_batch_refuses_an_episode_longer_than_the_task(name: str) -> None:
    lasts = 300 if "task" in aquafish_gym.IDS[name] else 100
    assert gym.make_vec(name, 2, max_episode_steps=lasts).spec.max_episode_steps == lasts
    with pytest.raises(InvalidArgumentError, match=rf"at most {lasts}.*got {lasts + 1}: .*"):
        gym.make_vec(name, 2, max_episode_steps=lasts + 1)


def test_a_limit_is_the_shorter_one() -> None:
    """By a specification, by an id of one's own, by another frame_skip; -1 asks for none."""
    gym.register("MyFish-v0", "aquafish_gym:AquaFishEnv", max_episode_steps=200)
    try:
        mine = [gym.make("MyFish-v0", engine="numba", frame_skip=skip) for skip in (20, 10, 5)]
        assert [env.spec.max_episode_steps for env in mine] == [100, 200, 200]
        assert gym.make("MyFish-v0", max_episode_steps=7).spec.max_episode_steps == 7
    finally:
        del gym.registry["MyFish-v0"]
    slow = gym.make("AquaFish-v0", frame_skip=5)
    assert gym.make(slow.spec, frame_skip=20).spec.max_episode_steps == 100
    assert gym.make("AquaFish-v0", max_episode_steps=-1).spec.max_episode_steps == 100
    longer = gym.make("AquaFish-v0", task=SwimForward(seconds=100.0), max_episode_steps=500)
    assert longer.spec.max_episode_steps == 500


@pytest.mark.parametrize(
    ("kwargs", "limit", "steps"),
    [
        ({}, None, 100),
        ({"frame_skip": 5}, None, 400),
        ({"frame_skip": 2000}, None, 1),
        ({"max_episode_steps": 50}, None, 50),
        ({"max_episode_steps": 150}, None, 100),
        ({}, 500, 100),
        ({}, 30, 30),
        ({"task": SwimForward(seconds=1.0)}, None, 5),
        ({"id": "AquaFishRecovery-v0"}, None, 300),
    ],
)
def test_a_specification_says_how_long_an_episode_is(
    kwargs: dict[str, Any], limit: int | None, steps: int
) -> None:
    env: Any = gym.make(**{"id": "AquaFish-v0", "engine": "numba", **kwargs})
    env = TimeLimit(env, limit) if limit else env
    assert env.spec.max_episode_steps == steps
    for each in (env, gym.make(env.spec)):
        each.reset(seed=0)
        ends = [each.step(np.zeros(3, np.float32))[3] for _ in range(steps)]
        assert ends == [False] * (steps - 1) + [True]


def test_damage_after_the_end_is_refused() -> None:
    """Of a short task; of a batch also after the limit of its steps, also in a reset."""
    short, late = {"max_episode_steps": 30}, "caudal:seized@10"
    refused = pytest.raises(
        InvalidArgumentError, match=r"before the episode ends at 6 s; got caudal"
    )
    for make in (
        lambda **kwargs: gym.make("AquaFish-v0", engine="numba", task=SwimForward(6.0), **kwargs),
        lambda **kwargs: gym.make_vec("AquaFish-v0", 2, **short, **kwargs),
    ):
        with refused:
            make(damage=late)
        env = make(damage="caudal:seized@5.8")
        with refused:
            env.reset(options={"damage": late})
        env.reset(options={"damage": "caudal:seized@5.8"})
    gym.make_vec("AquaFishRecovery-v0", 2, **short)  # may be late by chance


def test_an_onset_that_never_comes_is_refused() -> None:
    """Where several limits are, the first to come counts; in a batch, each environment's own."""
    for env in (
        TimeLimit(gym.make("AquaFish-v0", engine="numba"), 500),
        TimeLimit(gym.make("Pendulum-v1", max_episode_steps=400), 500),
        gym.make("Pendulum-v1", max_episode_steps=400),
    ):
        FaultWrapper(env, "action_0:dead@19")
        with pytest.raises(InvalidArgumentError, match="before the episode ends at 20 s"):
            FaultWrapper(env, "action_0:dead@20")
    for mode in ("sync", "async"):
        envs = gym.make_vec("Pendulum-v1", 2, mode, max_episode_steps=400)
        VectorFaultWrapper(envs, "action_0:dead@19")
        with pytest.raises(InvalidArgumentError, match="before the episode ends at 20 s"):
            VectorFaultWrapper(envs, "action_0:dead@20")
        envs.close()
    both = gym.vector.SyncVectorEnv(
        [lambda n=n: gym.make("Pendulum-v1", max_episode_steps=n) for n in (20, 400)]
    )
    VectorFaultWrapper(both, ["none", "action_0:dead@19"])
    with pytest.raises(InvalidArgumentError, match="before the episode ends at 1 s"):
        VectorFaultWrapper(both, ["action_0:dead@19", "none"])
    batch = AquaFishVectorEnv(2, max_episode_steps=50)
    with pytest.raises(InvalidArgumentError, match="before the episode ends at 10 s"):
        VectorFaultWrapper(batch, "action_0:dead@10")
    with pytest.raises(InvalidArgumentError, match="before the episode ends at 20 s"):
        FaultWrapper(AquaFishEnv(), "action_0:dead@20")


def test_a_worker_of_the_fork_server_knows_the_ids() -> None:
    """As a trainer's workers that cannot import the program which started them."""
    code = (
        "import multiprocessing as m, aquafish_gym, gymnasium as gym\n"
        "workers = m.get_context('forkserver').Pool(1)\n"
        "print(workers.apply(gym.spec, ['AquaFish-v0']).entry_point)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "aquafish_gym:AquaFishEnv", done.stderr
