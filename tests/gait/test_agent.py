"""A controller's agent: the network on plain floats to the last bit, and copies of it."""

from __future__ import annotations

import numpy as np
import pytest

from aquafish_gym.command import lane_servo_speeds, reckon
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.arithmetic import TAU
from aquafish_gym.rollout.programs import ProgramAgent
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.controllers.agents import ControllerAgent
from gait.controllers.controller import Controller, program_of
from gait.controllers.inputs import NetworkInputs
from gait.controllers.network import Senses, forward, respond
from gait.search.templates import Template

ANGLES = np.array([[1.0, 2.0, 3.0], [0.5, -1.0, 4.0]])
GAIN = (1.0, 0.5, -1.0)


def make_controller(seed: int = 3, goal: bool = False) -> Controller:
    """Return a random network with a memory that senses its fins."""
    template = Template.of_class("recurrent", Senses(fins=True, goal=goal), 5, 20)
    vector = 0.5 * np.random.default_rng(seed).standard_normal(template.size)
    return template.controller(vector, 0.7, Morphology.nominal(), seed)


def drawn(steps: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (steps, 2, 12))


def test_the_agent_is_the_network_on_plain_floats_to_the_last_bit() -> None:
    controllers = [make_controller(seed, goal=True) for seed in (3, 4)]
    together = ProgramAgent(program_of(controllers), ANGLES, GAIN)
    alone = []
    for controller, angles in zip(controllers, ANGLES, strict=True):
        genes, layout = controller.genes().tolist(), controller.layout().tolist()
        alone.append((genes, layout, [0.0] * 100, (angles / TAU).tolist()))
    for k, observations in enumerate(drawn(30)):
        actions = together.act(observations, 0.2 * k)
        for i, (genes, layout, memory, fins) in enumerate(alone):
            o = observations[i].tolist()
            action = respond(
                genes, layout, memory, 0, 1, 0.2 * k, o[:3], o[3:6], o[6:9], fins, o[9:]
            )
            assert actions[i].tolist() == list(action)
            speeds = [g * s for g, s in zip(GAIN, lane_servo_speeds(action), strict=True)]
            fins[:] = reckon(fins, speeds, 0.2)
    np.testing.assert_allclose(together.fin_angles, [TAU * np.array(one[3]) for one in alone])


def test_a_copy_goes_on_by_itself() -> None:
    agent = ControllerAgent(make_controller(), GAIN)
    agent.reset({"fin_angles": ANGLES})
    seen = drawn(12)[:, :, :9]
    for observations in seen[:4]:
        agent.act(observations)
    ahead = agent.copy()
    imagined = [ahead.act(observations) for observations in seen[4:]]
    np.testing.assert_array_equal([agent.act(observations) for observations in seen[4:]], imagined)
    np.testing.assert_array_equal(agent.fin_angles, ahead.fin_angles)
    ahead.fin_angles = ANGLES
    assert (agent.fin_angles != ANGLES).any()
    assert (agent.act(seen[0]) != ahead.act(seen[0])).any()


def test_one_robot_needs_no_batch() -> None:
    controller = make_controller()
    batch, alone = ControllerAgent(controller), ControllerAgent(controller)
    batch.reset({"fin_angles": ANGLES})
    alone.reset({"fin_angles": ANGLES[1]})
    for observations in drawn(5):
        np.testing.assert_array_equal(batch.act(observations)[1], alone.act(observations[1]))
    with pytest.raises(InvalidArgumentError, match=r"observations must have shape \(2, 9 or more"):
        batch.act(np.zeros(9))


def test_a_reading_beyond_its_range_is_not_observed() -> None:
    agent, other = (ControllerAgent(make_controller()) for _ in range(2))
    seen = drawn(3)[:, :, :9]
    for one in (agent, other):
        one.reset({"fin_angles": ANGLES})
        one.act(seen[0])
    broken = seen[0].copy()
    broken[:, 4] = np.nan
    broken[:, 7] = 1e6
    np.testing.assert_array_equal(agent.act(broken), other.act(seen[0]))


def test_the_inputs_of_learners_are_those_of_the_agent() -> None:
    controller = make_controller()
    agent = ControllerAgent(controller)
    agent.reset({"fin_angles": ANGLES})
    inputs = NetworkInputs(controller.senses, controller.clock, 20, np.zeros((2, 3)))
    inputs.begin([0, 1], ANGLES)
    genes, layout = controller.genes().tolist(), controller.layout().tolist()
    count = len(controller.senses.names)
    values = [[0.0] * (count + 2 * controller.nodes) for _ in ANGLES]
    for observations in drawn(10)[:, :, :9]:
        actions = agent.act(observations)
        for row, seen, action in zip(values, inputs.observe(observations), actions, strict=True):
            row[:count] = seen.tolist()
            assert forward(genes, layout, row, 0, 1, 0.0) == pytest.approx(action, abs=1e-6)
        inputs.follow(actions)
        np.testing.assert_allclose(inputs.fin_angles, agent.fin_angles, atol=1e-5)
