"""The command line: ``python -m gait evolve``, ``transfer`` and ``baseline``."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from tyro.extras import SubcommandApp

from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.storage import ensure_writable_directory, write_json
from aquafish_gym.utils.command_line import BAD_INPUT, read_morphology, run_command_line
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.baselines import Baseline, BaselineConfig, MissingExtraError
from gait.controller import Controller
from gait.evolve import (
    CONTROLLER_FILE,
    FINAL_POSES,
    EvolveConfig,
    Evolved,
    evolve_gait,
    finished_generations,
)
from gait.history import HISTORY_FILE, Generation
from gait.rollout import ZERO_POSE, random_poses
from gait.transfer import Transfer, TransferConfig, transfer

LINE_EVERY = 10  # generations, where there is no terminal to show progress on
# What estimations and case studies leave, of whose packages gaits know nothing.
OTHERS = ("run.json", "rounds.jsonl", "result.json", "model.json", "outcome.json")

app = SubcommandApp()


@dataclass(frozen=True)
class _OnBody:
    """A command that works on a body and fills a directory."""

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Directory for the results; made if need be."""
    morphology: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """JSON file of the body: an object from fin to [x, y, z], or one with a "morphology", as
    eea's result.json; without it, the nominal body."""
    damage: str = "none"
    """What broke on the body: FIN:SIZE=FACTOR or FIN:missing, joined by ";", or none. FIN is
    left_pectoral, right_pectoral or caudal; SIZE is length, width or thickness."""

    def prepare(self) -> tuple[Morphology, Path]:
        """Return the body as it is, damage included, and the directory, checked."""
        body = Damage.parse(self.damage).apply(read_morphology(self.morphology, "morphology"))
        _refuse_others(self.out)
        return body, ensure_writable_directory(self.out)


@app.command(name="evolve")
@dataclass(frozen=True)
class Evolve(_OnBody):
    """Evolve a controller that swims a body forward.

    Into --out go controller.json (the best so far), history.csv (a row a generation),
    checkpoint.json and history.png. The same command takes up a run that was interrupted.

    Columns of history.csv, with distances in units of 5 cm:
    - generation: from 0.
    - best, mean: over the generation's controllers, each one's mean distance over its poses.
    - species: how many.
    - final: the winner's mean distance over the zero pose and 32 random ones, always the same.
    The 8 best of a generation swim from these, and the one with the highest mean is the winner.
    - distance: the winner's from the zero pose.
    - nodes, connections: of the winner's network.

    Attributes
    ----------
    config
        How to evolve.
    """

    config: Annotated[EvolveConfig, tyro.conf.arg(name="")] = field(default_factory=EvolveConfig)

    def execute(self) -> None:
        """Evolve to the last generation, with a progress line."""
        body, out = self.prepare()
        try:
            evolved = self._evolve(body, out)
        except KeyboardInterrupt:
            done = finished_generations(out)
            _plot(out, done)
            rest = f"goes on from generation {len(done)}" if done else "starts again"
            raise KeyboardInterrupt(f"interrupted; the same command {rest}") from None
        _plot(out, evolved.history)
        network = evolved.controller
        start = (
            f"on the mean over the zero pose and {FINAL_POSES} random ones"
            if self.config.poses
            else "from the zero pose"
        )
        print(
            f"swims {evolved.fitness:.2f} units in {self.config.seconds:g} s {start} "
            f"({network.nodes} nodes, {network.connections} connections); "
            f"{CONTROLLER_FILE} and {HISTORY_FILE} are in {out}"
        )

    def _evolve(self, body: Morphology, out: Path) -> Evolved:
        total, before = self.config.generations, len(finished_generations(out))
        with _progress() as progress:
            task = progress.add_task("evolving", total=total)

            def show(row: Generation) -> None:
                progress.update(task, advance=1, description=_progress_line(row))
                done = row.generation + 1
                due = done > before and (done % LINE_EVERY == 0 or done == total)
                if progress.disable and due:
                    print(f"{done}/{total}  {_progress_line(row)}", file=sys.stderr, flush=True)

            return evolve_gait(body, self.config, out=out, on_generation=show)


@app.command(name="transfer")
@dataclass(frozen=True)
class TransferCommand:
    """Swim a controller on the body it was evolved on, and on a target.

    Attributes
    ----------
    controller
        A controller.json, as evolve writes it; it holds the body it was evolved on.
    target_morphology
        JSON file of the target before its damage: an object from fin to [x, y, z], or one with a
        "morphology", as eea's result.json; without it, the nominal body.
    target_damage
        What broke on the target: FIN:SIZE=FACTOR or FIN:missing, joined by ";", or none. FIN is
        left_pectoral, right_pectoral or caudal; SIZE is length, width or thickness.
    out
        Directory for transfer.json and trajectories.png, if they are wanted.
    config
        How to compare.
    """

    controller: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    target_morphology: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    target_damage: str = "none"
    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    config: Annotated[TransferConfig, tyro.conf.arg(name="")] = field(
        default_factory=TransferConfig
    )

    def execute(self) -> None:
        """Swim both and print a table."""
        controller = Controller.load(self.controller)
        body = read_morphology(self.target_morphology, "target_morphology")
        target = Damage.parse(self.target_damage).apply(body)
        out = None if self.out is None else ensure_writable_directory(self.out)
        result = transfer(controller, target, self.config)
        print(_table(result, self.config))
        if out is not None:
            from gait.plots import plot_trajectories

            document = {
                "schema": "gait.transfer/1",
                "native_morphology": controller.morphology.to_dict(),
                "target_morphology": target.to_dict(),
                "native_engine": self.config.native_engine,
                "target_engine": self.config.target_engine,
                "seconds": self.config.seconds,
                "seed": self.config.seed,
                **result.to_dict(),
            }
            write_json(out / "transfer.json", document)
            swims = {"native": result.native.swim, "target": result.target.swim}
            plot_trajectories(out / "trajectories.png", swims)


@app.command(name="baseline")
@dataclass(frozen=True)
class BaselineCommand(_OnBody):
    """Train a baseline of stable-baselines3 on a body, and say how far it swims.

    Into --out go baseline.json and parameters.npz. It needs the extra rl.

    Attributes
    ----------
    config
        How to learn.
    """

    config: Annotated[BaselineConfig, tyro.conf.arg(name="")] = field(
        default_factory=BaselineConfig
    )

    def execute(self) -> None:
        """Train with a progress line, write, and evaluate."""
        body, out = self.prepare()
        baseline = Baseline(body, self.config)
        with _progress() as progress:
            task = progress.add_task(self.config.algorithm, total=self.config.steps)
            baseline.train(lambda taken: progress.update(task, completed=taken))
        baseline.save(out)
        poses = random_poses(TransferConfig().poses, self.config.seed)
        zero, *others = baseline.evaluate(body, np.vstack([ZERO_POSE, poses])).tolist()
        print(
            f"swims {zero:.2f} units in 20 s from the zero pose, {np.mean(others):.2f} on average "
            f"over {len(others)} random poses; written to {out}"
        )


def _progress() -> Progress:
    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=10),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    console = Console(stderr=True)
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)


def _progress_line(row: Generation) -> str:
    return f"final {row.final:6.2f}  mean {row.mean:6.2f}  species {row.species}  nodes {row.nodes}"


def _plot(out: Path, history: Sequence[Generation]) -> None:
    from gait.plots import plot_history

    if history:
        plot_history(out / "history.png", history)


def _refuse_others(out: Path) -> None:
    """Refuse to mix a gait's files with those of an estimation or a case study."""
    names = [name for name in OTHERS if (out / name).exists()]
    if (out / "config.json").exists() and any(out.glob("seed-*")):
        names.append("config.json")
    if names:
        raise InvalidArgumentError(
            f"out holds an estimation or a case study ({out / names[0]}); choose another directory"
        )


def _table(result: Transfer, config: TransferConfig) -> str:
    lines = [f"{'units of 5 cm':16s}{'zero pose':>12s}{f'{config.poses} random poses':>20s}"]
    lines += [
        f"{name:16s}{scored.distance:12.2f}{scored.random_distance:20.2f}"
        for name, scored in (("native", result.native), ("target", result.target))
    ]
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    return run_command_line("gait", app, arguments, (*BAD_INPUT, MissingExtraError))


if __name__ == "__main__":
    sys.exit(main())
