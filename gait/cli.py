"""The commands ``evolve``, ``transfer`` and ``baseline`` of ``python -m gait``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
import tyro
from rich.console import Console

from aquafish_gym.bodies import plan_key, read_bodies
from aquafish_gym.damage import Damage
from aquafish_gym.engines.api import check_engine
from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import PlanLike
from aquafish_gym.runs.command_line import (
    RESUMES,
    BodiesFile,
    BodyDamage,
    EpisodeDamage,
    Given,
    OptionalOut,
    Out,
    TargetMorphology,
    read_morphology,
)
from aquafish_gym.runs.manifest import result_folder
from aquafish_gym.runs.progress import show_progress
from aquafish_gym.utils.storage import write_document
from aquafish_gym.utils.validation import printable
from aquafish_gym.world_config import WorldConfig
from gait.controllers.controller import Controller
from gait.files import CONTROLLER_FILE
from gait.learning.train import CURVE_FILE, CurvePoint, LearningConfig, train
from gait.search.evolve import (
    FINAL_POSES,
    EvolveConfig,
    Evolved,
    Generation,
    evolve_gait,
)
from gait.search.history import HISTORY_FILE
from gait.swims.transfer import TransferConfig, transfer


@dataclass(frozen=True)
class Evolve(Given):
    """Evolve a gait for a body, or for a sample of bodies.

    Into --out go controller.json (the best so far), history.csv (a row a generation), history.png,
    checkpoint.json and settings.json. The same command resumes an interrupted run; with more
    generations (--generations, with NEAT --cma-generations) it goes on,
    unless several starts of plain NEAT follow each other.

    CMA-ES starts from the best of many random networks, and by successive halving the best start
    goes on. --search neat evolves networks by NEAT, and CMA-ES tunes the best ones; --paper is the
    paper's plain NEAT. --senses imu clock fins adds the fins, whose initial angles a self-model
    estimates. A bodies.json with a sample of bodies, as estimations write it, gives a gait that
    does well on all of them at no extra time.

    Columns of history.csv, with distances in units of 5 cm:
    - generation: from 0, over all starts.
    - best, mean: over the generation's controllers, each one's mean distance.
    - species: number of species; of CMA-ES, of starts still alive.
    - final: the same of the generation's winner, over the zero pose and 32 fixed random ones. The
    winner is the best there of NEAT's 8 leaders, or the mean of CMA-ES's distribution, in every
    fourth generation; rows in between repeat it.
    - distance: the winner's from the zero pose, on the first body.
    - nodes, connections: of the winner's network.
    """

    example: ClassVar[str] = "--morphology out/swim/bodies.json --out out/evolve"
    main_options: ClassVar[tuple[str, ...]] = (
        "out", "plan", "morphology", "damage", "config", "senses", "task", "search", "generations",
        "seed", "threads",
    )  # fmt: skip

    out: Out = Path("out/evolve")
    morphology: BodiesFile = None
    damage: BodyDamage = "none"
    world: WorldConfig = field(default_factory=WorldConfig)
    config: Annotated[EvolveConfig, tyro.conf.arg(name="")] = field(default_factory=EvolveConfig)

    def execute(self) -> None:
        """Evolve to the last generation, with progress."""
        if self.config.task != "forward":
            self.refuse_given(["seconds"], "except with --task forward")
        bodies = _bodies(self.morphology, Damage.parse(self.damage), self.config.plan)
        drawn = _drawn_progress(
            "evolving",
            self.config.choices.rows,
            self.out / HISTORY_FILE,
            ("final (the winner)", "mean (all)", "generation"),
            lambda done: f"{RESUMES} from generation {done}",
        )
        with drawn as show:

            def report(row: Generation) -> None:
                text = f"final {row.final:6.2f}  mean {row.mean:6.2f}  nodes {row.nodes}"
                show((row.generation, row.final, row.mean), text)

            evolved = evolve_gait(
                bodies, self.config, out=self.out, world=self.world, on_generation=report
            )
        network = evolved.controller
        print(
            f"{_result_text(evolved, self.config)} ({network.nodes} nodes, "
            f"{network.connections} connections); {CONTROLLER_FILE} and {HISTORY_FILE} are in "
            f"{printable(str(self.out))}"
        )


@dataclass(frozen=True)
class TransferCommand:
    """Swim a controller on the body it was evolved on, and on a target.

    Into --out go settings.json, transfer.json and trajectories.png.
    """

    example: ClassVar[str] = (
        "--controller out/evolve/controller.json --damage left_pectoral:length=0.5"
    )
    main_options: ClassVar[tuple[str, ...]] = (
        "controller", "target_morphology", "damage", "out", "config", "poses", "seconds", "seed",
        "target_engine",
    )  # fmt: skip

    controller: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """A controller.json, as evolve writes it; it holds the body it was evolved on."""
    target_morphology: TargetMorphology = None
    damage: Annotated[BodyDamage, tyro.conf.arg(aliases=("--target-damage",))] = "none"
    target_world: WorldConfig = field(default_factory=WorldConfig)
    native_world: WorldConfig = field(default_factory=WorldConfig)
    out: OptionalOut = None
    config: Annotated[TransferConfig, tyro.conf.arg(name="")] = field(
        default_factory=TransferConfig
    )

    def execute(self) -> None:
        """Swim both and print a table."""
        controller, config = Controller.load(self.controller), self.config
        body = read_morphology(self.target_morphology, "target_morphology", controller.plan)
        target = Damage.parse(self.damage).apply(body)
        document = {
            **plan_key(controller.plan),
            "native_morphology": controller.morphology.to_dict(),
            "target_morphology": target.to_dict(),
            "native_engine": check_engine(config.native_engine),
            "target_engine": check_engine(config.target_engine),
            "target_world": asdict(self.target_world),
            "seconds": config.seconds,
            "seed": config.seed,
        }
        if self.native_world != WorldConfig():
            document["native_world"] = asdict(self.native_world)
        settings = {"controller": controller.to_dict(), **asdict(config), **document}
        files = ("transfer.json", "trajectories.png")
        with result_folder(self.out, "a transfer of a gait", settings, files) as out:
            swims = 2 * (config.poses + 1)
            with Console(stderr=True).status(f"{swims} swims of {config.seconds:g} s"):
                result = transfer(
                    controller, target, config,
                    world=self.target_world, native_world=self.native_world,
                )  # fmt: skip
            print(result)
            if out:
                from gait.plots import plot_trajectories

                write_document(out / files[0], {**document, **result.to_dict()}, "gait.transfer/2")
                paths = {"native": result.native.swim, "target": result.target.swim}
                plot_trajectories(out / files[1], paths)


@dataclass(frozen=True)
class BaselineCommand:
    """Learn a task with PPO of stable-baselines3, for comparison. Needs the extra rl.

    The learned policy is a controller like any other. It senses its fins, without which little is
    learned, unless --senses imu clock. Robots have the bodies of a sample in turn: domain
    randomisation. Ctrl-C keeps the best controller so far; the same command starts again.

    Into --out go controller.json (the best so far), curve.csv (a row an epoch: an episode of each
    robot), curve.png and settings.json.

    Columns of curve.csv, with distances in units of 5 cm (for another task, rewards times the
    length of a step in s):
    - steps: actions so far, of all robots together.
    - training: mean distance of the epoch's episodes, with exploration.
    - score: mean distance in 20 s without exploration, from 32 fixed random poses.
    """

    example: ClassVar[str] = "--damage random:moderate --out out/baseline"

    out: Out = Path("out/baseline")
    morphology: BodiesFile = None
    damage: EpisodeDamage = "none"
    config: Annotated[LearningConfig, tyro.conf.arg(name="")] = field(
        default_factory=LearningConfig
    )

    def execute(self) -> None:
        """Learn to the last epoch, with progress."""
        config = self.config
        own, schedule = Damage.parse(self.damage).split()
        bodies = _bodies(self.morphology, own, config.plan)
        drawn = _drawn_progress(
            "PPO",
            config.epochs,
            self.out / CURVE_FILE,
            ("score (fixed poses)", "training", "actions of all robots"),
            lambda _done: f"the best controller so far is in {self.out}",
        )
        with drawn as show:

            def report(point: CurvePoint) -> None:
                text = f"training {point.training:6.2f}  score {point.score:6.2f}"
                show((point.steps, point.score, point.training), text)

            learned = train(bodies, config, damage=schedule, out=self.out, on_epoch=report)
        over = f"{len(bodies)} bodies" if len(bodies) > 1 else f"{FINAL_POSES} random poses"
        result = f"swims {learned.score:z.2f} units in 20 s"
        if config.task != "forward" or schedule:
            result = f"earns {learned.score:.2f} in {config.seconds:g} s"
        print(
            f"{result} on the mean over {over}; {CONTROLLER_FILE} and {CURVE_FILE} are in "
            f"{printable(str(self.out))}"
        )


@contextmanager
def _drawn_progress(
    label: str,
    total: int,
    table: Path,
    labels: tuple[str, str, str],
    kept: Callable[[int], str],
) -> Iterator[Callable[[tuple[int, float, float], str], None]]:
    """Show the progress of a search, and draw it beside its table in the end, also after Ctrl-C.

    The function that it yields takes the next row's (x, final, mean) and a line about it. For
    ``labels`` see ``plot_progress``. ``kept`` returns what an interruption leaves when the table
    has a number of rows, those of earlier runs included.
    """
    from gait.plots import plot_progress

    rows: list[tuple[int, float, float]] = []
    with show_progress(label, total) as show:

        def report(row: tuple[int, float, float], text: str) -> None:
            rows.append(row)
            show(len(rows), text)

        try:
            yield report
        except KeyboardInterrupt:
            done = len(table.read_text().splitlines()) - 1 if table.exists() else 0
            rest = kept(done) if done else "nothing is kept yet"
            raise KeyboardInterrupt(f"interrupted; {rest}") from None
        finally:
            if rows:
                x, final, mean = zip(*rows, strict=True)
                plot_progress(table.with_suffix(".png"), x, final, mean, labels)


def _bodies(file: Path | None, damage: Damage, plan: PlanLike) -> list[Morphology]:
    """Return the bodies of a plan in a file, or the nominal one, with damage."""
    bodies = [Morphology.nominal(plan)]
    if file is not None:
        bodies = [*read_bodies(file, "morphology", plan)]
    return [damage.apply(body) for body in bodies]


def _result_text(evolved: Evolved, config: EvolveConfig) -> str:
    """Return how far an evolved controller swims, or what it earns in a task, in words."""
    what = f"the zero pose and {FINAL_POSES} random ones" if config.poses else "the zero pose"
    if len(evolved.distances) > 1:
        worst, half = np.quantile(evolved.distances, (0.0, 0.5))
        what = f"{len(evolved.distances)} bodies: {worst:.2f} on the worst, median {half:.2f}"
    swims = f"swims {evolved.fitness:z.2f} units"
    result = swims if config.is_forward else f"earns {evolved.fitness:z.2f}"
    return f"{result} in {config.episode_seconds:g} s on the mean over {what}"
