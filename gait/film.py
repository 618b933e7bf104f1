"""The command ``film``: controllers as they swim, side by side from one start line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle, islice
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from tyro.conf import Positional, arg

from aquafish_gym.damage import Damage
from aquafish_gym.damage.words import parts_of
from aquafish_gym.engines.api import TIMESTEP, check_engine
from aquafish_gym.morphology import Morphology
from aquafish_gym.rendering.course import FilmedSwim
from aquafish_gym.rendering.films import film, film_suffix
from aquafish_gym.rendering.replay import write_replay
from aquafish_gym.rollout import Path as RolloutPath
from aquafish_gym.rollout import rollout
from aquafish_gym.runs.command_line import (
    FILMED_DAMAGE,
    Given,
    Reactive,
    TargetEngine,
    read_morphology,
)
from aquafish_gym.runs.progress import show_share
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.storage import output_file
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    instance,
    integer,
    printable,
    utf8_text,
)
from gait.controllers.controller import INTERVAL, Controller
from gait.swims.swim import SECONDS, Swim, sampling_steps, step_count

NO_DAMAGE = Damage()
SENSOR_FAULTS = ("gyro_noise", "sensor_bias", "sensor_stuck", "sensor_dropped")


@dataclass(frozen=True)
class Film(Given):
    """Film controllers as they swim, side by side from one start line in one fixed frame.

    With several controllers, bodies or damages there is a fish for each; a single one is for all
    fish. Broken fins are yellow with a black edge.
    """

    example: ClassVar[str] = (
        'out/evolve/controller.json --damage none "left_pectoral:length=0.5" --html swim.html'
    )
    main_options: ClassVar[tuple[str, ...]] = (
        "controllers", "out", "html", "morphology", "damage", "label", "title", "engine", "seconds",
        "seed",
    )  # fmt: skip

    controllers: Annotated[Positional[tuple[Path, ...]], arg(metavar="FILE")]
    """One controller.json or more, as evolve writes it."""
    out: Annotated[Path, arg(metavar="FILE")] = Path("film.webp")
    """The film: .webp, .gif, or .mp4, which needs the extra film."""
    html: Annotated[Path | None, arg(metavar="FILE")] = None
    """Write a replay instead of a film: one HTML file that opens in a browser."""
    morphology: Annotated[tuple[Path, ...], arg(metavar="FILE")] = ()
    """JSON files of bodies before their damage; by default each controller's own."""
    damage: Annotated[tuple[str, ...], FILMED_DAMAGE] = ("none",)
    label: tuple[str, ...] = ()
    """A name of each fish; by default its damage."""
    title: str = ""
    """Words at the top of the film."""
    seconds: float = SECONDS
    """Length of a swim."""
    engine: TargetEngine = "auto"
    reactive: Reactive = False
    seed: int = 0
    """Seed of random damage and of the noise of sensors."""
    width: int = 960
    """Width of the film in pixels."""
    height: int = 540
    """Height of the film in pixels."""
    fps: float = 20.0
    """Frames per second."""
    speed: float = 1.0
    """Speed of the film relative to the swim."""

    def execute(self) -> None:
        """Swim all fish and write the film."""
        if self.html:
            self.refuse_given(("out", "width", "height", "fps", "speed"), "with --html")
        out = output_file(self.html, "html") if self.html else output_file(self.out)
        if not self.html:
            film_suffix(out)
        swims = self._swims()
        if self.html:
            write_replay(swims, out, self.title or "AquaFish")
        else:
            with show_share("film", "frames") as show:
                film(
                    swims, out, self.width, self.height, self.fps, self.speed, self.title, show
                )  # fmt: skip
        print(printable(f"{'Replay' if self.html else 'Film'}: {out}"))

    def _swims(self) -> list[FilmedSwim]:
        """Return the swims of all fish, and print how far they come."""
        integer("seed", self.seed, 0)
        step_count(self.seconds)
        check_engine(self.engine)
        controllers = [Controller.load(path) for path in self.controllers]
        damages = [Damage.parse(text) for text in self.damage]
        fish = max(len(controllers), len(self.morphology), len(damages), len(self.label))
        given: dict[str, Sequence[Any]] = {
            "controllers": controllers,
            "morphology": self.morphology or [None],
            "damage": damages,
            "label": self.label or [""],
        }
        for name, values in given.items():
            if not values:
                raise InvalidArgumentError(f"{name} must have one value or more; got none")
            if len(values) not in (1, fish):
                raise InvalidArgumentError(f"{name} must be 1 or {fish} values; got {len(values)}")
        several = zip(*(islice(cycle(values), fish) for values in given.values()), strict=True)
        swims = [self._swim(i, *one) for i, one in enumerate(several)]
        for swim in swims:
            far = swim.position[-1, 1]
            print(printable(f"{swim.label}: {far:z.2f} units in {self.seconds:g} s"))
        return swims

    def _swim(
        self,
        number: int,
        controller: Controller,
        file: Path | None,
        damage: Damage,
        label: str,
    ) -> FilmedSwim:
        """Return the swim of a fish; without a body's file, of the controller's own.

        It begins in the zero pose, except for fins that are seized at an angle, or whose servos are
        dead: their angles are random.
        """
        body = controller.morphology
        if file is not None:
            body = read_morphology(file, "morphology", controller.plan)
        rng = np.random.default_rng([self.seed, number])
        damage = damage.sample(rng, parts_of(body.plan))
        whole = Scenario.create(body, reactive=self.reactive)
        robot = damage.edit(whole, controller.interval).draw_angles([rng])
        interval = sampling_steps(controller)
        if robot.is_late or robot.has(*SENSOR_FAULTS):  # which count the actions
            interval = controller.interval
        (path,) = rollout(
            [controller.policy(robot.fin_angles[0])],
            robot,
            engine=check_engine(self.engine),
            seconds=step_count(self.seconds) * TIMESTEP,
            interval=interval,
            rngs=[rng],
        ).paths
        words = label or ("undamaged" if not damage else str(damage))
        return filmed(words, path, body, damage, controller.interval)


def filmed(
    label: str,
    swim: Swim | RolloutPath,
    body: Morphology,
    damage: Damage = NO_DAMAGE,
    hold: int = INTERVAL,
) -> FilmedSwim:
    """Return a film of a recorded swim, of a body with its damage.

    A fin is broken if it has another size or its servo does not follow its command. ``hold`` is for
    how many steps of 0.01 s an action was held.
    """
    utf8_text("label", label)
    if not isinstance(swim, Swim | RolloutPath):
        raise InvalidArgumentError(f"swim must be a recorded swim; got {brief(swim)}")
    instance("body", body, Morphology)
    scenario = instance("damage", damage, Damage).edit(Scenario.create(body), hold)
    fins = len(body.plan.fins)
    bodies = np.empty((len(swim.time), len(body.sizes)))
    broken = np.empty((len(swim.time), fins), bool)
    steps = round(float(swim.time[-1]) / TIMESTEP) + 1
    for begin, _, _, to in scenario.segments(steps):
        now = scenario.beginning if to is None else to
        later = swim.time > (begin - 0.5) * TIMESTEP
        bodies[later] = now.body[0]
        sizes = (now.body[0] != body.to_array()).reshape(fins, 3).any(axis=1)
        late = (now.servo_delay[0] != 0.0) | (now.servo_hold[0] != 0.0)
        broken[later] = sizes | late | (now.servo_gain[0] != 1.0)
    return FilmedSwim(
        label,
        swim.time,
        bodies,
        broken,
        swim.position,
        swim.quaternion,
        swim.fin_angles,
        body.plan,
    )
