"""The command line: ``python -m eea run --condition out-of-band --out DIR``."""

from __future__ import annotations

import contextlib
import difflib
import io
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console
from tyro.extras import SubcommandApp

from aquafish_gym.damage import Damage
from aquafish_gym.morphology import DIMENSIONS
from aquafish_gym.runs.locks import only_here
from aquafish_gym.runs.storage import ensure_writable_directory
from aquafish_gym.utils.command_line import BAD_INPUT, read_morphology, run_command_line
from eea.aquafish.fish import EngineTarget, fish_eea
from eea.cli.folder import MODEL, RunFolder
from eea.cli.study import Merge, Plot, StudyCommand
from eea.core.algorithm import EEA, Result, RoundRecord, streams
from eea.core.checks import ConfigurationError, TargetError, choice
from eea.core.config import EEAConfig, recovery_config

REFUSED = (*BAD_INPUT, ConfigurationError, TargetError)
app = SubcommandApp()


@app.command(name="run")
@dataclass(frozen=True)
class Run:
    """Let a damaged fish work out its own body, and write down each round.

    Into --out go run.json (what is run), rounds.jsonl (a record a round, as it ends), result.json,
    morphology.json (the body found, for gait evolve --morphology) and rounds.png. An earlier run
    of the same settings is gone on with if it was broken off, and else replaced once this one has
    as many rounds; any other is refused.

    Attributes
    ----------
    out
        Directory for the results; made if need be.
    config
        Settings of the algorithm.
    seed
        Everything random follows from it.
    target_damage
        What broke: none, or FIN:SIZE=FACTOR or FIN:missing, joined by ";". FIN is left_pectoral,
        right_pectoral or caudal; SIZE is length, width or thickness.
    target_morphology
        JSON file of the body before the damage; without it, the nominal body.
    target_engine
        Where the target swims.
    engine
        Where the candidate models swim.
    dtype
        The compiled engine's precision, for the candidates.
    current
        Velocity of the water, units/s.
    substeps
        Physics steps in each 0.01 s.
    threads
        Cores to use; None for all. No result depends on it.
    """

    out: Path
    config: Annotated[EEAConfig, tyro.conf.arg(name="")] = field(default_factory=EEAConfig)
    seed: int = 0
    target_damage: str = "none"
    target_morphology: Path | None = None
    target_engine: Literal["pybullet", "numba"] = "pybullet"
    engine: Literal["numba", "pybullet"] = "numba"
    dtype: Literal["float32", "float64"] = "float32"
    current: tuple[float, float, float] = (0.0, 0.0, 0.0)
    substeps: int = 1
    threads: int | None = None

    def execute(self) -> None:
        """Run to a stop rule, with a line a round.

        Raises
        ------
        InvalidArgumentError, EngineUnavailableError, ConfigurationError
            If an option is wrong; nothing has been written then.
        """
        damage = Damage.parse(self.target_damage)
        target = EngineTarget(
            read_morphology(self.target_morphology, "target_morphology"),
            damage,
            streams(self.seed)["target"],
            self.config.steps,
            self.target_engine,
            self.current,
            self.substeps,
        )
        eea = fish_eea(
            target,
            self.config,
            self.seed,
            target.morphology,
            engine=self.engine,
            dtype=self.dtype,
            current=self.current,
            substeps=self.substeps,
            threads=self.threads,
        )
        header = {
            "schema": "eea.run/1",
            "seed": self.seed,
            "config": self.config.to_dict(),
            "target_morphology": target.morphology.to_dict(),
            "target_damage": damage.to_list(),
            "target_engine": self.target_engine,
            "engine": self.engine,
            "dtype": self.dtype,
            "current": list(self.current),
            "substeps": self.substeps,
            "versions": {name: version(name) for name in ("aquafish-gym", "numba", "numpy")},
        }
        with only_here(ensure_writable_directory(self.out)):
            self._fill(eea, header)

    def _fill(self, eea: EEA, header: dict[str, Any]) -> None:
        """Run to a stop rule in the folder, which is held."""
        folder = RunFolder(self.out, header)
        console = Console(highlight=False, soft_wrap=True, markup=False)
        if folder.resume(eea):
            done = _rounds(len(eea.result.rounds))
            console.print(f"going on with the earlier run in {folder.path} ({done})")
        elif folder.earlier is not None:
            console.print(f"replacing the earlier run in {folder.path} ({_rounds(folder.earlier)})")
        try:
            with console.status(_waiting(self.config, len(eea.result.rounds))) as status:
                for record in eea:
                    folder.add(eea)
                    console.print(_progress_line(record, self.config))
                    status.update(_waiting(self.config, record.round))
        finally:
            _conclude(folder, eea.result, console)


@app.command(name="recover")
@dataclass(frozen=True)
class Recover(Run):
    """As run, with the recommended settings as defaults, those of the damage-recovery case study.

    Unlike run, which follows the paper, it infers the angles of five earlier trials anew in each
    search, which finds the body better (see recovery_config in eea/config.py).
    """

    config: Annotated[EEAConfig, tyro.conf.arg(name="")] = field(default_factory=recovery_config)


app.command(name="study")(StudyCommand)
app.command(name="plot")(Plot)
app.command(name="merge")(Merge)


class Commands:
    """The subcommands, the nearest of which is offered for an unknown one."""

    def cli(self, *, prog: str | None = None, args: Sequence[str] | None = None) -> Any:
        """Return the command that the arguments ask for."""
        words = sys.argv[1:] if args is None else args
        if words and not words[0].startswith("-"):
            choice("the command", words[0], ("run", "recover", "study", "plot", "merge"))
        said = io.StringIO()
        try:
            with contextlib.redirect_stderr(said):
                command = app.cli(prog=prog, args=args)
        except SystemExit as stop:
            if stop.code and "Missing from" in said.getvalue():
                if words[:1] == ["plot"]:
                    raise ConfigurationError(
                        "FOLDER, the directory of a study, is required"
                    ) from None
                options = [word for word in words if word.startswith("--")]
                close = difflib.get_close_matches("--out", options, n=1)
                got = f"; got {close[0]}" if close else ""
                raise ConfigurationError(f"--out is required{got}") from None
            sys.stderr.write(said.getvalue())
            raise
        # A study reads its settings again over those of each of its arms.
        return replace(command, words=tuple(words)) if words[:1] == ["study"] else command


def _conclude(folder: RunFolder, result: Result, console: Console) -> None:
    """Write and print what is known, also after Ctrl-C."""
    if not folder.conclude(result):
        console.print(
            f"stopped: {result.stopped} after {_rounds(len(result.rounds))}; {folder.path} "
            f"still holds the earlier run ({_rounds(folder.earlier or 0)})"
        )
        return
    if not result.rounds:
        console.print("no round was completed")
    else:
        for line in _table(result):
            console.print(line)
        model = folder.path / MODEL
        console.print(f"the body found is {model}, for python -m gait evolve --morphology {model}")
    console.print(f"stopped: {result.stopped}; written to {folder.path}")


def _table(result: Result) -> list[str]:
    """Return the sizes found, beside the true ones where they are known, and OBJ_FIT."""
    lines = [f"{'in units of 5 cm':26s} {'found':>6s}"]
    lines += [
        f"{dimension.name:26s} {found:6.3f}"
        for dimension, found in zip(DIMENSIONS, result.model, strict=True)
    ]
    if result.truth is None:
        return lines
    true = [f"{'true':>6s}", *(f"{size:6.3f}" for size in result.truth)]
    return [f"{line}  {size}" for line, size in zip(lines, true, strict=True)] + [
        f"OBJ_FIT {result.rounds[-1].objective_fitness:.2f}; the true body scores 1, "
        f"a random body {result.chance:.2f}, a mid-range body {result.mid_range:.2f}"
    ]


def _rounds(count: int) -> str:
    """Return ``1 round``, ``2 rounds`` and so on."""
    return f"{count} round{'' if count == 1 else 's'}"


def _waiting(config: EEAConfig, done: int) -> str:
    return f"round {done + 1} of {config.rounds}, {config.condition}"


def _progress_line(record: RoundRecord, config: EEAConfig) -> str:
    objective = record.objective_fitness
    return (
        f"experiments {record.round:2d}/{config.rounds}  "
        f"best MOD_FIT {record.model_fitness:6.3f}  "
        f"OBJ_FIT {'unknown' if objective is None else f'{objective:5.3f}'}  "
        f"{record.seconds:6.1f} s"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code.

    2 and one line for a command or a setting that is wrong, 130 after Ctrl-C.
    """
    return run_command_line("eea", Commands(), arguments, REFUSED)


if __name__ == "__main__":
    sys.exit(main())
