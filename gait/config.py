"""Settings of a gait's evolution."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any, Literal, NamedTuple, get_args

from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.envs.tasks import TASKS
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    finite_array,
    integer,
    one_of,
)
from gait.controller import INTERVAL, MAXIMUM_HARMONICS, MAXIMUM_SEED
from gait.network import Senses
from gait.rollout import MAXIMUM_THREADS, SECONDS, step_count
from gait.search import cma, neat
from gait.search.ask_tell import generation_count, halving_stages

Sense = Literal["imu", "clock", "fins"]
TaskName = Literal["forward", "station", "waypoint", "recovery"]
Class = Literal["recurrent", "mlp", "linear"]
CMA_POPULATION = 24  # in NEAT's tuning, too
# Where they are not given: population, restarts, random_candidates, generations, cma_generations.
DEFAULTS = {
    "neat": (150, 6, 0, 12, 350),
    "cma": (CMA_POPULATION, 6, 1200, 750, 0),
    "paper": (150, 1, 0, 60, 0),
}


def make_senses(names: tuple[Sense, ...], task: TaskName, harmonics: int = 1) -> Senses:
    """Return the inputs of a controller with these senses for a task."""
    clock = harmonics if "clock" in names else 0
    return Senses("imu" in names, clock, "fins" in names, TASKS[task].has_goal)


def check_interval(value: object, seconds: float) -> None:
    """Refuse an interval that does not divide an episode of ``seconds``; offer the nearest."""
    steps = round(seconds / TIMESTEP)
    interval = integer("interval", value, 1)
    choices = [n for n in range(INTERVAL, steps // 2 + 1, INTERVAL) if not steps % n]
    if interval not in choices:
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


class Plan(NamedTuple):
    """The choices of a configuration, with the defaults of its search filled in."""

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
    >>> EvolveConfig(generations=200, seed=3).plan.population
    24
    """

    seed: int = 0
    """Seed of everything random in the run."""
    search: Literal["cma", "neat"] = "cma"
    """The search: CMA-ES, which finds better gaits, or NEAT."""
    paper: bool = False
    """Search as the paper does: NEAT with one start and 60 generations, without CMA-ES."""
    controller: Class = "recurrent"
    """Network that CMA-ES searches: recurrent (Elman's), mlp, or linear. NEAT finds its own."""
    senses: tuple[Sense, ...] = ("imu", "clock")
    """What the controller observes, besides the direction to a goal if the task has one. Fin angles
    are not measured: they are integrated from the initial angles and the commands."""
    task: TaskName = "forward"
    """Swim forward, or another task of the environments, which takes longer."""
    interval: int = INTERVAL
    """Steps of 0.01 s that an action is held."""
    hidden: int = 6
    """Hidden nodes of an mlp or of CMA-ES's recurrent network."""
    harmonics: int = 1
    """Harmonics of the clock."""
    restarts: int | None = None
    """Number of searches that start, of which the best goes on; default 6."""
    generations: int | None = None
    """Generations of each start of NEAT, default 12; or, over all its stages, of the start of
    CMA-ES that goes on to the end, default 750."""
    random_candidates: int | None = None
    """Random networks from which CMA-ES chooses its starts; default 1200."""
    cma_generations: int | None = None
    """Generations of CMA-ES that tune the weights and the clock of NEAT's best network; default
    350."""
    population: int | None = None
    """Controllers in a generation; default 24 for CMA-ES, 150 for NEAT."""
    poses: int = 6
    """Random initial fin poses besides the zero pose, sampled in each generation. In a sample of
    bodies, each pose has its own body."""
    clock: float = 0.7
    """Frequency of the controllers' clock, in Hz; CMA-ES tunes it."""
    seconds: float = SECONDS
    """Length of a swim, in s."""
    threads: int | None = None
    """Threads; default all cores. No result depends on it."""

    def __post_init__(self) -> None:
        if self.paper:
            object.__setattr__(self, "search", "neat")
        for name, low, high in (
            ("seed", 0, MAXIMUM_SEED), ("hidden", 1, 100), ("harmonics", 1, MAXIMUM_HARMONICS),
            ("restarts", 1, 100), ("generations", 1, 100_000), ("random_candidates", 1, 100_000),
            ("cma_generations", 0, 100_000), ("population", 10, 10_000), ("poses", 0, 1000),
            ("threads", 1, MAXIMUM_THREADS),
        ):  # fmt: skip
            if getattr(self, name) is not None or name in ("seed", "hidden", "harmonics", "poses"):
                integer(name, getattr(self, name), low, high)
        one_of("search", self.search, ("cma", "neat"))
        one_of("controller", self.controller, get_args(Class))
        object.__setattr__(self, "senses", check_senses(self.senses))
        one_of("task", self.task, get_args(TaskName))
        finite_array("clock", self.clock, (), 0.0, 50.0, "Hz")
        step_count(self.seconds)
        if self.interval != INTERVAL:
            check_interval(self.interval, self.episode_seconds)
        for field in fields(self):
            if field.name in self.idle and getattr(self, field.name) not in (field.default, 0):
                raise InvalidArgumentError(
                    f"{field.name} has an effect only {self.idle[field.name]}; got "
                    f"{getattr(self, field.name)}"
                )
        if 0 < self.plan.random_candidates < self.plan.restarts:
            raise InvalidArgumentError(
                f"random_candidates must be at least the {self.plan.restarts} restarts; "
                f"got {self.plan.random_candidates}"
            )

    @property
    def idle(self) -> dict[str, str]:
        """The settings without effect, each with the words when it would have one.

        Examples
        --------
        >>> EvolveConfig(task="station").idle
        {'cma_generations': 'with search="neat"', 'seconds': 'with task="forward"'}
        """
        found: dict[str, str] = {}
        if self.search == "neat":
            names = ("controller", "hidden", "random_candidates")
            found |= dict.fromkeys(names, 'with search="cma"')
        else:
            found["cma_generations"] = 'with search="neat"'
        if self.controller == "linear":
            found["hidden"] = "with a controller that has hidden nodes"
        if "clock" not in self.senses:
            found |= dict.fromkeys(("harmonics", "clock"), "with the sense clock")
        if self.task != "forward":
            found["seconds"] = 'with task="forward"'
        return found

    @property
    def episode_seconds(self) -> float:
        """Length of an episode, in s."""
        return self.seconds if self.task == "forward" else TASKS[self.task].seconds

    @property
    def plan(self) -> Plan:
        """The choices, with defaults filled in.

        Examples
        --------
        >>> EvolveConfig(search="neat").plan.population
        150
        """
        senses = make_senses(self.senses, self.task, self.harmonics)
        given = (
            self.population, self.restarts, self.random_candidates, self.generations,
            self.cma_generations,
        )  # fmt: skip
        defaults = DEFAULTS["paper" if self.paper else self.search]
        population, restarts, candidates, generations, tuning = (
            default if value is None else value
            for value, default in zip(given, defaults, strict=True)
        )
        if self.search == "neat":
            rows = restarts * generations
            rows += generation_count(halving_stages(restarts, tuning, neat.STAGES))
        else:
            rows = 1 + generation_count(halving_stages(restarts, generations, cma.STAGES))
        return Plan(senses, population, restarts, candidates, generations, tuning, rows)

    @property
    def settings(self) -> dict[str, Any]:
        """All that a run depends on, ready for JSON, except the length of its last stage."""
        plan = {**self.plan._asdict(), "senses": asdict(self.plan.senses)}
        omitted = {"threads", "paper", "rows"}
        if self.plan.cma_generations:
            omitted.add("cma_generations")
        elif self.search == "cma" or self.plan.restarts == 1:
            omitted.add("generations")
        settings = {**asdict(self), **plan}
        return {name: value for name, value in settings.items() if name not in omitted}
