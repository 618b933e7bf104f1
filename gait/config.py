"""How a gait is evolved."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal, NamedTuple, get_args

from aquafish_gym.engines.base import TIMESTEP
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
from gait.search import schedules

DEFAULT_QUANTILE = 0.2
Sense = Literal["imu", "clock", "fins"]
TaskName = Literal["forward", "station", "waypoint", "recovery"]
Class = Literal["feed-forward", "recurrent", "linear", "mlp", "fourier"]
# Of each search, the first being its own choice.
CLASSES: dict[str, tuple[Class, ...]] = {
    "neat": ("feed-forward", "recurrent"),
    "cma": ("recurrent", "mlp", "linear", "fourier"),
}
FOURIER = 3  # harmonics of a gait that feels nothing


# Population, starts, how many are screened, generations and polish, where they are not given.
CMA_POPULATION = 24  # in polishing, too
NEAT, CMA = (150, 6, 0, 12, 350), (CMA_POPULATION, 6, 1200, 750, 0)


def check_interval(value: object, seconds: float) -> int:
    """Return for how many steps an action is held: some that ``gait.swim`` asks after, too."""
    steps = round(seconds / TIMESTEP)
    held_for = integer("interval", value, 1)
    some = [n for n in range(INTERVAL, steps // 2 + 1, INTERVAL) if not steps % n]
    if held_for not in some:
        nearest = min(some, key=lambda n: abs(n - held_for))
        raise InvalidArgumentError(
            f"interval must be a multiple of {INTERVAL} that divides {steps}, an "
            f"episode's steps; got {held_for}; the nearest is {nearest}"
        )
    return held_for


def check_senses(senses: object) -> tuple[Sense, ...]:
    """Return what a controller feels as a tuple: one of the senses or more."""
    names = get_args(Sense)
    if not isinstance(senses, list | tuple) or not senses:
        raise InvalidArgumentError(
            f"senses must be some of {', '.join(names)}; got {brief(senses) if senses else 'none'}"
        )
    for sense in senses:
        one_of("senses", sense, names)
    return tuple(senses)


class Plan(NamedTuple):
    """What a configuration comes to where it leaves a choice to the search."""

    controller: Class
    senses: Senses
    population: int
    starts: int
    screened: int
    generations: int  #: Of the start that goes on to the end.
    polish: int
    rows: int  #: Generations of all starts, polishing and screening together.


@dataclass(frozen=True, kw_only=True)
class EvolveConfig:
    """How to evolve a gait.

    Examples
    --------
    >>> EvolveConfig(generations=200, seed=3).plan.population
    150
    """

    seed: int = 0
    """The run follows from it alone."""
    search: Literal["neat", "cma"] = "neat"
    """What searches: NEAT, as the paper has it, or CMA-ES, which finds better gaits."""
    controller: Class | None = None
    """What a controller is. For NEAT a feed-forward network or a recurrent one; for CMA-ES a
    recurrent network, an mlp, a linear one, or fourier, which swims by the clock alone. The first
    if not given."""
    senses: tuple[Sense, ...] = ("imu", "clock")
    """What it feels, besides the way to a goal where the task has one. The fins are not measured,
    but known from where they stood at first and what they were told since."""
    task: TaskName = "forward"
    """What to do: swim forward, or another task of the environments, which takes longer."""
    interval: int = INTERVAL
    """For how many steps of 0.01 s an action is held."""
    hidden: int = 6
    """Nodes between inputs and outputs, of an mlp or CMA-ES's recurrent network."""
    harmonics: int | None = None
    """Of the clock, at multiples of its frequency: 1, or 3 of a fourier gait, if not given."""
    starts: int | None = None
    """How many searches begin, of which the best goes on: 6 if not given. Of NEAT's each third one,
    the first among them, adds nodes and connections seldom, the others often."""
    generations: int | None = None
    """How many each start of NEAT has, 12 if not given; how many the start of CMA-ES that goes on
    has in all, 750."""
    screened: int | None = None
    """Random networks that CMA-ES chooses its starts from: 1200 if not given."""
    polish: int | None = None
    """Generations of CMA-ES on the weights and the clock of the networks that NEAT found, of the
    one that goes on in all; 350 if not given."""
    population: int | None = None
    """Controllers in a generation: 150 of NEAT, 24 of CMA-ES, if not given."""
    poses: int = 6
    """Random fin poses to swim from besides the zero pose, others in every generation. In a sample
    of bodies, each pose is another body's, and each generation draws others."""
    clock: float = 0.7
    """Frequency of the controllers' clock, in Hz; CMA-ES tunes it."""
    seconds: float = SECONDS
    """How long a swim lasts, in s."""
    aggregate: Literal["mean", "quantile"] = "mean"
    """What a controller's swims come to: their mean distance, or a low quantile of it, for a gait
    that holds for nearly all bodies and poses rather than for most."""
    quantile: float = DEFAULT_QUANTILE
    """The share of swims that may fall short of the fitness, if aggregate is quantile."""
    threads: int | None = None
    """How many threads swim; every core if not given. No result depends on it."""

    def __post_init__(self) -> None:
        integer("seed", self.seed, 0, MAXIMUM_SEED)
        for name, low, high in (
            ("generations", 1, 100_000), ("population", 10, 10_000), ("starts", 1, 100),
            ("screened", 1, 100_000), ("polish", 0, 100_000), ("harmonics", 1, MAXIMUM_HARMONICS),
            ("hidden", 1, 100),
        ):  # fmt: skip
            if getattr(self, name) is not None:
                integer(name, getattr(self, name), low, high)
        classes = CLASSES[one_of("search", self.search, CLASSES)]
        if self.controller is not None:
            one_of("controller", self.controller, classes)
        object.__setattr__(self, "senses", check_senses(self.senses))
        if self.controller == "fourier" and set(self.senses) != {"clock"}:
            raise InvalidArgumentError(
                "senses must be clock alone for a fourier gait, which feels nothing; got "
                f"{', '.join(self.senses)}"
            )
        if self.screened is not None and self.search != "cma":
            raise InvalidArgumentError(
                f'screened has a say only with search="cma"; got {self.screened} with '
                f'"{self.search}"'
            )
        one_of("task", self.task, get_args(TaskName))
        starts = self.plan.starts
        if self.screened is not None and self.screened < starts:
            raise InvalidArgumentError(
                f"screened must be at least the {starts} starts; got {self.screened}"
            )
        if self.polish and self.search != "neat":
            raise InvalidArgumentError(
                f'polish has a say only with search="neat"; got {self.polish} with "{self.search}"'
            )
        integer("poses", self.poses, 0, 1000)
        finite_array("clock", self.clock, (), 0.0, 50.0, "Hz")
        step_count(self.seconds)
        if self.task != "forward" and self.seconds != SECONDS:
            raise InvalidArgumentError(
                f'seconds has a say only with task="forward", for a task says itself how long it '
                f'lasts; got {self.seconds:g} with "{self.task}"'
            )
        if self.interval != INTERVAL:
            check_interval(self.interval, self.lasts)
        one_of("aggregate", self.aggregate, ("mean", "quantile"))
        finite_array("quantile", self.quantile, (), 0.0, 1.0)
        if self.aggregate == "mean" and self.quantile != DEFAULT_QUANTILE:
            raise InvalidArgumentError(
                f'quantile has a say only with aggregate="quantile"; got {self.quantile:g} with '
                'aggregate="mean"'
            )
        if self.aggregate == "quantile" and not self.poses:
            raise InvalidArgumentError(
                'poses must be at least 1 with aggregate="quantile": one swim has no quantiles'
            )
        if self.threads is not None:
            integer("threads", self.threads, 1, MAXIMUM_THREADS)

    @property
    def lasts(self) -> float:
        """How long an episode is, in s."""
        return self.seconds if self.task == "forward" else TASKS[self.task].seconds

    @property
    def plan(self) -> Plan:
        """What all choices come to.

        Examples
        --------
        >>> EvolveConfig(search="cma").plan.controller
        'recurrent'
        """
        neat = self.search == "neat"
        controller = self.controller or CLASSES[self.search][0]
        usual = FOURIER if controller == "fourier" else 1
        harmonics = (usual if self.harmonics is None else self.harmonics) * ("clock" in self.senses)
        goal = TASKS[self.task].has_goal
        senses = Senses("imu" in self.senses, harmonics, "fins" in self.senses, goal)
        given = self.population, self.starts, self.screened, self.generations, self.polish
        population, starts, screened, generations, polish = (
            usual if value is None else value
            for value, usual in zip(given, NEAT if neat else CMA, strict=True)
        )
        if neat:
            rows = schedules.neat(starts, generations, polish)
        else:
            rows = schedules.cma(starts, generations)
        return Plan(controller, senses, population, starts, screened, generations, polish, rows)

    @property
    def settings(self) -> dict[str, Any]:
        """All that a run follows from, ready for JSON, but for how long its last part is."""
        plan, given = self.plan, asdict(self)
        for name in ("threads", "harmonics"):
            del given[name]
        given |= {name: value for name, value in plan._asdict().items() if name != "rows"}
        given["senses"] = asdict(plan.senses)
        del given["polish" if plan.polish else "generations"]
        if self.task == "forward":
            del given["task"]
        if self.interval == INTERVAL:
            del given["interval"]
        if self.aggregate == "mean":
            del given["aggregate"], given["quantile"]
        return given
