"""The commands ``python -m eea run`` and ``recover``: one robot models itself, into one folder."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console

from aquafish_gym.command_line import (
    AnyDamage,
    ModelEngine,
    Out,
    TargetEngine,
    TargetMorphology,
    Threads,
    read_morphology,
)
from aquafish_gym.damage import Damage
from aquafish_gym.engines.packages import resolve_engine
from aquafish_gym.morphology import DIMENSIONS, FIN_WORDS, Morphology
from aquafish_gym.runs.manifest import LOCK, lock, write_manifest
from aquafish_gym.runs.storage import (
    DamagedFileError,
    ensure_writable_directory,
    read_document,
)
from eea.cli.arms import ArmSettings
from eea.cli.outcome import (
    MASS,
    PICTURE,
    RESULT,
    belief_words,
    draw_posterior,
    outcome_words,
    size_table,
    write_outcome,
)
from eea.core.config import Condition, Config, JointConfig, config_for, recovery_config
from eea.core.result import SCHEMA, Result, RoundRecord
from eea.core.session import Session, streams
from eea.fish import EngineTarget, RealityGap, fish_eea
from eea.fish.simulator import SimulatorOptions

KIND = "a run of the algorithm"
SHARE_WORDS = {0.0: "nothing of", 0.25: "a quarter of", 0.5: "half", 0.75: "three quarters of"}


@dataclass(frozen=True)
class Run:
    """Let a damaged fish work out its own body, and write down each round.

    Into --out go settings.json (what is run), result.json (all rounds so far, after each),
    morphology.json (the body found, for gait evolve --morphology) and rounds.png; of the condition
    joint, which also knows how sure it is, posterior.npz (for eea.load_posterior), posterior.png
    and bodies.json (50 bodies that the trials allow, for gait evolve --morphology). An earlier run
    of the same settings is replaced once this one has as many rounds; anything else is refused.
    """

    out: Out
    condition: Condition = "out-of-band"  #: How the hidden angles are treated.
    steps: int = 256  #: Length of a trial in steps of 0.01 s.
    rounds: int | None = None  #: Trials, one a round; by default those of the condition.
    time_limit: float | None = None  #: Begin no round after this many seconds; None for no limit.
    #: Settings of the algorithm.
    settings: Annotated[ArmSettings, tyro.conf.arg(name="")] = field(default_factory=ArmSettings)
    seed: int = 0  #: Everything random follows from it.
    target_damage: AnyDamage = "none"
    target_morphology: TargetMorphology = None
    target_engine: TargetEngine = "auto"
    engine: ModelEngine = "numba"
    #: The compiled engine's precision, for the candidates.
    dtype: Literal["float32", "float64"] = "float32"
    #: Velocity of the water, units/s, for target and candidates.
    current: tuple[float, float, float] = (0.0, 0.0, 0.0)
    substeps: int = 1  #: Physics steps in each 0.01 s, for target and candidates.
    #: How the target's world differs from the candidates', which they do not know.
    gap: RealityGap = field(default_factory=RealityGap)
    threads: Threads = None

    def base(self) -> Config:
        """Return the condition's own settings."""
        return config_for(self.condition)

    def config(self) -> Config:
        """Return the settings that the options describe."""
        base = self.base()
        rounds = base.rounds if self.rounds is None else self.rounds
        base = replace(base, steps=self.steps, rounds=rounds, time_limit=self.time_limit)
        return self.settings.over({"run": base})["run"]

    def execute(self) -> None:
        """Run to a stop rule, with a line a round.

        If an option is wrong nothing has been written.
        """
        config, damage = self.config(), Damage.parse(self.target_damage)
        intact = read_morphology(self.target_morphology, "target_morphology")
        target = EngineTarget(
            intact,
            damage,
            streams(self.seed)["target"],
            config.steps,
            self.target_engine,
            self.current,
            self.substeps,
            gap=self.gap,
        )
        simulator: SimulatorOptions = {
            "engine": resolve_engine("engine", self.engine),
            "dtype": self.dtype,
            "current": self.current,
            "substeps": self.substeps,
            "threads": self.threads,
        }
        eea = fish_eea(target, config, self.seed, target.morphology, **simulator)
        simulator.pop("threads")  # no result depends on them
        settings = {
            **config.to_dict(),
            "seed": self.seed,
            "target_damage": str(damage),
            "target_morphology": intact.to_dict(),
            "target_engine": target.engine,
            "gap": asdict(self.gap),
            **simulator,
        }
        with lock(ensure_writable_directory(self.out)):
            others = sorted(path.name for path in self.out.iterdir() if path.name != LOCK)
            # Whatever code an earlier run is of, this one begins anew and replaces it.
            write_manifest(self.out, KIND, settings, others)
            _fill(self.out, eea, intact, damage)


@dataclass(frozen=True)
class Recover(Run):
    """As run, with the settings and the damage of the damage-recovery case study as defaults.

    Unlike run, which follows the paper and breaks nothing, it cuts the left flipper to half its
    length, and infers the angles of five earlier trials anew in each search, which finds the body
    better (see recovery_config in eea/core/config.py).
    """

    target_damage: AnyDamage = "left_pectoral:length=0.5"

    def base(self) -> Config:
        """Return the case study's settings."""
        return recovery_config()


def _fill(folder: Path, eea: Session[Any], intact: Morphology, damage: Damage) -> None:
    """Run to a stop rule in a locked folder, and say what was found, also after Ctrl-C."""
    console = Console(highlight=False, soft_wrap=True, markup=False)
    config, earlier = eea.config, _earlier_rounds(folder)
    if earlier:
        console.print(f"replacing the earlier run in {folder} ({_rounds(earlier)})")
    try:
        with console.status(f"round 1 of {config.rounds}, {config.condition}") as status:
            for record in eea:
                if record.round >= earlier:
                    write_outcome(folder, eea.result)
                console.print(_progress_line(record, eea.result))
                status.update(f"round {record.round + 1} of {config.rounds}, {config.condition}")
    finally:
        result = eea.result
        done = len(result.rounds)
        if result.stopped == "interrupted" and done < earlier:
            console.print(
                f"stopped: interrupted after {_rounds(done)}; {folder} still holds the earlier "
                f"run ({_rounds(earlier)})"
            )
        else:
            write_outcome(folder, result)
            _conclude(folder, result, intact, damage, console)


def _earlier_rounds(folder: Path) -> int:
    """Return how many rounds a result in the folder has; 0 for none or a damaged one."""
    path = folder / RESULT
    try:
        return len(read_document(path, SCHEMA, "out")["rounds"]) if path.exists() else 0
    except (DamagedFileError, KeyError, TypeError):
        return 0


def _conclude(
    folder: Path, result: Result, intact: Morphology, damage: Damage, console: Console
) -> None:
    """Draw the rounds and print what is known."""
    if not result.rounds:
        console.print("no round was completed")
    else:
        from aquafish_gym.rendering.pictures import save_figure
        from eea.fish.run_figure import fitness_figure

        save_figure(fitness_figure(result), folder / PICTURE)
        draw_posterior(folder, result)
        broken = damage_words(intact, damage, result)
        for line in [*size_table(result), *broken, *belief_words(result)]:
            console.print(line)
        for line in outcome_words(folder, result):
            console.print(line)
    console.print(f"stopped: {_why(result)}; written to {folder}")
    if result.stopped == "interrupted":
        console.print("the same command begins anew, and replaces this with as many rounds")


def damage_words(intact: Morphology, damage: Damage, result: Result) -> list[str]:
    """Return what broke, and what was found of it, a line for each size that the damage changed.

    For example ``left flipper: half its length, found 0.79 where it was 1.60``. And a line for
    faults of no size, or that do not last.
    """
    assert result.truth is not None
    sizes = zip(DIMENSIONS, intact.to_array(), result.truth, result.model, strict=True)
    said = []
    for dimension, before, after, found in sizes:
        if after != before:
            share = after / before if before else float("inf")
            words = SHARE_WORDS.get(round(share, 6), f"{share:.0%} of")
            what = f"{FIN_WORDS[dimension.fin]}: {words} its {dimension.size}"
            said.append(f"{what}, found {found:.2f} where it was {before:.2f}")
    others = Damage(tuple(fault for fault in damage if fault.words or fault.when))
    return said + ([others.in_words(intact)] if others else []) or ["nothing was broken"]


def _why(result: Result) -> str:
    """Return why a run ended, and what the stop rules of joint inference mean by it."""
    why = result.stopped
    if why == "narrow" and isinstance(result.config, JointConfig):
        width = result.config.max_interval_width
        return f"{why}, every {MASS:.0%} interval is at most {width:.2g} of its range"
    return why


def _rounds(count: int) -> str:
    return f"{count} round{'' if count == 1 else 's'}"


def _progress_line(record: RoundRecord, result: Result) -> str:
    counted = f"{record.round:2d}/{result.config.rounds}"
    rest = f"OBJ_FIT {record.objective_fitness:5.3f}  {record.seconds:6.1f} s"
    if result.belief is None:
        return f"experiments {counted}  best MOD_FIT {record.model_fitness:6.3f}  {rest}"
    wide = 100.0 * result.width(MASS)
    return f"experiments {counted}  {MASS:.0%} intervals {wide:.2g}% of the ranges wide  {rest}"
