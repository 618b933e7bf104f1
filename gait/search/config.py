"""Settings of a gait's evolution."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias, get_args

from aquafish_gym.bodies import plan_key
from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.engines.packages import MAXIMUM_THREADS
from aquafish_gym.envs.specification import as_json
from aquafish_gym.envs.tasks import Task, check_task
from aquafish_gym.plans import PlanLike, check_plan
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    finite_array,
    flag,
    integer,
    one_of,
)
from gait.controllers.checks import MAXIMUM_HARMONICS
from gait.controllers.controller import INTERVAL, MAXIMUM_HELD_STEPS, MAXIMUM_SEED
from gait.controllers.network import Senses
from gait.search import cma, neat
from gait.search.ask_tell import generation_count, halving_stages
from gait.swims.scores import FORWARD
from gait.swims.swim import SECONDS, step_count

Sense = Literal["imu", "clock", "fins"]
TaskName = Literal["forward", "station", "waypoint", "recovery", "return"]
Class = Literal["recurrent", "mlp", "linear"]
if TYPE_CHECKING:
    TaskLike: TypeAlias = TaskName | Task
    AnyPlan: TypeAlias = PlanLike
else:
    TaskLike = TaskName  # the commands read the annotation, and take names alone
    AnyPlan = str
CMA_POPULATION = 24  # in NEAT's tuning, too
# Where they are not given: population, restarts, random_candidates, generations, cma_generations.
DEFAULTS = {
    "neat": (150, 6, 0, 12, 350),
    "cma": (CMA_POPULATION, 6, 1200, 740, 0),
    "paper": (150, 1, 0, 60, 0),
}


def make_senses(names: tuple[Sense, ...], task: TaskLike, harmonics: int = 1) -> Senses:
    """Return the inputs of a controller with these senses for a task."""
    clock = harmonics if "clock" in names else 0
    return Senses("imu" in names, clock, "fins" in names, check_task(task).has_goal)


def check_interval(value: object, seconds: float) -> None:
    """Refuse an interval that does not divide an episode of ``seconds``; offer the nearest."""
    steps = round(seconds / TIMESTEP)
    interval = integer("interval", value, 1)
    longest = min(steps // 2, MAXIMUM_HELD_STEPS)
    choices = [n for n in range(INTERVAL, longest + 1, INTERVAL) if not steps % n]
    if interval not in choices:
        if not choices:
            raise InvalidArgumentError(
                f"interval must be {INTERVAL} for episodes of {seconds:g} s: no other multiple of "
                f"{INTERVAL} divides {steps} steps into two or more; got {interval}"
            )
        nearest = min(choices, key=lambda n: abs(n - interval))
        raise InvalidArgumentError(
            f"interval must be a multiple of {INTERVAL} that divides {steps}, an "
            f"episode's steps; got {interval}; the nearest is {nearest}"
        )


def check_senses(senses: object) -> tuple[Sense, ...]:
    """Return senses as a tuple: one or more of the known ones."""
    names = get_args(Sense)
    if not isinstance(senses, list | tuple) or not senses:
        raise InvalidArgumentError(
            f"senses must be a list of some of {', '.join(names)}; got {brief(senses)}"
        )
    for sense in senses:
        one_of("senses", sense, names)
    return tuple(senses)


class Choices(NamedTuple):
    """The choices of a configuration, with the defaults of its search filled in."""

    search: Literal["cma", "neat"]
    controller: Class
    hidden: int
    harmonics: int
    clock: float  #: Hz.
    senses: Senses
    population: int
    restarts: int
    random_candidates: int
    generations: int
    cma_generations: int
    rows: int  #: Generations of all starts together, tuning and random candidates included.


@dataclass(frozen=True, kw_only=True)
class EvolveConfig:
    """Settings of a gait's evolution. None stands for the default of the search.

    Examples
    --------
    >>> EvolveConfig(generations=200, seed=3).choices.population
    24
    """

    seed: int = 0
    """Seed of everything random in the run."""
    search: Literal["cma", "neat"] | None = None
    """The search: CMA-ES, the default, which finds better gaits, or NEAT."""
    paper: bool = False
    """Search as the paper does: NEAT with one start and 60 generations, without CMA-ES."""
    controller: Class | None = None
    """Network that CMA-ES searches: recurrent (Elman's), the default, mlp, or linear. NEAT finds
    its own."""
    senses: tuple[Sense, ...] = ("imu", "clock")
    """What the controller observes, besides the direction to a goal if the task has one. Fin angles
    are not measured: they are integrated from the initial angles and the commands."""
    task: TaskLike = "forward"
    """Swim forward, or another task of the environments, which takes longer. In Python also a
    Task of aquafish_gym.envs.tasks, such as one of your own."""
    plan: AnyPlan = "aquafish"
    """The robot's body plan: its name, or a JSON file; in Python also a BodyPlan."""
    interval: int = INTERVAL
    """Steps of 0.01 s that an action is held."""
    hidden: int | None = None
    """Hidden nodes of an mlp or of CMA-ES's recurrent network; default 6."""
    harmonics: int | None = None
    """Harmonics of the clock; default 1."""
    restarts: int | None = None
    """Number of searches that start, of which the best goes on; default 6."""
    generations: int | None = None
    """Generations of each start of NEAT, default 12; or, over all its stages, of the start of
    CMA-ES that goes on to the end, default 740. The progress also counts the other starts."""
    random_candidates: int | None = None
    """Random networks from which CMA-ES chooses its starts; default 1200."""
    cma_generations: int | None = None
    """Generations of CMA-ES that tune the weights and the clock of NEAT's best network; default
    350."""
    population: int | None = None
    """Controllers in a generation; default 24 for CMA-ES, 150 for NEAT."""
    poses: int = 6
    """Random initial fin poses of each generation, besides one: NEAT's zero pose. In a sample of
    bodies, each pose has its own body. CMA-ES spreads the poses evenly. With 0 all swim from the
    zero pose."""
    clock: float | None = None
    """Frequency of the controllers' clock, in Hz; CMA-ES tunes it; default 0.7."""
    seconds: float = SECONDS
    """Length of a swim, in s."""
    threads: int | None = None
    """Threads; default all cores. No result depends on it."""

    def __post_init__(self) -> None:
        flag("paper", self.paper)
        for name, low, high in (
            ("seed", 0, MAXIMUM_SEED), ("hidden", 1, 100), ("harmonics", 1, MAXIMUM_HARMONICS),
            ("restarts", 1, 100), ("generations", 1, 100_000), ("random_candidates", 1, 100_000),
            ("cma_generations", 0, 100_000), ("population", 10, 10_000), ("poses", 0, 1000),
            ("threads", 1, MAXIMUM_THREADS),
        ):  # fmt: skip
            if getattr(self, name) is not None or name in ("seed", "poses"):
                integer(name, getattr(self, name), low, high)
        for name, choices in (("search", ("cma", "neat")), ("controller", get_args(Class))):
            if getattr(self, name) is not None:
                one_of(name, getattr(self, name), choices)
        object.__setattr__(self, "senses", check_senses(self.senses))
        plan = check_plan(self.plan)
        if self.plan != plan.name:  # of a file, which is read once
            object.__setattr__(self, "plan", plan)
        judged = check_task(self.task)
        if not isinstance(self.task, str):
            object.__setattr__(self, "task", judged)
        if self.clock is not None:
            finite_array("clock", self.clock, (), 0.0, 50.0, "Hz")
        step_count(self.seconds)
        if integer("interval", self.interval, 1) != INTERVAL:
            check_interval(self.interval, self.episode_seconds)
        steps = round(self.episode_seconds / TIMESTEP)
        if not self.is_forward and steps % self.interval:
            raise InvalidArgumentError(
                f"interval must divide {steps}, the steps of the task's "
                f"{self.episode_seconds:g} s; got {self.interval}"
            )
        self._refuse_what_has_no_effect()
        if 0 < self.choices.random_candidates < self.choices.restarts:
            raise InvalidArgumentError(
                f"random_candidates must be at least the {self.choices.restarts} restarts; "
                f"got {self.choices.random_candidates}"
            )

    def _refuse_what_has_no_effect(self) -> None:
        """Refuse settings of another search, another network or another task."""
        choices = self.choices
        for name, given, needed, there in (
            ("paper", self.paper, 'search="neat"', choices.search == "neat"),
            ("controller", self.controller is not None, 'search="cma"', choices.search == "cma"),
            ("random_candidates", self.random_candidates is not None, 'search="cma"',
             choices.search == "cma"),
            ("cma_generations", self.cma_generations is not None, 'search="neat"',
             choices.search == "neat"),
            ("hidden", self.hidden is not None, 'search="cma" and a controller with hidden nodes',
             choices.search == "cma" and choices.controller != "linear"),
            ("harmonics", self.harmonics is not None, 'a "clock" among the senses',
             "clock" in self.senses),
            ("clock", self.clock is not None, 'a "clock" among the senses', "clock" in self.senses),
            ("seconds", self.seconds != SECONDS, 'task="forward"', self.is_forward),
        ):  # fmt: skip
            if given and not there:
                raise InvalidArgumentError(
                    f"{name} has an effect only with {needed}; got {getattr(self, name)!r} with "
                    f'search="{choices.search}", controller="{choices.controller}", '
                    f"senses={self.senses}, task={brief(self.task)}"
                )

    @property
    def is_forward(self) -> bool:
        """Whether a score is the distance swum forward, not the return of a task's episode."""
        return isinstance(self.task, str) and self.task == FORWARD

    @property
    def episode_seconds(self) -> float:
        """Length of an episode, in s."""
        return self.seconds if self.is_forward else check_task(self.task).seconds

    @property
    def choices(self) -> Choices:
        """The choices, with defaults filled in.

        Examples
        --------
        >>> EvolveConfig(search="neat").choices.population
        150
        """
        search = self.search or ("neat" if self.paper else "cma")
        harmonics = 1 if self.harmonics is None else self.harmonics
        given = (
            self.population, self.restarts, self.random_candidates, self.generations,
            self.cma_generations,
        )  # fmt: skip
        defaults = DEFAULTS["paper" if self.paper else search]
        population, restarts, candidates, generations, tuning = (
            default if value is None else value
            for value, default in zip(given, defaults, strict=True)
        )
        if search == "neat":
            rows = restarts * generations
            rows += generation_count(halving_stages(restarts, tuning, neat.NEAT_STAGES))
        else:
            rows = len(cma.screenings(candidates, restarts, self.poses))
            rows += generation_count(halving_stages(restarts, generations, cma.STAGES))
        return Choices(
            search=search,
            controller=self.controller or "recurrent",
            hidden=6 if self.hidden is None else self.hidden,
            harmonics=harmonics,
            clock=0.7 if self.clock is None else self.clock,
            senses=make_senses(self.senses, self.task, harmonics),
            population=population,
            restarts=restarts,
            random_candidates=candidates,
            generations=generations,
            cma_generations=tuning,
            rows=rows,
        )

    @property
    def settings(self) -> dict[str, Any]:
        """All that a run depends on, ready for JSON, except the length of its last stage.

        A task that is no name is the name of its class and its attributes. InvalidArgumentError if
        it cannot be written so, as that of a class which no other program can import.
        """
        choices = {**self.choices._asdict(), "senses": asdict(self.choices.senses)}
        omitted = {"threads", "paper", "plan", "rows"}
        if self.choices.cma_generations:
            omitted.add("cma_generations")
        elif self.choices.search == "cma" or self.choices.restarts == 1:
            omitted.add("generations")
        settings = {one.name: getattr(self, one.name) for one in fields(self)} | choices
        if not isinstance(self.task, str):
            settings["task"] = as_json("task", self.task)
        kept = {name: value for name, value in settings.items() if name not in omitted}
        return kept | plan_key(check_plan(self.plan))
