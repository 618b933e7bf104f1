"""The Estimation-Exploration Algorithm: rounds of asking the target and modelling it (Sec. 3.2)."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from typing import Any, Self

import numpy as np

from eea.core.angles import circular_distance
from eea.core.behavior import summarize
from eea.core.bits import BitLayout, pose_layout
from eea.core.checks import ConfigurationError, TargetError, at_most, finite, instance, whole
from eea.core.config import EEAConfig
from eea.core.estimation import Estimation
from eea.core.experiment import Context, Experiment, Floats, Simulator, Target, resumes, reveals
from eea.core.exploration import Exploration
from eea.core.fitness import chance_level, mid_range_level, nearest_level, objective_fitness
from eea.core.inference import FINS, Ideal, InBand, Inference, NoInference, OutOfBand
from eea.core.laboratory import Laboratory
from eea.core.state import pack, unpack

SCHEMA = "eea.result/1"
STATE_SCHEMA = "eea.state/1"
STREAMS: tuple[str, ...] = ("target", "exploration", "estimation", "inference")


def streams(seed: int) -> dict[str, np.random.Generator]:
    """Return one replicate's named sources of chance.

    The target has its own, so that the angles it hides are the same under every condition and
    comparisons are paired.

    Raises
    ------
    ConfigurationError
        If the seed is not a whole number of at least 0.
    """
    whole("seed", seed, 0)
    children = np.random.SeedSequence(seed).spawn(len(STREAMS))
    return {
        name: np.random.default_rng(child) for name, child in zip(STREAMS, children, strict=True)
    }


@dataclass(frozen=True)
class RoundRecord:
    """What one round did and found; every field is ready for JSON.

    Attributes
    ----------
    round
        From 1; also the number of experiments so far.
    command
        What the target performed.
    action_fitness
        ACT_FIT of that command (Eq. 1); ``None`` for the first, which is random.
    model_fitness
        The best MOD_FIT (Eq. 3).
    morphology
        The model that has it, nine numbers.
    min_angle, max_angle
        The range inferred for the fins' angles in this round's experiment, rad.
    true_angles, angle_error
        The truth, and its distance from the range's middle, rad; ``None`` if not revealed.
    objective_fitness
        OBJ_FIT (Eq. 4); ``None`` if the truth is not known.
    dimension_error
        The model's distance from the truth in each dimension, as a share of its range; ``None``
        if the truth is not known.
    spread
        The standard deviation over the final population in each dimension, as such a share: what
        the models still disagree about.
    trials
        Simulated in this round.
    seconds
        Since the run began; a run that goes on after an interruption goes on counting.
    """

    round: int
    command: tuple[float, ...]
    action_fitness: float | None
    model_fitness: float
    morphology: tuple[float, ...]
    min_angle: tuple[float, ...]
    max_angle: tuple[float, ...]
    true_angles: tuple[float, ...] | None
    angle_error: tuple[float, ...] | None
    objective_fitness: float | None
    dimension_error: tuple[float, ...] | None
    spread: tuple[float, ...]
    trials: int
    seconds: float

    @classmethod
    def from_dict(cls, document: dict[str, Any]) -> Self:
        """Return the record that ``to_dict`` or its JSON describes.

        Raises
        ------
        TypeError
            If a field is missing or unknown.
        """
        values: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in document.items()
        }
        return cls(**values)

    def to_dict(self) -> dict[str, Any]:
        """Return the record for JSON."""
        return asdict(self)


@dataclass
class Result:
    """A run's settings, rounds and conclusion; readable after every round.

    Attributes
    ----------
    config, seed
        What was run.
    layout
        The models' genome, for the ranges of the dimensions.
    truth
        The target's dimensions (n,), if known: an oracle.
    rounds
        One record a round.
    stopped
        Why it ended: ``"rounds"``, ``"accurate"``, ``"time"``, or ``"interrupted"`` until then.
    """

    config: EEAConfig
    seed: int
    layout: BitLayout
    truth: Floats | None = None
    rounds: list[RoundRecord] = field(default_factory=list)
    stopped: str = "interrupted"

    @property
    def model(self) -> Floats:
        """The last round's best model, shape (n,).

        Raises
        ------
        TargetError
            If no round has been completed.
        """
        if not self.rounds:
            raise TargetError("there is no model yet: no round was completed")
        return np.array(self.rounds[-1].morphology)

    @property
    def chance(self) -> float | None:
        """The mean OBJ_FIT of uniform random genomes, if the truth is known."""
        return None if self.truth is None else chance_level(self.truth, self.layout)

    @property
    def mid_range(self) -> float | None:
        """The OBJ_FIT of the body in the middle of all ranges, if the truth is known."""
        return None if self.truth is None else mid_range_level(self.truth, self.layout)

    @property
    def nearest(self) -> float | None:
        """The OBJ_FIT of the body nearest to the truth that a genome can spell, if it is known."""
        return None if self.truth is None else nearest_level(self.truth, self.layout)

    def to_dict(self) -> dict[str, Any]:
        """Return everything, ready for JSON."""
        return {
            "schema": SCHEMA,
            "config": self.config.to_dict(),
            "seed": self.seed,
            "stopped": self.stopped,
            "dimensions": list(self.layout.names),
            "morphology": list(self.rounds[-1].morphology) if self.rounds else None,
            "truth": None if self.truth is None else self.truth.tolist(),
            "chance": self.chance,
            "mid_range": self.mid_range,
            "nearest": self.nearest,
            "rounds": [record.to_dict() for record in self.rounds],
        }

    def to_json(self) -> str:
        """Return everything as one line of JSON."""
        return json.dumps(self.to_dict(), allow_nan=False)


def make_inference(
    config: EEAConfig, fins: Sequence[str], laboratory: Laboratory, rng: np.random.Generator
) -> Inference:
    """Return the strategy for ``config.condition``; ``fins`` names the angles of a pose."""
    if config.condition == "ideal":
        return Ideal()
    if config.condition == "none":
        return NoInference()
    if config.condition == "in-band":
        return InBand(config.in_band)
    poses = pose_layout(fins, config.genetic.coding)
    return OutOfBand(config.out_of_band, poses, laboratory, config.genetic, rng)


class EEA:
    """One run of the algorithm against one target.

    Parameters
    ----------
    target
        What is to be modelled; it is asked once a round.
    simulator
        Runs the models.
    models, actions
        The two genomes' layouts.
    config
        Settings.
    seed
        Of the replicate.
    truth
        The target's dimensions (n,) if known: only for OBJ_FIT in the records.

    Raises
    ------
    ConfigurationError
        If a setting is wrong, or the truth has another shape.
    TargetError
        If the condition is Ideal and the target does not reveal its fins' angles.

    Examples
    --------
    ``for record in EEA(...)`` yields a record as each round ends, and ``run`` is that loop. A
    round that is broken off, by Ctrl-C or by an error of the target's, leaves no trace here, and
    a new loop goes on after the last complete one. (The target has moved, of course: it performs
    that round's command again.)
    """

    def __init__(
        self,
        target: Target,
        simulator: Simulator,
        models: BitLayout,
        actions: BitLayout,
        config: EEAConfig,
        seed: int = 0,
        truth: Floats | None = None,
    ) -> None:
        instance("config", config, EEAConfig)
        poses = pose_layout(actions.names, config.genetic.coding)
        searched = [models, actions, *([poses] if config.condition == "out-of-band" else [])]
        shortest = min(layout.bits for layout in searched)
        at_most(
            "genetic.mutations", config.genetic.mutations, "the shortest genome's bits", shortest
        )
        if truth is not None:
            truth = finite("truth", truth, (len(models),))
        if config.condition == "ideal" and not reveals(target):
            raise TargetError(
                "the ideal condition needs a target with last_fin_angles, the fins' angles when "
                f"its last command began; {type(target).__name__} has none"
            )
        chance = streams(seed)
        self.result = Result(config, seed, models, truth)
        self._target = target
        self._laboratory = Laboratory(simulator, config.behavior, config.steps)
        self._exploration = Exploration(
            actions, self._laboratory, config.exploration, config.genetic, chance["exploration"]
        )
        self._estimation = Estimation(
            models, self._laboratory, config.estimation, config.genetic, chance["estimation"]
        )
        self._streams = tuple(chance.values())
        self._chance = chance["inference"]
        self._inference = make_inference(config, actions.names, self._laboratory, self._chance)
        self._experiments: list[Experiment] = []

    def run(self, progress: Callable[[RoundRecord], None] | None = None) -> Result:
        """Run to a stop rule; call ``progress`` after each round.

        Ctrl-C loses only its round: ``result`` has the others, and to run again is to go on.
        """
        for record in self:
            if progress is not None:
                progress(record)
        return self.result

    def __iter__(self) -> Iterator[RoundRecord]:
        """Yield a record a round until a stop rule holds; ``result`` grows with them."""
        config, result = self.result.config, self.result
        began = time.monotonic() - (result.rounds[-1].seconds if result.rounds else 0.0)
        while True:
            fitness = result.rounds[-1].model_fitness if result.rounds else float("-inf")
            if config.accurate is not None and fitness >= config.accurate:
                result.stopped = "accurate"
                return
            if len(result.rounds) >= config.rounds:
                result.stopped = "rounds"
                return
            if config.time_limit is not None and time.monotonic() - began >= config.time_limit:
                result.stopped = "time"
                return
            with self._whole_or_not_at_all():
                record = self._round(began)
                result.rounds.append(record)
            yield record

    @contextmanager
    def _whole_or_not_at_all(self) -> Iterator[None]:
        """Undo a round that is broken off: its experiment, what it inferred, what it drew."""
        saved = self._save()
        try:
            yield
        except BaseException:
            self._go_back(saved)
            raise

    def save(self) -> dict[str, Any]:
        """Return everything that the next rounds depend on, ready for JSON, for ``restore``.

        To be called between rounds, as the loop over an ``EEA`` does.

        Notes
        -----
        Floats go through JSON unchanged and arrays are packed byte for byte, so a restored run's
        records are those of the undisturbed run to the bit, ``seconds`` apart. A target that can
        be put back (``ResumableTarget``), such as ``EngineTarget``, is saved too. A physical one
        cannot be: it goes on from wherever its fins are, and hides other angles.
        """
        state: dict[str, Any] = pack(self._save())
        return {
            "schema": STATE_SCHEMA,
            "config": self.result.config.to_dict(),
            "seed": self.result.seed,
            **state,
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Go back, or on, to what ``save`` returned, in this process or another.

        Parameters
        ----------
        saved
            From an ``EEA`` of the same settings, seed, robot and kind of target.

        Raises
        ------
        ConfigurationError
            If it is no saved state, damaged, or that of another run; nothing has changed then.
        """
        if not isinstance(saved, dict) or saved.get("schema") != STATE_SCHEMA:
            raise ConfigurationError(f"saved must be a state of schema {STATE_SCHEMA}")
        ours = {"config": self.result.config.to_dict(), "seed": self.result.seed}
        for name, value in json.loads(json.dumps(ours)).items():
            if json.loads(json.dumps(saved.get(name))) != value:
                raise ConfigurationError(f"saved must be a state of this run; its {name} differs")
        before = self._save()
        try:
            self._go_back(unpack(saved))
        except (AttributeError, KeyError, TypeError, ValueError, IndexError) as error:
            self._go_back(before)
            raise ConfigurationError(f"saved must be a whole state: {error!r}") from None

    def _save(self) -> dict[str, Any]:
        return {
            "rounds": [record.to_dict() for record in self.result.rounds],
            "experiments": [
                {
                    "command": experiment.command,
                    "behavior": experiment.behavior,
                    "min_angle": experiment.context.min_angle,
                    "max_angle": experiment.context.max_angle,
                    "confidence": experiment.context.confidence,
                    "true_angles": experiment.true_angles,
                }
                for experiment in self._experiments
            ],
            "estimation": self._estimation.save(),
            "trials": self._laboratory.trials,
            "streams": [dict(stream.bit_generator.state) for stream in self._streams],
            "target": self._target.save_state() if resumes(self._target) else None,
        }

    def _go_back(self, saved: dict[str, Any]) -> None:
        self.result.rounds[:] = [RoundRecord.from_dict(record) for record in saved["rounds"]]
        self._experiments[:] = [
            Experiment(
                experiment["command"],
                experiment["behavior"],
                Context(experiment["min_angle"], experiment["max_angle"], experiment["confidence"]),
                experiment["true_angles"],
            )
            for experiment in saved["experiments"]
        ]
        self._estimation.restore(saved["estimation"])
        self._laboratory.trials = saved["trials"]
        for stream, state in zip(self._streams, saved["streams"], strict=True):
            stream.bit_generator.state = state
        if resumes(self._target):
            self._target.restore_state(saved["target"])

    def _round(self, began: float) -> RoundRecord:
        trials = self._laboratory.trials
        estimation = self._estimation
        action_fitness: float | None = None
        if self._experiments:
            command, action_fitness = self._exploration.run(estimation.models, estimation.fitness)
        else:
            command = self._exploration.first()
        newest = self._perform(command)
        self._experiments.append(newest)
        morphology, model_fitness = estimation.run(self._experiments, self._inference, self._chance)
        truth, true, layout = self.result.truth, newest.true_angles, self.result.layout
        span = layout.high - layout.low
        objective: float | None = None
        apart: tuple[float, ...] | None = None
        if truth is not None:
            objective = float(objective_fitness(morphology, truth, layout))
            apart = tuple((np.abs(morphology - truth) / span).tolist())
        return RoundRecord(
            round=len(self._experiments),
            command=tuple(command.tolist()),
            action_fitness=action_fitness,
            model_fitness=model_fitness,
            morphology=tuple(morphology.tolist()),
            min_angle=tuple(newest.context.min_angle.tolist()),
            max_angle=tuple(newest.context.max_angle.tolist()),
            true_angles=None if true is None else tuple(true.tolist()),
            angle_error=None
            if true is None
            else tuple(circular_distance(newest.context.middle, true).tolist()),
            objective_fitness=objective,
            dimension_error=apart,
            spread=tuple((estimation.models.std(axis=0) / span).tolist()),
            trials=self._laboratory.trials - trials,
            seconds=time.monotonic() - began,
        )

    def _perform(self, command: Floats) -> Experiment:
        """Let the target perform; its fins' angles are noted only if it reveals them."""
        laboratory = self._laboratory
        log = self._target.perform(command.copy())
        behavior = summarize(log, laboratory.behavior, laboratory.steps, "the target")
        if len(behavior) != 1:
            raise TargetError(
                f"the target must return the log of one trial; it returned {len(behavior)}"
            )
        if not np.isfinite(behavior).all():
            raise TargetError("the target's log must be finite; it holds NaN or infinity")
        true: Floats | None = None
        if reveals(self._target):
            try:
                true = finite("last_fin_angles", self._target.last_fin_angles, (FINS,))
            except ConfigurationError as error:
                raise TargetError(f"the target's {error}") from None
        return Experiment(command, behavior[0], Context.unknown(FINS, 0.0), true)
