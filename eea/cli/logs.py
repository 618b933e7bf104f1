"""The command ``aquafish logs``: what is in a recorder's log."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

from tyro.conf import Positional, arg

from aquafish_gym.plans import check_plan
from aquafish_gym.runs.command_line import Plan
from eea.cli.progress import plain_console
from eea.fish.swim_log import suggested_map
from eea.logs.summary import summary
from eea.logs.tables import read_recording


@dataclass(frozen=True)
class Logs:
    """Show what is in a log: CSV, Parquet, ArduPilot BIN, PX4 ULog or MCAP.

    A line for each stream has its rows, their rate and times, holes (of three usual steps or more),
    rows whose stamp is that of the row before (twice) or earlier (back), and the clock. Then come
    columns that may be a gyroscope or commands, with their guessed units, and the --map of infer.
    All formats but CSV need the extra logs.
    """

    example: ClassVar[str] = "examples/logs/swim.csv"

    file: Annotated[Positional[Path], arg(metavar="FILE")]  #: The log.
    #: Show the columns of this stream, with their units and ranges.
    stream: str | None = None
    plan: Plan = "aquafish"

    def execute(self) -> None:
        """Print the summary."""
        plan = check_plan(self.plan)
        recording = read_recording(self.file)
        console = plain_console()
        for line in summary(recording, self.stream):
            console.print(line)
        if self.stream is None:
            for command in suggested_map(recording, self.file, plan):
                console.print(f"next: {command}")
