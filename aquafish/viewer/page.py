"""The viewer's page in a browser: the scene, the controls, and what is read from them."""

from __future__ import annotations

import asyncio
import contextlib
import io
import math
import queue
import secrets
import sys
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np

from aquafish.online import SelfModelAgent, thresholds
from aquafish.viewer import live
from aquafish.viewer.door import as_code, checked_message, guarded, viser_module
from aquafish.viewer.live import BELIEF_SAMPLES, UPDATE_STEPS, LiveSwim, ViewerPilot
from aquafish.viewer.shapes import Shapes, robots_in
from aquafish.viewer.thoughts import words_about
from aquafish_gym.damage import Fault
from aquafish_gym.damage.words import FIN_WORDS, needs_number
from aquafish_gym.physics.layout import FIELDS, layout
from aquafish_gym.rendering import scene
from aquafish_gym.rendering.scene import CM_PER_UNIT, DrawnRobots
from aquafish_gym.scenario import MAXIMUM_CURRENT, TIMESTEP
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.utils.validation import InvalidArgumentError

MN_PER_UNIT = 6.25
MAXIMUM_REQUESTS = 20  # requests between two updates
LONGEST_REPORT = 300  # characters of an error's text
UPDATE_SECONDS = UPDATE_STEPS * TIMESTEP
# In rooms of the fish.
ROW_SPACING = 3.75  # between the start places of a batch along y
LANE_SPACING = 2.1  # the same along x
GHOST_DISTANCE = 1.5  # the ghost is drawn this far to the right of the fish
NAME_HEIGHT = 0.5  # of a name above the fish
TRACE_UPDATES = 200  # that the gyroscope's traces show
TRAIL_UPDATES = 400  # that a trail shows
TEXT_UPDATES = 4  # updates between those of text, traces and trails
ARROW_COLOUR = (230, 120, 0)
TRAIL_COLOUR = (0, 90, 140)
AXIS_COLOURS = (("x", "#d55e00"), ("y", "#009e73"), ("z", "#0072b2"))  # for the colour-blind
FAULT_WORDS = [word for word in FIN_WORDS if word != "thickness"]


class Viewer:
    """A page that shows a swim and changes it.

    Controls are attributes that hold viser's handles. All that they do is done by :meth:`update`.
    Once clients can enter, handles are set in viser's event loop alone: setting one wakes the tasks
    of all clients, which is safe in no other thread.

    Parameters
    ----------
    swim
        The robots. It begins with the first of the pilots.
    pilots
        What can steer them, by name.
    port
        Of the page at 127.0.0.1; the next free one is taken.
    """

    def __init__(self, swim: LiveSwim, pilots: Mapping[str, ViewerPilot], port: int = 8080) -> None:
        self.swim = swim
        self._pilots = dict(pilots)
        self._chosen = next(iter(pilots))
        self._viser = viser_module()
        self._todo: queue.Queue[Callable[[], None]] = queue.Queue(MAXIMUM_REQUESTS)
        self._updates, self._owed = 0, 0.0
        self._controls: dict[str, Any] = {}  # by the identifiers that the page sends
        self._clickable: dict[str, int] = {}
        self._reported: set[str] = set()  # tracebacks of what failed
        check = partial(checked_message, controls=self._controls, clickable=self._clickable)
        token = secrets.token_urlsafe(16)
        with contextlib.redirect_stdout(io.StringIO()), guarded(token, check):  # without a banner
            self.server = self._viser.ViserServer("127.0.0.1", port, "AquaFish", verbose=False)
        # A colon ends the port also for a program that splits the address at colons.
        self.url = f"http://127.0.0.1:{self.server.get_port()}/:{token}/"
        self._room = scene.fish_room(swim.plan)
        self._boxes = scene.drawn_parts(swim.plan)[1:]
        columns = math.ceil(math.sqrt(swim.count))
        number = np.arange(swim.count)
        self._starts = np.array(
            [
                (number % columns) * LANE_SPACING * self._room,
                -(number // columns) * ROW_SPACING * self._room,
                np.zeros(swim.count),
            ]
        )
        self._build_scene(columns)
        self._build_controls()
        self._clear()
        self.draw()

    def _build_scene(self, columns: int) -> None:
        api = self.server.scene
        api.set_up_direction("+z")
        rows = np.linspace(0, 1, 64)[:, None, None]
        water = scene.WATER_ABOVE + rows * np.subtract(scene.WATER_BELOW, scene.WATER_ABOVE)
        api.set_background_image(np.tile(water, (1, 4, 1)).astype(np.uint8), format="png")
        api.configure_environment_map(None)
        api.configure_default_lights(enabled=False)
        api.add_light_hemisphere(
            "/sky", sky_color=(255, 255, 255), ground_color=scene.SAND, intensity=1.6
        )
        api.add_light_directional(
            "/sun", position=(-6.0, -4.0, 14.0), intensity=1.9, cast_shadow=self.swim.count == 1
        )
        self.world = api.add_frame("/world", show_axes=False)
        self.floor = api.add_grid(
            "/world/floor", width=400.0, height=400.0, cell_size=scene.GRID_SPACING,
            section_size=scene.MAIN_GRID_SPACING, cell_color=scene.GRID, section_color=scene.GRID,
            plane_color=scene.SAND, plane_opacity=1.0, shadow_opacity=0.25,
            section_thickness=1.6, cell_thickness=0.6, fade_distance=120.0,
        )  # fmt: skip
        plan = self.swim.plan
        alike = robots_in(plan, self.swim.states[:, :1], self.swim.robots.body[:1])
        several, samples = (
            DrawnRobots(*(np.repeat(field, count, axis=0) for field in alike))
            for count in (self.swim.count, BELIEF_SAMPLES)
        )
        self.robots = Shapes(api, "/world/robots", several)
        self.robots.boxes.on_click(self._clicked)
        self._clickable[self.robots.boxes.name] = self.swim.count * len(self._boxes)
        self.ghost = Shapes(api, "/world/ghost", alike, scene.BELIEF, 0.5)
        self.samples = Shapes(api, "/world/samples", samples, scene.BELIEF, 0.12)
        self.ghost_name = api.add_label("/world/ghost/name", "self-model")
        self.name = api.add_label("/world/name", "", visible=self.swim.count > 1)
        nothing = np.zeros((4, 2, 3), np.float32)
        self.arrows = api.add_arrows(
            "/world/forces",
            nothing,
            ARROW_COLOUR,
            shaft_radius=0.04,
            head_radius=0.1,
            head_length=0.2,
        )
        self.trail = api.add_line_segments(
            "/world/trail", nothing, TRAIL_COLOUR, thickness=2.5, thickness_units="screen"
        )
        wide = LANE_SPACING * self._room * columns
        camera = self.server.initial_camera
        camera.position = (
            (-0.8 * wide, -1.7 * wide, 1.4 * wide)
            if columns == 1
            else (0.6 * wide, -1.5 * wide, 1.2 * wide)
        )
        camera.look_at = (0.12 * wide + 0.8 * self._room, 0.0, 0.0)
        camera.fov = math.radians(45)

    def _build_controls(self) -> None:
        gui = self.server.gui
        swim = self.swim
        series = self._viser.uplot.Series
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(0, 90, 140))
        self.reading = gui.add_markdown("")
        lines = [
            series(label="s"),
            *(series(label=n, stroke=c, width=1.5) for n, c in AXIS_COLOURS),
        ]
        self.traces = gui.add_uplot(
            tuple(np.zeros((4, 2))), tuple(lines), title="gyroscope, rad/s", aspect=1.9,
            scales={"x": {"time": False}}, legend={"live": False},
        )  # fmt: skip
        with gui.add_folder("Swim"):
            self.pilot = gui.add_dropdown("steered by", tuple(self._pilots))
            self.play = gui.add_checkbox("play", True)
            self.speed = gui.add_slider("speed", 0.25, 4.0, 0.25, 1.0)
            self.restart = gui.add_button("start again")
            self.number = gui.add_slider(
                "robot", 1, max(2, swim.count), 1, 1, visible=swim.count > 1
            )
        with gui.add_folder("Damage"):
            self.fin = gui.add_dropdown("fin", swim.plan.names)
            self.fault = gui.add_dropdown("fault", FAULT_WORDS)
            self.amount = gui.add_slider("number", 0.0, 1.0, 0.05, 0.5)
            self.everyone = gui.add_checkbox("all robots", False, visible=swim.count > 1)
            self.break_it = gui.add_button("break it", color="red", hint="Or click a fin.")
            self.text = gui.add_text("in words", "random:severe")
            self.break_text = gui.add_button("break by words")
            self.repair = gui.add_button("repair")
            self.damage = gui.add_markdown("")
        with gui.add_folder("Fin sizes before damage, cm", expand_by_default=False):
            self.sizes = [
                gui.add_slider(
                    f"{swim.plan.words[d.fin]} {d.size}",
                    0.0, CM_PER_UNIT * d.maximum, 0.05, CM_PER_UNIT * d.nominal,
                ) for d in swim.plan.dimensions
            ]  # fmt: skip
        with gui.add_folder("Current, cm/s", expand_by_default=False):
            most = CM_PER_UNIT * MAXIMUM_CURRENT / 5
            names = ("to the right", "forward", "up")
            self.current = [gui.add_slider(name, -most, most, 0.5, 0.0) for name in names]
        with gui.add_folder("Show"):
            self.follow = gui.add_checkbox("follow", True)
            self.show_forces = gui.add_checkbox("forces of the water", True)
            self.show_trail = gui.add_checkbox("trail", True)
            self.show_ghost = gui.add_checkbox("self-model", True)
        with gui.add_folder("Self-model"):
            self.thoughts = gui.add_markdown("")
        for button, do in (
            (self.restart, self._restart),
            (self.break_it, self.strike),
            (self.break_text, lambda: self.strike(self.text.value)),
            (self.repair, lambda: self.swim.repair(self._targets())),
        ):
            button.on_click(lambda _, do=do: self._ask(do))
        inputs = (
            *(self.pilot, self.play, self.speed, self.restart, self.number, self.fin, self.fault),
            *(self.amount, self.everyone, self.break_it, self.text, self.break_text, self.repair),
            *(*self.sizes, *self.current, self.follow, self.show_forces, self.show_trail),
            self.show_ghost,
        )
        self._controls |= {handle._impl.uuid: handle for handle in inputs}

    @property
    def agent(self) -> SelfModelAgent | None:
        """The agent with a self-model that steers the robot, if it does."""
        agent = self.swim.pilot.agent
        return agent if isinstance(agent, SelfModelAgent) else None

    @property
    def calibrates_for(self) -> float:
        """How long the self-model still measures its error, in which nothing may break, s."""
        agent = self.agent
        return (
            0.0
            if agent is None
            else max(0.0, thresholds.CALIBRATION_ACTIONS * agent.dt - self.swim.seconds)
        )

    def _targets(self) -> list[int] | None:
        return None if self.everyone.value else [self.number.value - 1]

    def _chosen_fault(self) -> Fault:
        needed = needs_number(FIN_WORDS[self.fault.value])
        number = self.amount.value if needed else None
        return Fault(self.fin.value, self.fault.value, number)

    def _clicked(self, event: Any) -> None:
        """Strike the fin that was clicked with the chosen fault."""
        robot, box = divmod(event.instance_index, len(self._boxes))
        fin = self._boxes[box].removesuffix("_break")

        def strike() -> None:
            self._on_page(self._choose, robot, fin)
            self.strike()

        if fin in self.swim.plan.names:
            self._ask(strike)

    def _choose(self, robot: int, fin: str) -> None:
        self.number.value = robot + 1
        self.fin.value = fin

    def _on_page(self, do: Callable[..., Any], *arguments: Any) -> Any:
        """Return what a function that sets handles returns in viser's event loop."""

        async def called() -> Any:
            return do(*arguments)

        return asyncio.run_coroutine_threadsafe(called(), self.server.get_event_loop()).result()

    @contextlib.contextmanager
    def _going_on(self) -> Iterator[None]:
        """Report an error, once on the terminal, and on the page; then go on."""
        try:
            yield
        except Exception as error:
            with contextlib.suppress(Exception):  # of a terminal or a page that is gone
                self._report(error)

    def _report(self, error: Exception) -> None:
        text = f"{type(error).__name__}: {error}"[:LONGEST_REPORT]
        way = "".join(traceback.format_tb(error.__traceback__))
        if way not in self._reported:
            self._reported.add(way)
            place = traceback.extract_tb(error.__traceback__)[-1]
            said = f"{text} ({place.filename}:{place.lineno}); the viewer goes on"
            plain = "".join(c if c.isprintable() else " " for c in said)
            print(plain, file=sys.stderr, flush=True)
        self._problem = f"\n\n{as_code(text)}"
        self._on_page(self._write_damage, self.number.value - 1)

    def _ask(self, do: Callable[[], None]) -> None:
        """Let the next update do something, unless it has more to do than a user can ask."""
        with contextlib.suppress(queue.Full):
            self._todo.put_nowait(do)

    def strike(self, damage: str | None = None) -> None:
        """Break the chosen robot, or all, in mid-swim; what is wrong is shown on the page.

        None is the chosen fault.
        """
        self._problem = ""
        try:
            if (left := self.calibrates_for) > 0:
                raise InvalidArgumentError(
                    f"the self-model measures its own error: break it in {math.ceil(left)} s"
                )
            wanted = str(self._chosen_fault()) if damage is None else damage
            self.swim.strike(wanted, self._targets())
        except InvalidArgumentError as error:
            self._problem = f"\n\n{as_code(error)}"

    def _restart(self) -> None:
        self.swim.reset(self._pilots[self._chosen])
        self._clear()

    def _clear(self) -> None:
        self._problem = ""
        self._past: deque[Floats] = deque(maxlen=max(TRACE_UPDATES, TRAIL_UPDATES))

    def update(self) -> None:
        """Do what the controls ask, swim on, and draw."""
        if self.pilot.value != self._chosen:
            self._chosen = self.pilot.value
            self._restart()
        while not self._todo.empty():
            with self._going_on():
                self._todo.get()()
        self.swim.set_sizes([slider.value / CM_PER_UNIT for slider in self.sizes])
        self.swim.set_current([slider.value / CM_PER_UNIT for slider in self.current])
        self.swim.advance(0)
        if self.play.value:
            self._owed += self.speed.value
            updates = int(self._owed)
            self._owed -= updates
            for _ in range(updates):
                before = self.swim.steps
                self.swim.advance()
                if self.swim.steps < before:  # it diverged
                    self._clear()
                self._past.append(np.concatenate([self._places().T, self.swim.observed[:, 6:9]], 1))
        self.draw()
        self._updates += 1

    def _places(self) -> Floats:
        """Return where robots are drawn, (3, B)."""
        places: Floats = self.swim.states[FIELDS["position"]] + self._starts
        return places

    def draw(self) -> None:
        """Send what has changed to the page."""
        self._on_page(self._draw)

    def _draw(self) -> None:
        swim, me = self.swim, self.number.value - 1
        states = swim.states.copy()
        states[FIELDS["position"]] = places = self._places()
        with self.server.atomic():
            names = swim.plan.names
            broken = [[fin in swim.broken(i) for fin in names] for i in range(swim.count)]
            robots = robots_in(swim.plan, states, swim.robots.body, broken)
            self.robots.show(robots)
            self.world.position = -places.mean(axis=1) if self.follow.value else np.zeros(3)
            self.floor.position = (0.0, 0.0, scene.floor_below(places.T, self._room))
            self.arrows.visible, self.trail.visible = self.show_forces.value, self.show_trail.value
            if self.show_forces.value:
                # Of the fins, then the body; an arrow of no length has no direction.
                tails = robots.poses[me, np.r_[scene.fin_parts(swim.plan), 0], :3]
                heads = tails + live.part_forces(swim.robots.take(me), states[:, me]) + 1e-3
                self.arrows.points = np.stack([tails, heads], axis=1).astype(np.float32)
            self._draw_ghost()
            self.name.text = f"robot {me + 1}"
            self.name.position = places[:, me] + (0, 0, NAME_HEIGHT * self._room)
            if self._updates % TEXT_UPDATES == 0:
                self._draw_past(me)
                self._write(me)
        self.server.flush()

    def _draw_ghost(self) -> None:
        agent = self.agent if self.show_ghost.value else None
        for shapes in (self.ghost, self.samples):
            shapes.capsules.visible = shapes.boxes.visible = agent is not None
        self.ghost_name.visible = agent is not None
        if agent is not None:
            bodies, states = live.imagine_ghost(agent, self.swim.actions, self.swim.held)
            states[FIELDS["position"]] += np.array([[GHOST_DISTANCE * self._room], [0], [0]])
            plan = self.swim.plan
            self.ghost.show(robots_in(plan, states[:, :1], bodies[:1]))
            self.samples.show(robots_in(plan, states[:, 1:], bodies[1:]))
            above = (0, 0, NAME_HEIGHT * self._room)
            self.ghost_name.position = states[FIELDS["position"], 0] + above

    def _draw_past(self, me: int) -> None:
        """Draw trails and the gyroscope's traces."""
        if len(self._past) < 2:
            return
        past = np.array(self._past)
        gyro = past[-TRACE_UPDATES:, me, 3:]
        seconds = self.swim.seconds + UPDATE_SECONDS * np.arange(1 - len(gyro), 1)
        self.traces.data = (seconds, *gyro.T.astype(float))
        knots = past[-TRAIL_UPDATES :: 1 + 8 * (self.swim.count > 1), :, :3]
        pairs = np.stack([knots[:-1], knots[1:]], axis=2).reshape(-1, 2, 3)
        if len(pairs):
            self.trail.points = pairs.astype(np.float32)

    def _write(self, me: int) -> None:
        """Write the readings, the damage, and what the self-model is."""
        swim, state = self.swim, self.swim.states[:, me]
        far = CM_PER_UNIT * state[FIELDS["position"]][1]
        fins = ", ".join(
            f"{fin.word} {angle:z.0f}°" if fin.turns else f"{fin.word} {angle:+z.0f}°"
            for fin, angle in zip(swim.plan.fins, np.degrees(self._hinges(state)), strict=True)
        )
        push = MN_PER_UNIT * live.part_forces(swim.robots.take(me), state)[:, 1].sum()
        self.reading.content = (
            f"**{far:+z.0f} cm** forward after **{swim.seconds:.1f} s**\n\n"
            f"{fins}\n\n"
            f"the water pushes forward by {push:+z.1f} mN"
        )
        for button in (self.break_it, self.break_text):
            button.disabled = self.calibrates_for > 0
        self._write_damage(me)
        self.thoughts.content = words_about(self.agent, self.calibrates_for)

    def _hinges(self, state: Floats) -> list[float]:
        """Return the angles of the fins at their hinges in a state (R,), rad."""
        angles = layout(self.swim.plan).angles(state).tolist()
        return [
            angle if fin.turns else fin.sweep * math.sin(angle)
            for fin, angle in zip(self.swim.plan.fins, angles, strict=True)
        ]

    def _write_damage(self, me: int) -> None:
        waits = ""
        if self.calibrates_for > 0:
            waits = f"\n\nIn {math.ceil(self.calibrates_for)} s: the self-model measures its error."
        damage = as_code(self.swim.damage_now(me))
        self.damage.content = f"broken: {damage}{waits}{self._problem}"

    def run(self) -> None:
        """Print the address, update 20 times a second until Ctrl-C, then stop the server.

        An update that fails is reported, and the next one follows; if the first fails, so does all.
        """
        due = time.monotonic()
        try:
            self.update()  # a policy that returns no action is refused before the page is opened
            print(f"{self.url}  (Ctrl-C ends it)", flush=True)
            while True:
                with self._going_on():
                    self.update()
                now = time.monotonic()
                due = max(due + UPDATE_SECONDS, now)
                time.sleep(due - now)
        except KeyboardInterrupt:
            pass
        finally:
            self.close()

    def close(self) -> None:
        """Stop the server."""
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()
