"""The command ``aquafish watch``: detect a change of the body in a recorded swim."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

from tyro.conf import arg

from aquafish_gym.runs.command_line import OptionalOut, Threads, check_threads
from aquafish_gym.runs.manifest import result_folder
from aquafish_gym.utils.storage import write_document
from aquafish_gym.utils.validation import printable
from eea.cli.log_options import Between, ColumnMap, LogFile, column_map
from eea.cli.progress import waiting
from eea.core.session import streams
from eea.fish import load_posterior, read_log, watch_swim
from eea.fish.hypotheses import is_reactive, plan_of
from eea.fish.swim_log import SwimLog
from eea.infer.known import check_alarm

WATCHED_FILE = "watched.json"
WATCHED_PICTURE = "watched.png"
WATCHED_SCHEMA = "eea.watched/1"


@dataclass(frozen=True)
class Watch:
    """Detect when a recorded swim no longer fits the inferred body.

    The log has the format of infer, for any swimming. Each second is fitted with the posterior as
    the prior. If the fit is bad, the body has changed; infer on the rest of the record finds the
    new body. --out receives settings.json, watched.json and watched.png.
    """

    example: ClassVar[str] = "--log examples/logs/later.csv --posterior out/swim/posterior.npz"

    log: LogFile
    posterior: Annotated[Path, arg(metavar="FILE", help="posterior.npz of infer or run.")]
    columns: ColumnMap = ()
    between: Between = ()
    alarm: float = 1e-6  #: Probability of a false alarm in each second.
    out: OptionalOut = None
    seed: int = 0  #: Seed of everything random.
    threads: Threads = None

    def execute(self) -> None:
        """Watch the swim and print the result."""
        belief = load_posterior(self.posterior)
        plan = plan_of(belief.robot)
        log = read_log(self.log, column_map(self.columns), self.between or None, plan)
        for sentence in log.remarks:
            print(sentence)
        check_alarm(self.alarm)
        streams(self.seed)  # raises for a wrong seed
        check_threads(self.threads)
        settings = {
            "log": _digest(self.log),
            "posterior": _digest(self.posterior),
            "alarm": self.alarm,
            "seed": self.seed,
        }
        if self.columns:
            settings["map"] = column_map(self.columns)
        if self.between:
            settings["between"] = self.between
        with result_folder(
            self.out, "a swim that was watched", settings, (WATCHED_FILE, WATCHED_PICTURE)
        ) as folder:
            self._watch(log, belief, folder)

    def _watch(self, log: SwimLog, belief: Any, folder: Path | None) -> None:
        with waiting(f"watching {sum(log.seconds):.3g} s of swimming") as doing:
            found = watch_swim(
                log, belief, alarm=self.alarm, seed=self.seed, threads=self.threads,
                reactive=is_reactive(belief.robot),
                progress=lambda done, total: doing(f"window {done} of {total}"),
            )  # fmt: skip
        print(found)
        if folder is not None:
            from aquafish_gym.rendering.pictures import save_figure
            from eea.fish.plots import watched_figure

            windows = [
                {"until": float(end), **look._asdict()}
                for end, look in zip(found.time, found.looks, strict=True)
            ]
            document = {"alarm": found.alarm, "noticed": found.noticed, "windows": windows}
            write_document(folder / WATCHED_FILE, document, WATCHED_SCHEMA)
            save_figure(watched_figure(found), folder / WATCHED_PICTURE)
            print(printable(f"written to {folder}"))


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()[:16]
