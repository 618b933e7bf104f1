"""The exploration phase: which command the target performs next (Sec. 3.2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from eea.core.angles import Floats
from eea.core.bits import BitLayout
from eea.core.checks import choice, whole
from eea.core.design import (
    ANGLE_INFORMATION,
    EVALUATED_AT,
    UNIFORM_INFORMATION,
    Designed,
    Forecast,
    best_command,
    candidates,
    fast_command,
)
from eea.core.experiment import Trials
from eea.core.genetic import MAXIMUM_GENERATIONS, MAXIMUM_POPULATION, GeneticConfig, evolve
from eea.core.model_evaluator import ModelEvaluator

Strategy = Literal["disagreement", "random", "fast", Designed]
RESOLUTION = 0.01  # of the signal's standard deviation: what an EEA's models are told apart by


@dataclass(frozen=True)
class ExplorationConfig:
    """The exploration phase's settings (the paper's are the defaults)."""

    population: int = 25  #: How many commands evolve, for disagreement.
    generations: int = 25  #: For how many generations they evolve in a round.
    #: Where all the models begin: "zero", every hidden angle at zero, or "common_random", one
    #: random pose a round. It is common to all, so that disagreement is the bodies'.
    pose: Literal["zero", "common_random"] = "zero"
    #: How many models, the fittest, enter Eq. 1; None for the whole population.
    best_models: int | None = None
    #: How a command is chosen. The paper's is "disagreement": the models' (Eq. 1) about commands
    #: that evolve. "random" is any, and "fast" an end of every servo's range, no two alike before
    #: all have been. The others choose, of the fast commands and random ones, that which promises
    #: most, and begin with a fast one: the least mean variance of the body's sizes ("a-optimal"),
    #: the smallest volume that they lie in ("d-optimal"), the most "information" about all that is
    #: unknown, or the farthest swimming of the "gait" that is then chosen, which needs a utility
    #: (aquafish run has one). "auto" is "disagreement", or "fast" under the joint condition.
    strategy: Literal["auto"] | Strategy = "auto"

    def __post_init__(self) -> None:
        whole("exploration.population", self.population, 2, MAXIMUM_POPULATION)
        whole("exploration.generations", self.generations, 1, MAXIMUM_GENERATIONS)
        choice("exploration.pose", self.pose, ("zero", "common_random"))
        if self.best_models is not None:
            whole("exploration.best_models", self.best_models, 2, MAXIMUM_POPULATION)
        choice("exploration.strategy", self.strategy, ("auto", *get_args(Strategy)))


@dataclass
class Exploration:
    """Chooses the commands to perform on the target."""

    layout: BitLayout
    hidden: int  #: How many hidden angles a pose has.
    evaluator: ModelEvaluator
    config: ExplorationConfig
    genetic: GeneticConfig
    rng: np.random.Generator

    def choose(
        self,
        strategy: Strategy,
        performed: Floats,
        models: Callable[[], tuple[Floats, Floats]],
        forecast: Callable[[], Forecast],
        utilities: Callable[[Forecast], Floats],
    ) -> tuple[Floats, float | None]:
        """Return the next command (c,) and what it promises, None where it promises nothing.

        Parameters
        ----------
        strategy
            How; before the first trial, when nothing is known, those that compare promises take
            a fast command, and disagreement a random one.
        performed
            The commands so far, (E, c).
        models, forecast, utilities
            What ``run``, the designs and the design for the gait need, if they are asked.
        """
        if strategy == "random" or (strategy == "disagreement" and not len(performed)):
            return self.first(), None
        if strategy == "disagreement":
            return self.run(*models())
        if strategy == "fast" or not len(performed):
            return fast_command(self.layout, performed, self.rng), None
        ahead, commands = forecast(), candidates(self.layout, self.rng)
        told = utilities(ahead) if strategy == "gait" else None
        return best_command(ahead, commands, strategy, told, self.rng)

    def first(self) -> Floats:
        """Return a random command (c,): before any experiment the models know nothing."""
        command: Floats = self.layout.decode(self.layout.random(1, self.rng))[0]
        return command

    def run(self, models: Floats, fitness: Floats) -> tuple[Floats, float]:
        """Evolve a command about which models (M, n) disagree; return the best and its ACT_FIT.

        ``best_models`` chooses by the models' MOD_FIT, shape (M,).
        """
        config = self.config
        if config.best_models is not None:
            models = models[np.argsort(-fitness, kind="stable")[: config.best_models]]
        pose = np.zeros(self.hidden)
        if config.pose == "common_random":
            pose = self.rng.uniform(-np.pi, np.pi, size=self.hidden)
        genome, act_fit = evolve(
            self.layout.random(config.population, self.rng),
            config.generations,
            lambda genomes: self._disagreement(models, self.layout.decode(genomes), pose),
            self.genetic,
            self.rng,
        )
        return self.layout.decode(genome[None])[0], act_fit

    def _disagreement(self, models: Floats, commands: Floats, pose: Floats) -> Floats:
        """Return ACT_FIT (A,) of commands (A, c) over models (M, n).

        A command that some model cannot be simulated under scores below all others.
        """
        actions, count = len(commands), len(models)
        trials = Trials(
            np.tile(models, (actions, 1)),
            np.repeat(commands, count, axis=0),
            np.broadcast_to(pose, (actions * count, len(pose))),
        )
        fitness = self.evaluator.disagreements(trials, count)
        return np.where(np.isfinite(fitness), fitness, -1.0)

    def forecast(
        self, layout: BitLayout, models: Floats, fitness: Floats, performed: Floats, told: bool
    ) -> Forecast:
        """Return what an EEA's models (M, n), of MOD_FIT (M,), expect of a trial.

        A population is no posterior: it has as many members as it was given, and they may agree by
        descent. So only where it is counts, and what is known there is what the commands performed
        (E, c) can have told at such bodies, besides that each size is in its range. As the noise,
        of which an EEA knows nothing, a hundredth of the signal counts; it hardly matters, as it
        makes all trials better or worse alike.

        Parameters
        ----------
        layout
            The models' genome, for their ranges.
        told
            Whether the target reveals the hidden angles.
        """
        best = models[np.argsort(-fitness, kind="stable")]
        best = best[np.sort(np.unique(best, axis=0, return_index=True)[1])]
        samples = (best - layout.low) / layout.span
        own = self.rng.uniform(-np.pi, np.pi, (min(EVALUATED_AT, len(samples)), self.hidden))

        def simulate(samples: Floats, own: Floats, commands: Floats) -> Floats:
            bodies = layout.low + layout.span * samples
            return self.evaluator.signals(Trials(bodies, commands, own))

        ahead = Forecast(
            samples,
            len(layout),
            UNIFORM_INFORMATION * np.eye(len(layout)),
            own,
            np.full(self.hidden, np.inf if told else ANGLE_INFORMATION),
            simulate,
            sigma=1.0,
        )
        trial = np.repeat(np.arange(len(performed)), len(own))
        seen = np.tile(np.arange(len(own)), len(performed))
        usual = float(np.nanstd(simulate(samples[seen], own[seen], performed[trial])))
        ahead = replace(ahead, sigma=RESOLUTION * max(usual, 1e-9))
        learnt = ahead.informations(performed).mean(axis=1).sum(axis=0)
        return replace(ahead, information=ahead.information + learnt)
