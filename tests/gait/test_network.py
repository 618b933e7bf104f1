"""The forward pass, against the standard library, neat-python and the lanes."""

from __future__ import annotations

import math

import neat
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.arithmetic import sine_cosine
from aquafish_gym.physics.attitude import attitude, directions
from gait.controllers import network
from gait.controllers.network import Senses
from gait.search.neat import genome_to_controller
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
    sine, cosine = sine_cosine(turns)
    part = 2 * math.pi * (turns - math.floor(turns))
    assert sine == pytest.approx(math.sin(part), abs=4e-15)
    assert cosine == pytest.approx(math.cos(part), abs=4e-15)


@settings(max_examples=50)
@given(st.integers(0, 2**32), st.integers(0, 60), st.integers(0, 2**32))
def test_forward_is_neat_pythons_activate(seed: int, mutations: int, heard: int) -> None:
    config, genome = random_genome(seed, mutations)
    expected = neat.nn.FeedForwardNetwork.create(genome, config)
    body = Morphology.nominal()
    controller = genome_to_controller(genome, 1.0, body, 0)
    values = {padding: [0.0] * (11 + 2 * (controller.nodes + padding)) for padding in (0, 3)}
    for inputs in np.random.default_rng(heard).uniform(-1.0, 1.0, (4, 11)).tolist():
        out = expected.activate(inputs)
        for padding, scratch in values.items():
            scratch[:11] = inputs
            nodes = controller.nodes + padding
            genes, layout = controller.genes(nodes), controller.layout(nodes)
            network.forward(genes, layout.tolist(), scratch, 0, 1, 0.0)
            assert scratch[11 + nodes - 3 : 11 + nodes] == pytest.approx(out, abs=1e-12)


@given(st.integers(0, 2**32))
def test_directions_are_rows_of_the_rotation_matrix(seed: int) -> None:
    r, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    r *= np.linalg.det(r)
    rows = r.tolist()
    up, north = directions(attitude((tuple(rows[0]), tuple(rows[1]), tuple(rows[2]))))
    np.testing.assert_allclose(up, r[2], atol=1e-13)
    np.testing.assert_allclose(north, r[1], atol=1e-13)


def test_upright_and_facing_north_reads_plainly() -> None:
    senses = Senses(clock=2, fins=True)
    values = [0.0] * len(senses.names())
    up, north = directions((0.0, 0.0, 0.0))
    layout = [True, 2, True, False]
    still = (0.0, 0.0, 0.0)
    network.put_inputs(
        values, layout, 0.5 * 0.25, up, north, (1.0, -5.0, 0.5), (0.25, -0.25, 0.0), still
    )
    named = dict(zip(senses.names(), values, strict=False))
    expected = dict.fromkeys(senses.names(), 0.0) | {
        "up_z": 1.0,
        "north_y": 1.0,
        "gyro_x": 0.5,
        "gyro_y": -1.0,
        "gyro_z": 0.25,
        "clock_sine": math.sin(math.pi / 4),
        "clock_cosine": math.cos(math.pi / 4),
        "clock2_sine": 1.0,
        "left_pectoral_sine": 1.0,
        "right_pectoral_sine": -1.0,
        "caudal_cosine": 1.0,
    }
    assert named == pytest.approx(expected, abs=1e-15)
