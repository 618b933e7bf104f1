"""Train a student: it estimates what the teacher is told from what a robot senses (extra ``rl``).

The second phase of RMA (see ``teachers``): a network with memory estimates what broke from what is
sensed while it swims itself, and a copy of the teacher acts on the estimate. As departures from the
paper the memory is a GRU instead of a convolution over half a second, it also estimates where the
fins are and what whole sensors would read, and it may add to the teacher's action, which is trained
to be the told teacher's (S. Ross, G. Gordon, D. Bagnell, A reduction of imitation learning and
structured prediction to no-regret online learning, AISTATS 2011).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from aquafish.online.gaits import load_library
from experiments.league.policy import CELLS, CHANGE_SCALE, ESTIMATES, INPUTS, drive
from experiments.league.robots import (
    GROUP_ACTIONS,
    Conditions,
    Numbers,
    TrainingRobots,
)
from experiments.league.teachers import TEST_ROBOTS, TEST_SEED, actor, nn, torch

ROBOTS = 1024
SEGMENTS = 2  # of ``GROUP_ACTIONS``, through which gradients flow
UPDATES = 40  # in a round
BATCH = 32  # robots
RATE = 1.5e-3
LEAST_RATE = 2e-5
LED_SHARE = 0.15  # of the training, in which the teacher leads ever fewer robots
NOISY_EVERY = 4  # one robot of so many
ACTION_NOISE = 0.15
SIZE_SCALE = 0.4
GAIN_SCALE = 0.6
LETTERS = (("w", "weight"), ("b", "bias"))
TEST_ONSET = 20.0  # s
TEST_SECONDS = 60.0


class Student(nn.Module):  # type: ignore[misc]
    """The estimator, and the teacher that acts on its estimates.

    At first it estimates that nothing broke, and takes what is sensed for the truth.
    """

    def __init__(self, teacher: Any) -> None:
        super().__init__()
        self.teacher = teacher
        self.enter = nn.Linear(2 * INPUTS, CELLS)
        self.memory = nn.GRU(CELLS, CELLS)
        self.mix = nn.Linear(CELLS + INPUTS, CELLS)
        self.estimate = nn.Linear(CELLS, ESTIMATES)
        nn.init.zeros_(self.estimate.weight)
        nn.init.zeros_(self.estimate.bias)
        self._gait = load_library()[0]

    def forward(self, seen: Any, cells: Any) -> tuple[Any, Any, Any]:
        """Return actions (T, B, 3), what is estimated (T, B, 27), and the memory (1, B, CELLS).

        ``seen`` (T, B, 46) is what is sensed now and one action earlier.
        """
        now, before = seen[..., :INPUTS], seen[..., INPUTS:]
        entered = self.enter(torch.cat([now, CHANGE_SCALE * (now - before)], -1))
        values, cells = self.memory(nn.functional.elu(entered), cells)
        values = self.estimate(nn.functional.elu(self.mix(torch.cat([values, now], -1))))
        imu = now[..., :9] + values[..., :9]
        turn = values[..., 9:15].unflatten(-1, (3, 2)) + torch.tensor([0.0, 1.0])
        turn = turn / (turn.norm(dim=-1, keepdim=True) + 1e-4)
        fins = now[..., 11:17].unflatten(-1, (3, 2))
        sine = fins[..., 0] * turn[..., 1] + fins[..., 1] * turn[..., 0]
        cosine = fins[..., 1] * turn[..., 1] - fins[..., 0] * turn[..., 0]
        fins = torch.stack([sine, cosine], -1).flatten(-2)
        inputs = torch.cat([imu[..., :6], imu[..., 6:].clamp(-1, 1), now[..., 9:11], fins], -1)
        rows = inputs.detach().reshape(-1, inputs.shape[-1]).numpy()
        gait = torch.from_numpy(np.clip(drive(self._gait, rows), -1.0, 1.0))
        gait = gait.reshape(*inputs.shape[:-1], 3)
        broken = values[..., 15:27]
        told = torch.cat([inputs, now[..., 17:20], gait, broken], -1)
        return self.teacher(told) + values[..., 27:], torch.cat([broken, fins, imu], -1), cells


@dataclass(frozen=True)
class Plan:
    """How a student is trained.

    For ``any_water`` as of a teacher's plan; then half of the episodes do not tell the initial fin
    angles.
    """

    any_water: bool = False
    seed: int = 0
    rounds: int = 10  #: Of :func:`round_actions`.

    @property
    def conditions(self) -> Conditions:
        """What the robots swim in."""
        return Conditions(
            onset="2-20",
            seconds=40.0,
            noise=0.01,
            any_water=self.any_water,
            unknown_share=0.5 if self.any_water else 0.0,
        )


def round_actions() -> int:
    """Return how many actions all robots together take in a round."""
    return ROBOTS * GROUP_ACTIONS * SEGMENTS * UPDATES


def learn_round(
    plan: Plan, number: int, teacher: dict[str, Numbers], learned: dict[str, Any] | None
) -> dict[str, Any]:
    """Return what is learned after a round, from that before; None is nothing yet."""
    torch.set_num_threads(1)
    seed = 1000 * (plan.seed + 1) + 500 + number
    robots = TrainingRobots(ROBOTS, plan.conditions, seed)
    random = torch.Generator().manual_seed(seed)
    acting = actor(teacher)
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        student = Student(actor(teacher))
    optimizer = torch.optim.Adam(student.parameters(), lr=RATE)
    if learned is not None:
        student.load_state_dict(learned["student"])
        optimizer.load_state_dict(learned["optimizer"])
    noise = torch.zeros(ROBOTS, 1)
    noise[::NOISY_EVERY] = ACTION_NOISE
    robots.reset()
    cells = torch.zeros(1, ROBOTS, CELLS)
    before = robots.sensed()
    for update in range(UPDATES):
        done = (number + update / UPDATES) / plan.rounds
        for group in optimizer.param_groups:
            group["lr"] = RATE * (1.0 - done) + LEAST_RATE
        led = torch.rand(ROBOTS, 1, generator=random) >= done / LED_SHARE
        parts = []
        for _ in range(SEGMENTS):
            begun = robots.begun
            cells[:, begun] = 0.0
            before[begun] = robots.sensed()[begun]
            part = _Part(begun, cells.clone())
            for _ in range(GROUP_ACTIONS):
                now = robots.sensed()
                seen = torch.from_numpy(np.hstack([now, before]))
                before = now
                sensed, broken = robots.truth()
                with torch.no_grad():
                    wanted = acting(torch.from_numpy(np.hstack([sensed, broken]))).clamp(-1.1, 1.1)
                    action, _, cells = student(seen[None], cells)
                    action = torch.where(led, wanted, action[0])
                    action += noise * torch.randn(ROBOTS, 3, generator=random)
                part.add(seen, wanted, sensed, broken)
                robots.step(action.numpy())
            parts.append(part)
        order = torch.randperm(ROBOTS, generator=random)
        for rows in order.split(BATCH):
            loss = _loss(student, parts, rows)
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(student.parameters(), 1.0)
            optimizer.step()
    return {"student": student.state_dict(), "optimizer": optimizer.state_dict()}


class _Part:
    """What robots sensed, and what the teacher did, in a segment."""

    def __init__(self, begun: Any, cells: Any) -> None:
        self.begun = torch.from_numpy(begun)
        self.cells = cells
        self._rows: list[tuple[Any, ...]] = []

    def add(self, seen: Any, wanted: Any, sensed: Numbers, broken: Numbers) -> None:
        """Add an action."""
        target = np.hstack([broken, sensed[:, 11:17], sensed[:, :9]])
        self._rows.append((seen, wanted, torch.from_numpy(target)))

    def of(self, rows: Any) -> tuple[Any, Any, Any]:
        """Return what some robots sensed, the actions and what is to be estimated, (T, B, ...)."""
        one, two, three = (
            torch.stack([row[rows] for row in column]) for column in zip(*self._rows, strict=True)
        )
        return one, two, three


def _loss(student: Student, parts: list[_Part], rows: Any) -> Any:
    """Return the loss of some robots' actions and estimates."""
    scale = torch.tensor([1.0 / SIZE_SCALE] * 9 + [1.0 / GAIN_SCALE] * 3)
    cells = parts[0].cells[:, rows]
    total = torch.zeros(())
    for part in parts:
        cells = cells * ~part.begun[rows][:, None]
        seen, wanted, target = part.of(rows)
        action, found, cells = student(seen, cells)
        error = found - target
        broken = error[..., :12] * scale
        total = total + (action - wanted).square().mean()
        total = total + nn.functional.huber_loss(broken, torch.zeros_like(broken))
        total = total + 0.5 * error[..., 12:].square().mean()
    return total / len(parts)


def weights(learned: dict[str, Any]) -> dict[str, Numbers]:
    """Return the arrays of ``policy.Student``."""
    names = {
        "enter_w": "enter.weight", "enter_b": "enter.bias",
        "in_w": "memory.weight_ih_l0", "in_b": "memory.bias_ih_l0",
        "back_w": "memory.weight_hh_l0", "back_b": "memory.bias_hh_l0",
        "mix_w": "mix.weight", "mix_b": "mix.bias",
        "estimate_w": "estimate.weight", "estimate_b": "estimate.bias",
    }  # fmt: skip
    return {name: learned["student"][key].detach().numpy().copy() for name, key in names.items()}


def acting(learned: dict[str, Any]) -> dict[str, Numbers]:
    """Return the arrays of the student's copy of its teacher, which has learned with it."""
    names = {f"{kind}{i}": f"teacher.{2 * i}.{word}" for i in range(3) for kind, word in LETTERS}
    return {name: learned["student"][key].detach().numpy().copy() for name, key in names.items()}


def test(learned: dict[str, Any], teacher: dict[str, Numbers], plan: Plan) -> float:
    """Return the mean pace, units/s, of robots that break after 20 s of a minute."""
    student = Student(actor(teacher))
    student.load_state_dict(learned["student"])
    conditions = replace(plan.conditions, onset=str(TEST_ONSET), seconds=TEST_SECONDS)
    robots = TrainingRobots(TEST_ROBOTS, conditions, TEST_SEED)
    cells = torch.zeros(1, TEST_ROBOTS, CELLS)
    before: list[Numbers] = []

    def act(_observed: Numbers) -> Numbers:
        nonlocal cells
        now = robots.sensed()
        last = before.pop() if before else now
        before.append(now)
        action, _, cells = student(torch.from_numpy(np.hstack([now, last]))[None], cells)
        return np.asarray(action[0])

    with torch.no_grad():
        return robots.pace(act, TEST_ONSET)
