"""The commands ``evolve``, ``transfer`` and ``baseline`` of ``python -m gait``."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from aquafish_gym.bodies import read_bodies
from aquafish_gym.command_line import (
    RESUMES,
    BodiesFile,
    BodyDamage,
    Commands,
    EpisodeDamage,
    Out,
    TargetDamage,
    TargetMorphology,
    read_morphology,
    run_command_line,
)
from aquafish_gym.damage import Damage
from aquafish_gym.engines.base import check_engine
from aquafish_gym.engines.worlds import WorldConfig
from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.folder import SETTINGS
from aquafish_gym.runs.storage import ensure_writable_directory, write_document
from aquafish_gym.utils.validation import integer
from gait.baselines import CHECKPOINT_FILE, CURVE_FILE, BaselineConfig, Leg, train_baseline
from gait.controller import Controller
from gait.evolve import (
    FINAL_POSES,
    MAXIMUM_BODIES,
    EvolveConfig,
    Evolved,
    damaged_at_random,
    evolve_gait,
)
from gait.records import CONTROLLER_FILE, HISTORY_FILE, Generation, finished_generations
from gait.transfer import TransferConfig, transfer

RandomDamages = Annotated[
    int,
    tyro.conf.arg(
        help="Learn to swim the body and so many more, each damaged at random in one fin or two: a "
        "gait for who does not know what happened. See Damage.random."
    ),
]


@dataclass(frozen=True)
class Evolve:
    """Evolve a controller that swims a body forward, or does another task, or a sample of bodies.

    NEAT has some starts, whose best networks have their weights polished by CMA-ES, and the best of
    these goes on; with --starts 1 --polish 0 --generations 60 it is the paper's. --search cma finds
    better gaits: of many random networks the best are starts, of these the best go on. With
    --senses imu clock fins the controller knows where its fins are, from where they stood at first
    and what they were told since: a self-model tells where that was.

    Into --out go controller.json (the best so far), history.csv (a row a generation),
    checkpoint.json, settings.json and history.png. The same command resumes a run that was
    interrupted, and more --generations (more --polish, of NEAT) prolong it.

    A file with a sample of bodies, which estimations write as bodies.json, gives a gait that does
    well on all of them, for no more time: each swim is on another body. It goes into --out, too.

    Columns of history.csv, with distances in units of 5 cm:
    - generation: from 0, of one start after the other.
    - best, mean: over the generation's controllers, each one's mean distance over its poses.
    - species: how many; of CMA-ES, how many starts are still in the race.
    - final: the winner's mean distance over the zero pose and 32 random ones, always the same; of
    a sample so many that each body swims equally often.
    The 8 best of NEAT's generation swim from these, and the one with the highest mean is the
    winner; of CMA-ES it is the controller that the generation is scattered about, in each fourth
    generation: in between, the last one's is repeated.
    - distance: the winner's from the zero pose, on the first body.
    - nodes, connections: of the winner's network.
    With --aggregate quantile, read that quantile where it says mean, but for the column mean: that
    is the mean over the controllers of what each one's swims come to.
    """

    out: Out
    morphology: BodiesFile = None
    damage: BodyDamage = "none"
    random_damages: RandomDamages = 0
    world: WorldConfig = field(default_factory=WorldConfig)
    config: Annotated[EvolveConfig, tyro.conf.arg(name="")] = field(default_factory=EvolveConfig)

    def execute(self) -> None:
        """Evolve to the last generation, with progress."""
        before = len(finished_generations(self.out))
        bodies = _bodies(self, Damage.parse(self.damage))
        try:
            with (
                _no_folder_for_nothing(self.out),
                _counting("evolving", self.config.plan.rows, before) as show,
            ):
                evolved = evolve_gait(
                    bodies,
                    self.config,
                    out=self.out,
                    world=self.world,
                    on_generation=lambda row: show(row.generation + 1, _line(row)),
                )
        except KeyboardInterrupt:
            done = finished_generations(self.out)
            _plot(self.out, done)
            rest = f"{RESUMES} from generation {len(done)}" if done else "nothing is kept yet"
            raise KeyboardInterrupt(f"interrupted; {rest}") from None
        _plot(self.out, evolved.history)
        network = evolved.controller
        print(
            f"swims {_said(evolved, self.config)} ({network.nodes} nodes, {network.connections} "
            f"connections); {CONTROLLER_FILE} and {HISTORY_FILE} are in {self.out}"
        )


@dataclass(frozen=True)
class TransferCommand:
    """Swim a controller on the body it was evolved on, and on a target.

    Attributes
    ----------
    controller
        A controller.json, as evolve writes it; it holds the body it was evolved on.
    out
        Directory for transfer.json and trajectories.png, if they are wanted.
    """

    controller: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    target_morphology: TargetMorphology = None
    target_damage: TargetDamage = "none"
    target_world: WorldConfig = field(default_factory=WorldConfig)
    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    config: Annotated[TransferConfig, tyro.conf.arg(name="")] = field(
        default_factory=TransferConfig
    )

    def execute(self) -> None:
        """Swim both and print a table."""
        controller = Controller.load(self.controller)
        body = read_morphology(self.target_morphology, "target_morphology")
        target = Damage.parse(self.target_damage).apply(body)
        out = self.out and ensure_writable_directory(self.out)
        swims = 2 * (self.config.poses + 1)
        with Console(stderr=True).status(f"{swims} swims of {self.config.seconds:g} s"):
            result = transfer(controller, target, self.config, world=self.target_world)
        print(result)
        if out:
            from gait.plots import plot_trajectories

            document = {
                "native_morphology": controller.morphology.to_dict(),
                "target_morphology": target.to_dict(),
                "native_engine": check_engine(self.config.native_engine),
                "target_engine": check_engine(self.config.target_engine),
                "target_world": asdict(self.target_world),
                "seconds": self.config.seconds,
                "seed": self.config.seed,
                **result.to_dict(),
            }
            write_document(out / "transfer.json", document, "gait.transfer/2")
            paths = {"native": result.native.swim, "target": result.target.swim}
            plot_trajectories(out / "trajectories.png", paths)


@dataclass(frozen=True)
class BaselineCommand:
    """Learn to swim, or another task, with stable-baselines3, for comparison.

    What PPO, SAC or TD3 learns is a controller as any other. It knows where its fins are, without
    which little is learned, unless --senses imu clock. The extra rl is needed.

    With --damage random:moderate something else breaks in each episode.

    Into --out go controller.json (the best so far), curve.csv (a row a leg, an episode of each
    robot), settings.json, curve.png and, of PPO, checkpoint.npz. The same command resumes a
    run of PPO that was interrupted, and more --steps prolong it; SAC and TD3 start again.

    A file with a sample of bodies, or --random-damages, gives the robots that learn side by side
    other bodies in turn: domain randomisation. The sample goes into --out, too.

    Columns of curve.csv, with distances in units of 5 cm:
    - steps: actions so far, of all robots together.
    - training: mean distance of the leg's episodes, in which it tries this and that.
    - score: its mean distance in 20 s, without trying, from 32 random poses, always the same; of a
    sample so many that each body swims equally often.
    Of another task, read the sum of the rewards times the seconds that each is for.
    """

    out: Out
    morphology: BodiesFile = None
    damage: EpisodeDamage = "none"
    random_damages: RandomDamages = 0
    config: Annotated[BaselineConfig, tyro.conf.arg(name="")] = field(
        default_factory=BaselineConfig
    )

    def execute(self) -> None:
        """Learn to the last leg, with progress."""
        config, curve = self.config, list[Leg]()
        own, strikes = Damage.parse(self.damage).split()
        bodies = _bodies(self, own)
        with _counting(config.algorithm, config.legs * config.leg) as show:

            def tell(steps: int, legs: Sequence[Leg]) -> None:
                curve[:] = legs
                show(steps, _learned(legs[-1]) if legs else config.algorithm)

            try:
                with _no_folder_for_nothing(self.out):
                    learned = train_baseline(
                        bodies, config, damage=strikes, out=self.out, on_step=tell
                    )
            except KeyboardInterrupt:
                self._plot(curve)
                kept = (self.out / CHECKPOINT_FILE).exists()
                rest = RESUMES if kept else "the same command starts again"
                raise KeyboardInterrupt(f"interrupted; {rest}") from None
        self._plot(curve)
        over = f"{len(bodies)} bodies" if len(bodies) > 1 else f"{FINAL_POSES} random poses"
        what = f"swims {learned.score:.2f} units in 20 s"
        if config.task != "forward" or strikes:
            what = f"earns {learned.score:.2f} in {config.seconds:g} s"
        print(
            f"{what} on the mean over {over}; {CONTROLLER_FILE} and {CURVE_FILE} are in {self.out}"
        )

    def _plot(self, curve: Sequence[Leg]) -> None:
        from gait.plots import plot_curve

        if curve:
            plot_curve(self.out / "curve.png", curve)


COMMANDS: Commands = {
    "evolve": (Evolve, "evolve a gait for a body, or for a sample of bodies"),
    "transfer": (TransferCommand, "swim a gait on another body"),
    "baseline": (BaselineCommand, "train a learner of stable-baselines3"),
}


def _bodies(command: Evolve | BaselineCommand, damage: Damage) -> list[Morphology]:
    """Return the bodies that a command is to swim, so damaged."""
    file = command.morphology
    bodies = [None] if file is None else read_bodies(file, "morphology")
    several = [damage.apply(Morphology.coerce(body)) for body in bodies]
    most = max(0, MAXIMUM_BODIES - len(several))
    count = integer("random_damages", command.random_damages, 0, most)
    return several + damaged_at_random(several[0], count, command.config.seed)


@contextmanager
def _no_folder_for_nothing(out: Path) -> Iterator[None]:
    """Remove a folder that a command made if the command fails before anything is in it."""
    new = not out.exists()
    try:
        yield
    except BaseException:
        with suppress(OSError):
            if new and {path.name for path in out.iterdir()} <= {SETTINGS}:
                (out / SETTINGS).unlink(missing_ok=True)
                out.rmdir()
        raise


@contextmanager
def _counting(label: str, total: int, before: int = 0) -> Iterator[Callable[[int, str], None]]:
    """Give a progress bar, or ten lines on stderr where there is no terminal to show one on.

    It is told how much is done, and a line about it.
    """
    said = before * 10 // total
    with _bar() as bar:
        task = bar.add_task(label, total=total)

        def show(done: int, text: str) -> None:
            nonlocal said
            bar.update(task, completed=done, description=text)
            if bar.disable and done * 10 // total > said:
                said = done * 10 // total
                print(f"{done}/{total}  {text}", file=sys.stderr, flush=True)

        yield show


def _bar() -> Progress:
    console = Console(stderr=True)
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=10),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )


def _said(evolved: Evolved, config: EvolveConfig) -> str:
    """Say how far an evolved controller swims."""
    far, bodies = f"{evolved.fitness:.2f} units in {config.seconds:g} s", len(evolved.distances)
    if not config.poses:
        return f"{far} from the zero pose"
    mean = config.aggregate == "mean"
    over = "on the mean over" if mean else f"or more in {1 - config.quantile:.0%} of swims over"
    if bodies == 1:
        return f"{far} {over} the zero pose and {FINAL_POSES} random ones"
    worst, most, half = np.quantile(evolved.distances, (0.0, 0.1, 0.5))
    return (
        f"{far} {over} {bodies} bodies: {worst:.2f} on the worst, {most:.2f} or more on nine of "
        f"ten, {half:.2f} or more on half"
    )


def _line(row: Generation) -> str:
    return f"final {row.final:6.2f}  mean {row.mean:6.2f}  species {row.species}  nodes {row.nodes}"


def _learned(leg: Leg) -> str:
    return f"training {leg.training:6.2f}  score {leg.score:6.2f}"


def _plot(out: Path, history: Sequence[Generation]) -> None:
    from gait.plots import plot_history

    if history:
        plot_history(out / "history.png", history)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    return run_command_line("gait", COMMANDS, arguments)
