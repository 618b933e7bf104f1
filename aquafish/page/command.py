"""The command ``aquafish page``: the fish in one HTML file, to break and to send to others."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

from tyro.conf import arg

from aquafish.page.document import write_live_page
from aquafish_gym.runs.command_line import GaitLibrary, Plan, Reactive
from aquafish_gym.utils.storage import output_file
from aquafish_gym.utils.validation import printable


@dataclass(frozen=True)
class Page:
    """Write a page in which the fish swims, to break its fins: one HTML file.

    It opens in a browser from the disk, and needs neither a server nor a network.
    """

    example: ClassVar[str] = "--html fish.html"

    html: Annotated[Path, arg(metavar="FILE")] = Path("fish.html")  #: The file.
    plan: Plan = "aquafish"
    library: GaitLibrary = None
    reactive: Reactive = False

    def execute(self) -> None:
        """Write the file."""
        path = output_file(self.html, "html")
        write_live_page(path, self.plan, self.library, self.reactive)
        size = f"{path.stat().st_size / 1e6:.2f} MB"
        print(printable(f"Page: {path} ({size}); open it in a browser"))
