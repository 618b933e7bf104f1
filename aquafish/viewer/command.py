"""The command ``aquafish view``: watch robots swim, and break them in mid-swim."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from pkgutil import resolve_name
from typing import Annotated, ClassVar

from tyro.conf import arg

from aquafish.online.gaits import PACKAGED, gaits_of
from aquafish.viewer.door import viser_module
from aquafish.viewer.live import (
    MAXIMUM_VIEWED_ROBOTS,
    LiveSwim,
    ViewerPilot,
    gait_pilot,
    pilot_of,
    random_pilot,
    self_model_pilot,
)
from aquafish.viewer.page import Viewer
from aquafish_gym.plans import check_plan, check_same_plan
from aquafish_gym.runs.command_line import EpisodeDamage, GaitLibrary, Plan, Reactive
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.validation import InvalidArgumentError, integer
from gait.controllers.controller import Controller


@dataclass(frozen=True)
class View:
    """Watch robots swim in a browser, and break them in mid-swim. Needs the extra view.

    The page is served at 127.0.0.1 alone, until Ctrl-C, to those who open the printed address with
    its token. A gait, random actions, a policy or, of one robot, the agent with a self-model
    steers.
    """

    example: ClassVar[str] = "--robots 3 --damage left_pectoral:length=0.5@5"

    robots: int = 1  #: Number of robots, at most 64.
    plan: Plan = "aquafish"
    reactive: Reactive = False
    library: GaitLibrary = None
    controller: Annotated[Path | None, arg(metavar="FILE")] = None
    """A controller.json, as evolve and baseline write it; without it, a gait of the library."""
    policy: Annotated[str | None, arg(metavar="MODULE:FUNCTION")] = None
    """Your controller: a function from observation and time to an action, or what else
    ``gait.swim`` takes, such as an agent or a model of stable-baselines3."""
    damage: EpisodeDamage = "none"
    gyro_noise: float = 0.0  #: Standard deviation of the gyroscope's noise, rad/s.
    gyro_only: bool = False
    """Whether the agent with a self-model steers at first, and uses the gyroscope alone."""
    port: int = 8080  #: Port of the page; the next free one is taken.
    seed: int = 0  #: Seed of everything random.

    def __post_init__(self) -> None:
        if self.gyro_only and self.robots != 1:
            raise InvalidArgumentError(
                f"gyro_only must be false with {self.robots} robots: it is of the self-model, "
                "which steers one robot"
            )
        integer("robots", self.robots, 1, MAXIMUM_VIEWED_ROBOTS)
        integer("port", self.port, 1, 65535)

    def pilots(self) -> dict[str, ViewerPilot]:
        """Return what can steer, by name."""
        found: dict[str, ViewerPilot] = {}
        if self.policy is not None:
            try:
                policy = resolve_name(self.policy)
            except (ImportError, AttributeError, ValueError) as error:
                raise InvalidArgumentError(f"policy must be MODULE:FUNCTION; {error}") from None
            found["policy"] = pilot_of(policy)
        plan = check_plan(self.plan)
        library = gaits_of(plan, self.library)
        gait = Controller.load(self.controller) if self.controller else library[0]
        check_same_plan("controller", gait.plan, plan)
        found["gait"] = gait_pilot(gait)
        found["random"] = random_pilot(self.seed, plan)
        if self.robots == 1:
            robot = Scenario.create(plan=plan, reactive=self.reactive)
            packaged = self.library is None and plan in PACKAGED
            own = None if packaged else library  # teachers stand beside the packaged one
            found["self-model"] = self_model_pilot(
                self.gyro_noise, self.gyro_only, self.seed, robot, own
            )
        if self.gyro_only:  # the first one steers
            return {"self-model": found.pop("self-model"), **found}
        return found

    def execute(self) -> None:
        """Serve the page until Ctrl-C."""
        viser_module()
        pilots = self.pilots()
        first = next(iter(pilots.values()))
        swim = LiveSwim(
            first, self.robots, self.damage, self.gyro_noise, self.seed, self.plan, self.reactive
        )
        Viewer(swim, pilots, self.port).run()
