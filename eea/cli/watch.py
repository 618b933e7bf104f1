"""The command ``python -m eea watch``: is a recorded swim still that of the body inferred?"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from tyro.conf import arg

from aquafish_gym.command_line import Threads
from aquafish_gym.runs.storage import ensure_writable_directory, write_document
from eea.fish import load_posterior, read_log, watch_swim

WATCHED, PICTURE, SCHEMA = "watched.json", "watched.png", "eea.watched/1"


@dataclass(frozen=True)
class Watch:
    """Is a recorded swim, second by second, still that of the body that was inferred?

    The log is as for infer, of any swimming; each second is explained anew by the body believed
    in. Where that fails the body has changed, and infer on what follows says into what.
    """

    log: Annotated[Path, arg(metavar="FILE", help="The recorded swim: a .csv or a .npz.")]
    posterior: Annotated[
        Path, arg(metavar="FILE", help="What is believed: posterior.npz of infer or run.")
    ]
    alarm: float = 1e-6  #: The chance of a false alarm in each second.
    out: Annotated[
        Path | None,
        arg(metavar="DIR", help="Directory for watched.json and watched.png, if they are wanted."),
    ] = None
    seed: int = 0  #: Of the starting points that are tried.
    threads: Threads = None

    def execute(self) -> None:
        """Watch, and say what was seen."""
        log, belief = read_log(self.log), load_posterior(self.posterior)
        if self.out is not None:
            ensure_writable_directory(self.out)
        words, console = TextColumn("{task.description}"), Console(stderr=True)
        with Progress(words, BarColumn(), MofNCompleteColumn(), console=console) as progress:
            task = progress.add_task("seconds of swimming", total=None)
            found = watch_swim(
                log, belief, alarm=self.alarm, seed=self.seed, threads=self.threads,
                progress=lambda done, total: progress.update(task, completed=done, total=total),
            )  # fmt: skip
        print(found)
        if self.out is not None:
            from aquafish_gym.rendering.pictures import save_figure

            seen = [
                {"until": float(end), **look._asdict()}
                for end, look in zip(found.time, found.looks, strict=True)
            ]
            document = {"alarm": found.alarm, "noticed": found.noticed, "windows": seen}
            write_document(self.out / WATCHED, document, SCHEMA)
            save_figure(found.plot(), self.out / PICTURE)
            print(f"written to {self.out}")
