"""Train the league's learned rivals, RMA, and the agent's teachers (extra ``rl``).

    python -m experiments.league.policies --out out/policies

A teacher learns by PPO and is told what broke (``teachers``); a student then estimates what its
teacher is told (``students``). ``SEEDS`` pairs learn in the league's own water with its own damage;
``any-water`` in random water, half of the time without knowing the initial fin angles. A teacher
takes 14 minutes on one core, and a student 8. Several commands may train different ones in one
folder at the same time.

The same command resumes at the last round. At the end it draws the curves of all trained policies
of the folder, ``curves.png``. ``teacher-0.json`` and ``teacher-any-water.json`` are packaged as
``aquafish/online/teacher.json`` and ``teacher_any_water.json``, the students as
``experiments/league/data/policies``.
"""

from __future__ import annotations

import io
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from tyro.conf import arg

from aquafish.online.teacher import Teacher
from aquafish_gym.rendering.pictures import new_figure, save_figure
from aquafish_gym.runs.command_line import Out, run_command_line
from aquafish_gym.runs.manifest import lock, write_manifest
from aquafish_gym.runs.progress import show_progress
from aquafish_gym.utils.storage import ensure_writable_directory, write_bytes
from aquafish_gym.utils.validation import InvalidArgumentError, one_of
from eea.study.drawing import grid
from experiments.league.policy import ANY_WATER, INTERVAL, TWINS, Offline, Student
from gait.learning.train import load_extra

NAMES = tuple(f"{kind}-{twin}" for twin in TWINS for kind in ("teacher", "student"))

CHECKPOINT = "state.pt"

State = dict[str, Any]
Tell = Callable[[int, str], None]


@dataclass(frozen=True)
class Training:
    """The training of one policy, in rounds, each from the state that the last one left.

    Parameters
    ----------
    name
        One of ``NAMES``.
    out
        Folder of all policies; a student's teacher must be trained there.
    """

    name: str
    out: Path

    @property
    def twin(self) -> str:
        """Which of the pairs of teacher and student it belongs to."""
        return self.name.partition("-")[2]

    @property
    def file(self) -> Path:
        """Where the trained policy is written."""
        return self.out / f"{self.name}.json"

    @property
    def module(self) -> Any:
        """``teachers`` or ``students``."""
        return load_extra(f"experiments.league.{self.name.partition('-')[0]}s")

    @property
    def plan(self) -> Any:
        """Rounds, water and seed."""
        other = self.twin == ANY_WATER
        return self.module.Plan(any_water=other, seed=0 if other else int(self.twin))

    def teacher(self) -> Teacher:
        """Return a student's teacher."""
        path = self.out / f"teacher-{self.twin}.json"
        if not path.exists():
            raise InvalidArgumentError(
                f"policies must have teacher-{self.twin} before {self.name}: {path} is missing"
            )
        return Teacher.load(path)

    def first(self) -> State | None:
        """Return what it begins with: the teacher of any water with what the first one learned."""
        if self.name != f"teacher-{ANY_WATER}":
            return None
        path = self.out / NAMES[0] / CHECKPOINT
        if not path.exists():
            raise InvalidArgumentError(
                f"policies must have {NAMES[0]} before {self.name}: {path} is missing"
            )
        return dict(load_extra("torch").load(path, weights_only=True)["learned"])

    def train(self, tell: Tell) -> None:
        """Train the policy, or go on where it stopped; write its file."""
        torch = load_extra("torch")
        module = self.module
        plan = self.plan
        teacher = self.teacher().weights if self.name.startswith("student") else None
        folder = ensure_writable_directory(self.out / self.name)
        checkpoint = folder / CHECKPOINT
        with lock(folder):
            settings = {"name": self.name, **asdict(plan)}
            write_manifest(folder, "a training", settings, work=module.learn_round)
            state: State = {"learned": self.first(), "curve": [], "seconds": 0.0}
            if checkpoint.exists():
                state = torch.load(checkpoint, weights_only=True)
            for number in range(len(state["curve"]), plan.rounds):
                began = time.process_time()
                learned = module.learn_round(plan, number, teacher, state["learned"])
                spent = state["seconds"] + time.process_time() - began
                pace = module.test(learned, teacher, plan)
                curve = [*state["curve"], [(number + 1) * module.round_actions(), pace]]
                state = {"learned": learned, "curve": curve, "seconds": spent}
                content = io.BytesIO()
                torch.save(state, content)
                write_bytes(checkpoint, content.getvalue())
                tell(number + 1, f"{self.name}: {pace:.3f} units/s")
        self._save(state)

    def _save(self, state: State) -> None:
        curve = tuple((actions, round(pace, 4)) for actions, pace in state["curve"])
        weights = self.module.weights(state["learned"])
        offline = Offline(INTERVAL * curve[-1][0], round(state["seconds"], 1))
        if self.name.startswith("teacher"):
            Teacher(weights, offline._asdict(), curve).save(self.file)
        else:
            copy = Teacher(self.module.acting(state["learned"]), self.teacher().offline)
            Student(copy, weights, offline, curve).save(self.file)


@dataclass(frozen=True)
class Policies:
    """Train the learned rivals of the recovery league and the agent's teachers; NAME.json each."""

    example: ClassVar[str] = "--policies teacher-0 --out out/policies"

    out: Out = Path("out/policies")
    policies: Annotated[
        tuple[str, ...], arg(metavar="NAME", help=f"Some of: {', '.join(NAMES)}.")
    ] = NAMES

    def execute(self) -> None:
        """Train one after another those whose files are missing; draw all curves."""
        trainings = [Training(one_of("policies", name, NAMES), self.out) for name in self.policies]
        missing = [one for one in trainings if not one.file.exists()]
        total = sum(one.plan.rounds for one in missing)
        before = 0
        with show_progress("training", max(total, 1)) as show:
            for one in missing:
                one.train(_after(before, show))
                before += one.plan.rounds
        known = [Training(name, self.out) for name in NAMES]
        save_figure(curves([one for one in known if one.file.exists()]), self.out / "curves.png")
        for one in trainings:
            print(one.file)


def curves(trainings: Sequence[Training]) -> Any:
    """Draw the pace of trained policies against the actions that they had learned from."""
    figure = new_figure(7.0, 3.4)
    axes = figure.subplots()
    for one in trainings:
        is_teacher = one.name.startswith("teacher")
        kind = Teacher if is_teacher else Student
        actions, paces = zip(*kind.load(one.file).curve, strict=True)
        colour = f"C{TWINS.index(one.twin)}"
        style = "-" if is_teacher else "--"
        axes.plot(np.array(actions) / 1e6, paces, style, color=colour, label=one.name)
    axes.set_xlabel("million actions of all robots together")
    axes.set_ylabel("pace in a test, units/s")
    grid(axes)
    axes.legend(fontsize=8, ncols=2, loc="lower right")
    return figure


def _after(before: int, show: Tell) -> Tell:
    """Return a function that shows rounds after those ``before``."""
    return lambda done, text: show(before + done, text)


if __name__ == "__main__":
    sys.exit(run_command_line("experiments.league.policies", Policies))
