"""Input that is unusual and valid is taken, and means what its plain form means."""

from __future__ import annotations

import array
import collections
import enum
import json
import types
from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from bad_values import CALM, Text
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import aquafish_gym
from aquafish_gym.damage import Damage, FinMissing
from aquafish_gym.envs.aquafish import AquaFishEnv
from aquafish_gym.envs.tasks import SwimForward
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.morphology import MAXIMA, Morphology

GO = np.array([0.5, -0.25, 0.75])
# Sizes that float16, Decimal and Fraction hold exactly.
BODY = [0.5, 1.5, 0.125, 0.25, 1.0, 0.5, 0.25, 2.0, 0.0]


class Five(enum.IntEnum):
    SKIP = 5


def read_only(numbers: Any) -> Any:
    found = np.array(numbers, float)
    found.setflags(write=False)
    return found


# Ways to write a row of numbers.
CONTAINERS: dict[str, Callable[[list[float]], Any]] = {
    "tuple": tuple,
    "array": np.array,
    "single precision": lambda v: np.array(v, np.float32),
    "half precision": lambda v: np.array(v, np.float16),
    "long doubles": lambda v: np.array(v, np.longdouble),
    "big-endian": lambda v: np.array(v, ">f8"),
    "strided": lambda v: np.repeat(np.array(v), 2)[::2],
    "backwards": lambda v: np.array(v[::-1])[::-1],
    "read-only": read_only,
    "masked nowhere": lambda v: np.ma.masked_array(v),
    "array.array": lambda v: array.array("d", v),
    "a buffer of doubles": lambda v: np.frombuffer(np.array(v).tobytes()),
    "numpy scalars": lambda v: [np.float32(x) for x in v],
    "arrays of no dimension": lambda v: [np.array(x) for x in v],
    "decimals": lambda v: [Decimal(x) for x in v],
    "fractions": lambda v: tuple(Fraction(x) for x in v),
    "objects": lambda v: np.array([Fraction(x) for x in v], object),
}


@pytest.mark.parametrize("write", CONTAINERS.values(), ids=CONTAINERS)
def test_numbers_may_be_written_in_many_ways(write: Callable[[list[float]], Any]) -> None:
    assert Morphology.coerce(write(BODY)) == Morphology.coerce(BODY)
    size = Morphology(write(BODY[:3]), write(BODY[3:6]), write(BODY[6:]))
    assert size == Morphology.coerce(BODY)
    plain = AquaFishEnv(BODY, engine="numba", current=(0.5, -20.0, 20.0), fin_angles=(1.0, 2, -3))
    odd = AquaFishEnv(
        write(BODY),
        engine="numba",
        current=write([0.5, -20.0, 20.0]),
        fin_angles=write([1.0, 2.0, -3.0]),
    )
    plain.reset(seed=0)
    odd.reset(seed=0)
    assert (plain.step(GO)[0] == odd.step(write(GO.tolist()))[0]).all()
    commands, angles = [0.25, -0.5, 1.0], [1.0, 2.0, -3.0]
    one = aquafish_gym.simulate(BODY, commands, angles, steps=3)
    two = aquafish_gym.simulate(write(BODY), write(commands), write(angles), steps=3)
    assert one.rpy.tobytes() == two.rpy.tobytes()


WHOLE = [np.int8(5), np.uint64(5), np.int64(5), Five.SKIP]


@pytest.mark.parametrize("five", WHOLE, ids=repr)
def test_whole_numbers_may_be_numpys_or_names(five: Any) -> None:
    env = AquaFishEnv(engine="numba", frame_skip=five, fin_angles="random")
    first = env.reset(seed=five)[1]["fin_angles"]
    assert (first == env.reset(seed=5)[1]["fin_angles"]).all()
    assert aquafish_gym.simulate(None, GO / 2, steps=five, substeps=five).rpy.shape[1] == 5
    vector = AquaFishVectorEnv(five, frame_skip=five, threads=five)
    assert vector.reset(seed=five)[0].shape == (5, 9)
    listed = vector.reset(seed=[five, None, 2, 3, 2**64])
    assert listed[0].shape == (5, 9)
    assert vector.reset(seed=np.arange(5))[0].shape == (5, 9)


@pytest.mark.parametrize("seed", [0, 2**32, 2**63, 10**30, np.uint64(2**64 - 1)])
def test_seeds_may_be_huge(seed: Any) -> None:
    env = AquaFishEnv(engine="numba", fin_angles="random")
    assert (env.reset(seed=seed)[0] == env.reset(seed=int(seed))[0]).all()


@pytest.mark.parametrize("write", [Text, np.str_], ids=["subclass", "numpy"])
def test_names_may_be_of_any_class_of_text(write: Callable[[str], Any]) -> None:
    env = AquaFishEnv(
        damage=write("caudal:missing"),
        engine=write("numba"),
        fin_angles=write("random"),
        render_mode=write("rgb_array"),
    )
    assert env.reset(seed=0)[1]["faults"] == 1
    AquaFishVectorEnv(
        engine=write("numba"), dtype=write("float64"), autoreset_mode=write("SameStep")
    )
    log = aquafish_gym.simulate(
        None, GO / 2, steps=1, engine=write("numba"), dtype=write("float64"), record=write("rpy")
    )
    assert log.gyro is None


@pytest.mark.parametrize("mapping", [collections.OrderedDict, types.MappingProxyType])
def test_mappings_need_not_be_dictionaries(mapping: Callable[[Any], Any]) -> None:
    body = {"caudal": (0.5, 2, 1)}
    assert Morphology.coerce(mapping(body)) == Morphology.coerce(body)
    fault = {"kind": "FinMissing", "fin": "caudal"}
    assert Damage.coerce(mapping(fault)) == Damage((FinMissing("caudal"),))
    env = AquaFishEnv(engine="numba")
    info = env.reset(options=mapping({"morphology": mapping(body), "damage": mapping(fault)}))[1]
    assert info["morphology"].tolist()[6:] == [0, 0, 0]


@pytest.mark.parametrize("nothing", [None, "", " none ", "NONE", [], (), {"faults": ()}])
def test_nothing_broken_has_many_names(nothing: Any) -> None:
    assert Damage.coerce(nothing) == Damage()


@pytest.mark.parametrize(
    "number", [1, np.float32(1), np.array(1), np.array(1.0, np.float16), Decimal(1), Fraction(1)]
)
def test_a_number_may_be_any_real_number(number: Any) -> None:
    task = SwimForward(forward_weight=number, ctrl_weight=number)
    env = AquaFishEnv(engine="numba", task=task)
    env.reset()
    *_, info = env.step(GO)
    assert info["reward_ctrl"] == -(GO**2).sum()


@pytest.mark.parametrize("flag", [True, np.True_])
def test_flags_may_be_numpys(flag: Any) -> None:
    assert AquaFishEnv(engine="numba", observe_fins=flag).observation_space.shape == (15,)


@CALM
@given(st.lists(st.sampled_from([0.0, -0.0, 1.0]), min_size=9, max_size=9))
def test_bounds_belong_to_the_range(shares: list[float]) -> None:
    sizes = np.array(shares) * MAXIMA
    body = Morphology.coerce(sizes)
    assert (body.to_array() == np.abs(sizes)).all()
    assert Morphology.from_json(json.dumps(body.to_dict())) == body


@CALM
@given(hnp.arrays(float, 3, elements=st.floats(allow_nan=False, allow_infinity=False)))
def test_angles_and_actions_may_be_any_finite_numbers(numbers: np.ndarray) -> None:
    env = AquaFishEnv(engine="numba")
    env.reset(options={"fin_angles": numbers})
    seen, reward, terminated, _, info = env.step(numbers)
    assert env.observation_space.contains(seen)
    assert np.isfinite(reward)
    assert not terminated
    assert np.isfinite(info["fin_angles"]).all()


def test_no_zero_is_below_zero() -> None:
    """-0.0 is a legal size, speed and angle, and the robot is the one of 0.0."""
    logs = [
        aquafish_gym.simulate([zero] * 9, [zero] * 3, [zero] * 3, steps=9, current=[zero] * 3)
        for zero in (0.0, -0.0)
    ]
    assert (logs[0].rpy == logs[1].rpy).all()


def test_extreme_settings_are_taken() -> None:
    assert len(aquafish_gym.simulate(np.zeros((0, 9)), np.zeros((0, 3)), steps=2)) == 0
    log = aquafish_gym.simulate(None, (0.5, -0.5, 1.0), steps=1, substeps=64, threads=1024)
    assert np.isfinite(log.rpy).all()
    env = AquaFishEnv(engine="numba", frame_skip=2000)
    env.reset()
    assert env.step(GO)[3]


@pytest.mark.parametrize("engine", ["numba", "pybullet"])
def test_gym_make_takes_what_the_environment_takes(engine: str) -> None:
    env = gym.make(
        "AquaFish-v0",
        engine=Text(engine),
        morphology={"caudal": np.array([0.5, 2, 1], np.float16)},
        damage=Text("left_pectoral:missing"),
        fin_angles=np.full(3, 1e300),
        frame_skip=np.int16(10),
    )
    seen, _ = env.reset(seed=3)
    assert env.observation_space.contains(seen)
    assert env.observation_space.contains(env.step(env.action_space.sample())[0])
    env.close()
