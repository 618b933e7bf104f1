"""The command ``aquafish infer``: infer a body with intervals from a recorded swim."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from tyro.conf import arg

from aquafish_gym.bodies import plan_key
from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.command_line import (
    OptionalOut,
    Plan,
    Reactive,
    Threads,
    check_threads,
    read_morphology,
)
from aquafish_gym.runs.manifest import result_folder
from eea.cli.log_options import Between, ColumnMap, LogFile, column_map
from eea.cli.outcome import draw_outcome, file_lines, write_outcome
from eea.cli.progress import plain_console, waiting
from eea.core.config import FitConfig
from eea.core.session import streams
from eea.fish import infer_log, read_log
from eea.fish.estimate import body_lines, end_lines
from eea.fish.joint import check_groups
from eea.fish.swim_log import SwimLog
from eea.fish.windows import log_windows


@dataclass(frozen=True)
class Infer:
    """Infer the body from a recorded swim, with its uncertainty.

    The log is a CSV, Parquet, ArduPilot BIN, PX4 ULog or MCAP file with a row for each sample of
    the gyroscope. Its columns are time (s), gyro_x, gyro_y, gyro_z (rad/s about the body's axes: x
    right, y forward, z up), and the commands that the servos execute then, by the names of the
    plan's fins, as left_pectoral: in rev/s, or in Hz of a fin that sweeps. With several trials a
    column trial has their numbers. --map names the columns where they differ. docs/howto/logs.md
    has more.

    It prints whether a body explains the log, each size with its 90% interval, the nuisances, open
    questions, and the damage. If no body explains the log, it tries possible mistakes: axes, signs,
    exchanged commands, the clock, units. --out receives result.json, morphology.json,
    posterior.npz, posterior.png and bodies.json, as from run.
    """

    example: ClassVar[str] = "--log examples/logs/swim.csv --out out/swim"
    main_options: ClassVar[tuple[str, ...]] = (
        "log", "plan", "out", "columns", "between", "start", "noise", "nuisances", "seed", "truth",
        "threads",
    )  # fmt: skip

    log: LogFile
    plan: Plan = "aquafish"
    out: OptionalOut = None
    columns: ColumnMap = ()
    between: Between = ()
    #: Whether each trial's record begins at rest, or in ordinary swimming.
    start: Literal["rest", "moving"] = "rest"
    #: Standard deviation of the gyroscope's noise, rad/s; None to estimate it.
    noise: float | None = None
    #: Nuisances to infer, among current, drag, servo_gain, gyro_bias and lag. Default: all;
    #: "--nuisances" alone: none.
    nuisances: tuple[str, ...] | None = None
    seed: int = 0  #: Seed of everything random.
    truth: Annotated[Path | None, arg(metavar="FILE")] = None
    """JSON file of the true body, if it is known: the report then has the errors."""
    reactive: Reactive = False
    threads: Threads = None

    def execute(self) -> None:
        """Infer and print the report; nothing is written if an option is wrong."""
        log = read_log(self.log, column_map(self.columns), self.between or None, self.plan)
        moving = self.start == "moving"
        windows = log_windows(log, moving)
        check_groups(self.nuisances, windows.plan, windows)
        joint = FitConfig(noise=self.noise, nuisances=self.nuisances)
        truth = None if self.truth is None else read_morphology(self.truth, "truth", log.plan)
        streams(self.seed)  # raises for a wrong seed
        check_threads(self.threads)
        console = plain_console()
        for sentence in (*log.remarks, *windows.remarks):
            console.print(sentence)
        kind = "a body inferred from a recorded swim"
        with result_folder(self.out, kind, self._settings(log, joint, truth)) as folder:
            count = f"{len(log)} trial{'' if len(log) == 1 else 's'}"
            with waiting(f"fitting {count}, {sum(log.seconds):.3g} s of swimming") as doing:
                result = infer_log(
                    log, joint, self.seed, truth, moving=moving, check=True, progress=doing,
                    threads=self.threads, reactive=self.reactive,
                )  # fmt: skip
            lines = body_lines(result)
            if folder is not None:
                write_outcome(folder, result)
                draw_outcome(folder, result)
                lines += [*file_lines(folder, result), f"written to {folder}"]
            for line in [*lines, *end_lines(result)]:
                console.print(line)

    def _settings(self, log: SwimLog, joint: FitConfig, truth: Morphology | None) -> dict[str, Any]:
        digest = hashlib.sha256()
        for part in (log.time, log.gyro, log.commands, log.trial):
            digest.update(part.tobytes())
        return {
            **plan_key(log.plan),
            "log": digest.hexdigest()[:16],
            "start": self.start,
            **({"reactive": True} if self.reactive else {}),
            "joint": asdict(joint),
            "seed": self.seed,
            "truth": None if truth is None else truth.to_dict(),
        }
