"""The command ``aquafish run``: one simulated robot infers its own body."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

from tyro.conf import arg

from aquafish_gym.bodies import plan_key
from aquafish_gym.damage import Damage
from aquafish_gym.engines.packages import resolve_engine
from aquafish_gym.plans import BodyPlan
from aquafish_gym.runs.command_line import (
    AnyDamage,
    Given,
    Out,
    Plan,
    Reactive,
    TargetEngine,
    TargetMorphology,
    Threads,
    read_morphology,
)
from aquafish_gym.runs.manifest import check_folder, result_folder
from eea.cli.options import AlgorithmOptions
from eea.cli.outcome import draw_outcome, file_lines, remove_outcome, write_outcome
from eea.cli.progress import plain_console, progress_bar
from eea.core.config import Condition, Config, JointConfig, check_read, config_for, with_settings
from eea.core.result import Result, RoundRecord
from eea.core.session import Session, streams
from eea.fish import EngineTarget, MorphologyEstimate, RealityGap, fish_eea
from eea.fish.estimate import STATED_MASS, body_lines, end_lines
from eea.fish.joint import check_groups

KIND = "a run of the algorithm"
# Reasons for the end of a session, in words.
STOP_REASONS = {
    "rounds": "all rounds are done",
    "narrow": "all intervals are narrow enough",
}


@dataclass(frozen=True)
class Run(Given):
    """Let a damaged robot infer its own body from a few trials.

    --out receives settings.json, result.json (all rounds so far), times.json, morphology.json (the
    inferred body) and rounds.png. Joint inference adds posterior.npz, posterior.png and bodies.json
    (50 bodies from the posterior). The same command starts the run again; a folder with other
    settings is refused.
    """

    example: ClassVar[str] = "--damage left_pectoral:length=0.5 --seed 1 --out out/run"
    main_options: ClassVar[tuple[str, ...]] = (
        "out", "condition", "rounds", "seed", "plan", "damage", "target_morphology",
        "target_engine", "threads",
    )  # fmt: skip

    out: Out = Path("out/run")
    #: Inference of the hidden fin angles. "joint" infers body, angles and nuisances together, with
    #: intervals. The others are the paper's; "recovery" is out-of-band inference with the settings
    #: of the case study.
    condition: Condition = "joint"
    steps: int = 256  #: Length of a trial in steps of 0.01 s; a power of two, except for joint.
    #: Trials of the target, one a round; by default 3 for joint, 16 for recovery, 25 otherwise.
    rounds: int | None = None
    settings: Annotated[AlgorithmOptions, arg(name="")] = field(default_factory=AlgorithmOptions)
    seed: int = 0  #: Seed of everything random.
    plan: Plan = "aquafish"
    damage: AnyDamage = "none"
    target_morphology: TargetMorphology = None
    target_engine: TargetEngine = "auto"
    #: Velocity of the water, units/s, for target and models.
    current: tuple[float, float, float] = (0.0, 0.0, 0.0)
    #: Differences of the target's world from the models' world.
    gap: RealityGap = field(default_factory=RealityGap)
    reactive: Reactive = False
    threads: Threads = None

    def config(self) -> Config:
        """Return the settings of the condition with those of the options."""
        base = config_for(self.condition)
        rounds = base.rounds if self.rounds is None else self.rounds
        base = replace(base, steps=self.steps, rounds=rounds)
        changes = self.settings.changes(self.given)
        check_read(changes, {self.condition})
        config: Config = with_settings(base, changes)
        return config

    def execute(self) -> None:
        """Run until a stop rule holds; nothing is written if an option is wrong."""
        config = self.config()
        intact = read_morphology(self.target_morphology, "target_morphology", self.plan)
        if isinstance(config, JointConfig):
            check_groups(config.nuisances, intact.plan)  # before anything is compiled
        damage = Damage.parse(self.damage)
        settings = {
            **config.to_dict(),
            **plan_key(intact.plan),
            "seed": self.seed,
            "target_damage": str(damage),
            "target_morphology": intact.to_dict(),
            "target_engine": resolve_engine("target_engine", self.target_engine),
            "gap": asdict(self.gap),
            "current": self.current,
            **({"reactive": True} if self.reactive else {}),
        }
        rng = streams(self.seed)["target"]
        check_folder(self.out, KIND, settings)  # before the target's first trial is compiled
        target = EngineTarget(
            intact, damage, rng, config.steps, self.target_engine, self.current, gap=self.gap,
            reactive=self.reactive,
        )  # fmt: skip
        session = fish_eea(
            target, config, self.seed, target.morphology, current=self.current,
            threads=self.threads, reactive=self.reactive,
        )  # fmt: skip
        with result_folder(self.out, KIND, settings):
            _fill(self.out, session, intact.plan)


def _fill(folder: Path, session: Session[Any], plan: BodyPlan) -> None:
    """Run a session, write its result after each round, and print the report, also after Ctrl-C."""
    console = plain_console()
    remove_outcome(folder)
    try:
        with progress_bar(console, "rounds") as bar:
            task = bar.add_task("", total=session.config.rounds)
            for record in session:
                result = _estimate(session, plan)
                write_outcome(folder, result)
                console.print(_round_line(record, result))
                bar.update(task, advance=1)
    finally:
        result = _estimate(session, plan)
        write_outcome(folder, result)
        lines = body_lines(result)
        if result.rounds:
            draw_outcome(folder, result)
            lines += file_lines(folder, result)
        why = STOP_REASONS.get(result.stopped, result.stopped)
        lines.append(f"stopped: {why}; written to {folder}")
        if result.rounds and result.belief is not None:
            lines += end_lines(result)
        for line in lines:
            console.print(line)


def _estimate(session: Session[Any], plan: BodyPlan) -> MorphologyEstimate:
    """Return a session's result as a body of a plan."""
    return MorphologyEstimate(**vars(session.result), plan=plan)


def _round_line(record: RoundRecord, result: Result) -> str:
    assert result.config is not None
    found = f"best MOD_FIT {record.model_fitness:6.3f}"
    if result.belief is not None:
        width = 100.0 * result.width(STATED_MASS)
        found = f"{STATED_MASS:.0%} intervals {width:.2g}% of the ranges wide"
        if not result.belief.good:
            found = "no body explains the trials"
    counted = f"{record.round:2d}/{result.config.rounds}"
    fitness = record.objective_fitness
    return f"experiments {counted}  {found}  OBJ_FIT {fitness:5.3f}  {record.seconds:6.1f} s"
