"""What is inferred of real robots, from logs that the user has downloaded.

    python -m experiments.real fish|drones|auv --data DIR --out OUT

DIR is the download. OUT gets the figures (fish.json, drones.json or auv.json) and a picture.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

from rich.console import Console
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

    @abstractmethod
    def table(self) -> dict[str, Any]:
        """Return the figures."""

    @abstractmethod
    def text(self, table: Mapping[str, Any]) -> str:
        """Return the figures in words."""

    @abstractmethod
    def draw(self, table: Mapping[str, Any], path: Path) -> None:
        """Draw the figures."""

    def execute(self) -> None:
        """Evaluate, print and write."""
        ensure_writable_directory(self.out)
        with Console(stderr=True).status(f"reading and judging {self.data}"):
            table = self.table()
        print(self.text(table), end="")
        document = self.out / f"{self.name}.json"
        picture = self.out / f"{self.name}.png"
        write_document(document, table, SCHEMA)
        self.draw(table, picture)
        print(f"Figures: {document}. Picture: {picture}.")


class RealFish(RealRobot):
    """The robotic fish of Michigan State: predict swims of commands that it was never seen under.

    DIR is github.com/giorgosmamakoukas/dataDrivenControlOfRoboticFish.
    """

    name = "fish"

    def table(self) -> dict[str, Any]:
        """See ``fish_table``."""
        from experiments.real.fish import fish_table

        return fish_table(self.data)

    def text(self, table: Mapping[str, Any]) -> str:
        """See ``fish_text``."""
        from experiments.real.fish_report import fish_text

        return fish_text(table)

    def draw(self, table: Mapping[str, Any], path: Path) -> None:
        """See ``draw_fish``."""
        from experiments.real.fish_report import draw_fish

        draw_fish(table, path)


class RealDrones(RealRobot):
    """Two drones with cut propellers: what was lost since a log that is known.

    DIR is github.com/AerialRoboticsUUST/CrazyPAD.
    """

    name = "drones"

    def table(self) -> dict[str, Any]:
        """See ``drones_table``."""
        from experiments.real.drones import drones_table

        return drones_table(self.data)

    def text(self, table: Mapping[str, Any]) -> str:
        """See ``drones_text``."""
        from experiments.real.drones_report import drones_text

        return drones_text(table)

    def draw(self, table: Mapping[str, Any], path: Path) -> None:
        """See ``draw_drones``."""
        from experiments.real.drones_report import draw_drones

        draw_drones(table["found"], path)


class RealAuv(RealRobot):
    """An AUV with four faults: what changed since fifty healthy swims.

    DIR is github.com/sunyrain/MLTask (Mendeley 7rp2pmr6mx).
    """

    name = "auv"

    def table(self) -> dict[str, Any]:
        """See ``auv_table``."""
        from experiments.real.auv import auv_table

        return auv_table(self.data)

    def text(self, table: Mapping[str, Any]) -> str:
        """See ``auv_text``."""
        from experiments.real.auv_report import auv_text

        return auv_text(table)

    def draw(self, table: Mapping[str, Any], path: Path) -> None:
        """See ``draw_auv``."""
        from experiments.real.auv_report import draw_auv

        draw_auv(table, path)


COMMANDS: Commands = {
    "fish": (
        "experiments.real.command:RealFish",
        "predict a real fish under commands that it was never seen under",
    ),
    "drones": ("experiments.real.command:RealDrones", "find what real drones' propellers lost"),
    "auv": ("experiments.real.command:RealAuv", "name what changed in a real AUV"),
}
