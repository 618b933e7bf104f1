"""The command line: ``python -m eea run --condition out-of-band --out DIR``."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console
from tyro.extras import SubcommandApp

from aquafish_gym.commandline import BAD_INPUT, read_morphology, run_command_line
from aquafish_gym.damage import Damage
from aquafish_gym.morphology import DIMENSIONS
from aquafish_gym.storage import append_record, ensure_writable_directory, write_json
from aquafish_gym.validation import InvalidArgumentError
from eea.algorithm import Result, RoundRecord, streams
from eea.aquafish import EngineTarget, fish_eea
from eea.checks import ConfigurationError, TargetError, choice
from eea.config import EEAConfig, recovery_config

REFUSED = (*BAD_INPUT, ConfigurationError, TargetError)
ROUNDS, RESULT, PICTURE = "rounds.jsonl", "result.json", "rounds.png"

app = SubcommandApp()


@app.command(name="run")
@dataclass(frozen=True)
class Run:
    """Let a damaged fish work out its own body, and write down each round.

    Into --out go run.json (what is run), rounds.jsonl (a record a round, as it ends), result.json
    and rounds.png. An earlier run there is replaced if it is the same run, and else refused.

    Attributes
    ----------
    out
        Directory for the results; made if need be.
    config
        Settings of the algorithm.
    seed
        Everything random follows from it.
    target_damage
        What broke, as left_pectoral:length=0.5, or none.
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
        directory = _prepare(self.out, header)
        console = Console(highlight=False, soft_wrap=True)
        try:
            with console.status(_waiting(self.config, 0)) as status:
                for record in eea:
                    append_record(directory / ROUNDS, record.to_dict())
                    console.print(_progress_line(record, self.config))
                    status.update(_waiting(self.config, record.round))
        finally:
            _conclude(directory, eea.result, console)


@app.command(name="recover")
@dataclass(frozen=True)
class Recover(Run):
    """As run, with the settings of the damage-recovery case study as defaults.

    They are what is recommended; ``eea.recovery_config`` says why.
    """

    config: Annotated[EEAConfig, tyro.conf.arg(name="")] = field(default_factory=recovery_config)


class Commands:
    """The subcommands, the nearest of which is offered for an unknown one."""

    def cli(self, *, prog: str | None = None, args: Sequence[str] | None = None) -> Any:
        """Return the command that the arguments ask for."""
        words = sys.argv[1:] if args is None else args
        if words and not words[0].startswith("-"):
            choice("the command", words[0], ("run", "recover"))
        return app.cli(prog=prog, args=args)


def _prepare(out: Path, header: dict[str, Any]) -> Path:
    """Make the directory ready; refuse to replace anything but an earlier run of the same."""
    directory = ensure_writable_directory(out)
    path = directory / "run.json"
    present = [name for name in (ROUNDS, RESULT, PICTURE) if (directory / name).exists()]
    if path.exists():
        try:
            same = json.loads(path.read_bytes()) == json.loads(json.dumps(header))
        except ValueError:
            same = False
        if not same:
            raise InvalidArgumentError(
                f"out must be a new directory or hold an earlier run of the same settings; "
                f"{directory} holds another run"
            )
    elif present:
        raise InvalidArgumentError(
            f"out must be a new directory or hold an earlier run of the same settings; "
            f"{directory} holds {' and '.join(present)} but no run.json, so they are not a run's"
        )
    for name in present:
        (directory / name).unlink()
    write_json(path, header)
    return directory


def _conclude(directory: Path, result: Result, console: Console) -> None:
    """Write what is known, also after Ctrl-C."""
    write_json(directory / RESULT, result.to_dict())
    if result.rounds:
        from eea.plots import save_fitness_figure

        save_fitness_figure(result, directory / PICTURE)
        for dimension, found, true in zip(
            DIMENSIONS, result.model, result.truth if result.truth is not None else [], strict=False
        ):
            console.print(f"{dimension.name:26s} found {found:5.3f}   true {true:5.3f}")
    else:
        console.print("no round was completed")
    console.print(f"stopped: {result.stopped}; written to {directory}")


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
