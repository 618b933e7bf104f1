"""The forward pass, against the standard library, neat-python and the lanes."""

from __future__ import annotations

import math

import neat
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aquafish_gym.command import scale_action
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.attitude import attitude
from gait import network
from gait.evolution import genome_to_controller
from gait_fakes import random_genome

finite = st.floats(-1e6, 1e6)
angle = st.floats(-20.0, 20.0)
unit = st.floats(-1.0, 1.0)


def test_tanh_agrees_with_the_standard_library_over_its_whole_range() -> None:
    z = np.concatenate([np.linspace(-70, 70, 20_001), np.linspace(-1e-3, 1e-3, 2_001)])
    worst = max(abs(network.tanh(float(v)) - math.tanh(v)) for v in z)
    assert worst < 1e-15


def test_tanh_is_good_to_single_precision_in_single_precision() -> None:
    class Single(float):
        """A float that rounds every result to single precision."""

    def rounded(function: str) -> object:
        plain = getattr(float, function)
        return lambda self, other: Single(np.float32(plain(self, float(np.float32(other)))))

    for name in ("add", "radd", "sub", "rsub", "mul", "rmul", "truediv"):
        setattr(Single, f"__{name}__", rounded(f"__{name}__"))
    z = np.linspace(-25, 25, 5_001, dtype=np.float32)
    worst = max(abs(network.tanh(Single(v)) - math.tanh(v)) for v in z)
    assert 1e-8 < worst < 1e-6


@given(finite)
def test_tanh_is_odd_and_bounded(z: float) -> None:
    assert network.tanh(-z) == -network.tanh(z)
    assert abs(network.tanh(z)) <= 1.0


@given(st.floats(-1000.0, 1000.0))
def test_sine_cosine_agrees_with_the_standard_library(turns: float) -> None:
    sine, cosine = network.sine_cosine(turns)
    part = 2 * math.pi * (turns - math.floor(turns))
    assert sine == pytest.approx(math.sin(part), abs=4e-15)
    assert cosine == pytest.approx(math.cos(part), abs=4e-15)


@settings(max_examples=150)
@given(st.integers(0, 2**32), st.integers(0, 60), st.lists(unit, min_size=11, max_size=11))
def test_forward_is_neat_pythons_activate(seed: int, mutations: int, inputs: list[float]) -> None:
    config, genome = random_genome(seed, mutations)
    expected = neat.nn.FeedForwardNetwork.create(genome, config).activate(inputs)
    controller = genome_to_controller(genome, 1.0, Morphology.nominal(), 0)
    for padding in (0, 3):
        nodes = controller.nodes + padding
        values = inputs + [0.0] * nodes
        out = network.forward(controller.genes(nodes), nodes, values, 0, 1, 0.0)
        # A deep network of large weights passes rounding on, magnified.
        assert out == pytest.approx(expected, abs=1e-12)


@given(angle, angle, angle)
def test_attitude_enters_alike_in_both_of_its_triples(
    roll: float, pitch: float, yaw: float
) -> None:
    one = network.directions((roll, pitch, yaw))
    other = network.directions((roll + math.pi, math.pi - pitch, yaw - 3 * math.pi))
    np.testing.assert_allclose(one, other, atol=1e-13)


@given(st.integers(0, 2**32))
def test_directions_are_rows_of_the_rotation_matrix(seed: int) -> None:
    r, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    r *= np.linalg.det(r)
    rows = r.tolist()
    up, north = network.directions(attitude((tuple(rows[0]), tuple(rows[1]), tuple(rows[2]))))
    np.testing.assert_allclose(up, r[2], atol=1e-13)
    np.testing.assert_allclose(north, r[1], atol=1e-13)


def test_upright_and_facing_north_reads_plainly() -> None:
    values = [0.0] * network.INPUT_COUNT
    up, north = network.directions((0.0, 0.0, 0.0))
    network.listen(values, 0.5, 0.25, up, north, (1.0, -5.0, 0.5))
    named = dict(zip(network.INPUTS, values, strict=True))
    expected = dict.fromkeys(network.INPUTS, 0.0) | {
        "up_z": 1.0,
        "north_y": 1.0,
        "gyro_x": 0.5,
        "gyro_y": -1.0,
        "gyro_z": 0.25,
        "clock_sine": math.sin(math.pi / 4),
        "clock_cosine": math.cos(math.pi / 4),
    }
    assert named == pytest.approx(expected, abs=1e-15)


@given(st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3))
def test_commands_are_scaled_as_actions_are(action: list[float]) -> None:
    # A network without connections answers tanh(2.5 bias) for ever.
    bias = [math.atanh(max(-0.999, min(0.999, a))) / 2.5 for a in action]
    genes = [1.0]
    for node, b in enumerate(bias):
        genes += [b, 1.0, *[0.0] * (network.INPUT_COUNT + node)]
    rest = (0.0, 0.0, 0.0)
    command = network.steer(genes, [3], [0.0] * (network.INPUT_COUNT + 3), 0, 1, 0.0, rest, rest)
    expected = scale_action(np.clip(action, -0.999, 0.999))
    assert command == pytest.approx(tuple(expected), abs=1e-14)
