"""The command ``aquafish watch``: detect a change of the body in a recorded swim."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from aquafish_gym.command_line import Threads
from aquafish_gym.runs.storage import ensure_writable_directory, write_document
from eea.cli.progress import waiting
from eea.fish import load_posterior, read_log, watch_swim

WATCHED, PICTURE, SCHEMA = "watched.json", "watched.png", "eea.watched/1"


@dataclass(frozen=True)
class Watch:
    """Detect when a recorded swim is no longer that of the inferred body.

    The log is as for infer, of any swimming. Each second is fitted with the posterior as the prior;
    if the fit is bad, the body has changed, and infer on the rest of the record finds the new one.
    """

    log: Annotated[Path, arg(metavar="FILE", help="The recorded swim, a CSV.")]
    posterior: Annotated[Path, arg(metavar="FILE", help="posterior.npz of infer or run.")]
    alarm: float = 1e-6  #: Probability of a false alarm in each second.
    out: Annotated[
        Path | None,
        arg(metavar="DIR", help="Directory for watched.json and watched.png, if they are wanted."),
    ] = None
    seed: int = 0  #: Seed of everything random.
    threads: Threads = None

    def execute(self) -> None:
        """Watch the swim and print what was detected."""
        log, belief = read_log(self.log), load_posterior(self.posterior)
        if self.out is not None:
            ensure_writable_directory(self.out)
        with waiting(f"watching {sum(log.seconds):.3g} s of swimming") as doing:
            found = watch_swim(
                log, belief, alarm=self.alarm, seed=self.seed, threads=self.threads,
                progress=lambda done, total: doing(f"window {done} of {total}"),
            )  # fmt: skip
        print(found)
        if self.out is not None:
            from aquafish_gym.rendering.pictures import save_figure
            from eea.fish.plots import watched_figure

            windows = [
                {"until": float(end), **look._asdict()}
                for end, look in zip(found.time, found.looks, strict=True)
            ]
            document = {"alarm": found.alarm, "noticed": found.noticed, "windows": windows}
            write_document(self.out / WATCHED, document, SCHEMA)
            save_figure(watched_figure(found), self.out / PICTURE)
            print(f"written to {self.out}")
