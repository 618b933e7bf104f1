"""What is inferred of real robots, from logs that the user has downloaded.

    python -m experiments.real fish|drones|auv --data DIR --out OUT

DIR is the download. OUT gets the figures (fish.json, drones.json or auv.json) and a picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from pkgutil import resolve_name
from typing import Annotated, Any, ClassVar

from tyro.conf import arg

from aquafish_gym.runs.command_line import Commands, Out
from aquafish_gym.utils.storage import ensure_writable_directory, write_document

SCHEMA = "aquafish.real/1"


@dataclass(frozen=True)
class RealRobot:
    """Evaluate what is inferred of a real robot from its own logs."""

    name: ClassVar[str]
    example: ClassVar[str] = "--data download --out out/real"
    main_options: ClassVar[tuple[str, ...]] = ("data", "out")

    data: Annotated[Path, arg(metavar="DIR")]
    """Folder of the downloaded logs."""
    out: Out
    """Folder for the figures and the picture."""

    def execute(self) -> None:
        """Evaluate, print and write."""
        ensure_writable_directory(self.out)
        of = f"experiments.real.{self.name}"  # loaded here: the evaluations load a lot
        table: dict[str, Any] = resolve_name(f"{of}:{self.name}_table")(self.data)
        print(resolve_name(f"{of}_report:{self.name}_text")(table), end="")
        document = self.out / f"{self.name}.json"
        picture = self.out / f"{self.name}.png"
        write_document(document, table, SCHEMA)
        resolve_name(f"{of}_report:draw_{self.name}")(table, picture)
        print(f"Figures: {document}. Picture: {picture}.")


class RealFish(RealRobot):
    """The robotic fish of Michigan State: predict swims of commands that it was never seen under.

    DIR is github.com/giorgosmamakoukas/dataDrivenControlOfRoboticFish.
    """

    name = "fish"


class RealDrones(RealRobot):
    """Two drones with cut propellers: what was lost since a log that is known.

    DIR is github.com/AerialRoboticsUUST/CrazyPAD.
    """

    name = "drones"


class RealAuv(RealRobot):
    """An AUV with four faults: what changed since fifty healthy swims.

    DIR is github.com/sunyrain/MLTask (Mendeley 7rp2pmr6mx).
    """

    name = "auv"


COMMANDS: Commands = {
    "fish": (
        "experiments.real.command:RealFish",
        "predict a real fish under commands that it was never seen under",
    ),
    "drones": ("experiments.real.command:RealDrones", "find what real drones' propellers lost"),
    "auv": ("experiments.real.command:RealAuv", "name what changed in a real AUV"),
}
