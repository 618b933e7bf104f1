"""Rows of whole replicates for ``python -m instruments.benchmarks``, one of them taken apart.

The benchmark finds them by name (``instruments.benchmarks.rows.GROUPS``).
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import Any

import eea.core.algorithm
import eea.core.genetic
import eea.fish.spectral
from aquafish_gym.engines.compiled import lanes
from aquafish_gym.engines.compiled.lanes import LaneBatch
from eea.core.config import EstimationConfig, ExplorationConfig, PaperConfig
from eea.core.genome import BitLayout
from eea.fish.methods import estimate_morphology
from eea.study.arms import figure_config
from instruments.benchmarks.rows import Group, Row, Settings

ROUNDS, QUICK_ROUNDS = 25, 2
DURATIONS, QUICK_DURATIONS = (128, 256, 512, 1024), (128,)
APART = 512  # steps of the replicate that is taken apart; when quick, the only one there is
OUT_OF_BAND = 256  # steps of the replicate under that condition

REST = "the rest"
# Where the time of each part is spent: the functions, as the names that their callers look up.
# A part that calls another does not count the other's time.
PARTS: dict[str, tuple[tuple[Any, str], ...]] = {
    "physics, transform": ((LaneBatch, "_run"),),
    "batches": ((LaneBatch, "__init__"), (LaneBatch, "spectra")),
    "Eq. 2": ((eea.fish.spectral, "pack_spectra"), (lanes, "spectral_distances")),
    "Eq. 1": ((eea.fish.spectral, "disagreements"),),
    "GA": (
        (eea.core.algorithm, "next_generation"),
        (eea.core.genetic, "next_generation"),
        (BitLayout, "decode"),
    ),
}


class Stopwatch:
    """Gives every moment to one part: that of the innermost timed call, or the rest.

    Attributes
    ----------
    seconds
        What each part has been given so far, the rest last.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = dict.fromkeys([*PARTS, REST], 0.0)
        self._running = [REST]
        self._began = self._since = time.perf_counter()

    def stop(self) -> float:
        """Return the whole time since the beginning, which is the parts' sum, in s."""
        self._give()
        return self._since - self._began

    def timed(self, part: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return the function, its time given to a part."""

        @functools.wraps(function)
        def call(*args: Any, **kwargs: Any) -> Any:
            self._give()
            self._running.append(part)
            try:
                return function(*args, **kwargs)
            finally:
                self._give()
                self._running.pop()

        return call

    def _give(self) -> None:
        now = time.perf_counter()
        self.seconds[self._running[-1]] += now - self._since
        self._since = now


@contextmanager
def taken_apart() -> Iterator[Stopwatch]:
    """Time the functions of ``PARTS`` from here on, and put them back at the end.

    Raises
    ------
    KeyError
        If one of them is no longer where ``PARTS`` says.
    """
    places = [(part, *place) for part, found in PARTS.items() for place in found]
    originals = [vars(owner)[name] for _, owner, name in places]
    watch = Stopwatch()
    try:
        for (part, owner, name), original in zip(places, originals, strict=True):
            setattr(owner, name, watch.timed(part, original))
        yield watch
    finally:
        for (_, owner, name), original in zip(places, originals, strict=True):
            setattr(owner, name, original)


def replicates(settings: Settings, _cleanup: ExitStack) -> Group:
    """Return Ideal replicates by duration, one of them in parts, and an Out-of-Band one."""
    rounds = QUICK_ROUNDS if settings.quick else ROUNDS
    durations = QUICK_DURATIONS if settings.quick else DURATIONS
    apart = durations[0] if settings.quick else APART
    steps_out_of_band = durations[0] if settings.quick else OUT_OF_BAND
    seconds: dict[str, float] = {}

    def run(config: PaperConfig) -> float:
        start = time.perf_counter()
        estimate_morphology(config=config, seed=settings.seed, target_engine="numba", threads=1)
        return time.perf_counter() - start

    def run_apart(config: PaperConfig) -> float:
        with taken_apart() as watch:
            run(config)
            whole = watch.stop()
        seconds.update(watch.seconds)
        return whole

    def row(what: str, call: Callable[[], float], against: Row | None, share: bool = False) -> Row:
        return Row(what, "numba", "float32", 1, 1, 1, call, against, as_time=True,
                   own_clock=True, most_turns=1, share=share)  # fmt: skip

    _warm_up(settings.seed)
    rows: list[Row] = []
    for steps in durations:
        call = functools.partial(
            run_apart if steps == apart else run, figure_config("fig5", steps, rounds)
        )
        whole = row(f"Ideal, {steps} steps", call, rows[0] if rows else None)
        rows.append(whole)
        if steps == apart:
            # They are read right after the row that they are parts of: no run of their own.
            rows += [
                row(f"of which {part}", functools.partial(seconds.__getitem__, part), whole, True)
                for part in (*PARTS, REST)
            ]
    config = figure_config("fig9", steps_out_of_band, rounds)
    of_same_steps = next(r for r in rows if r.what == f"Ideal, {steps_out_of_band} steps")
    rows.append(
        row(f"Out-of-Band, {steps_out_of_band} steps", functools.partial(run, config),
            of_same_steps)
    )  # fmt: skip
    return Group(f"a replicate of {rounds} rounds: time", "replicate", rows)


def _warm_up(seed: int) -> None:
    """Compile everything that the rows call: the loops are the same for any duration."""
    config = replace(
        figure_config("fig5", eea.fish.spectral.SHORTEST_SPECTRUM_STEPS, QUICK_ROUNDS),
        exploration=ExplorationConfig(population=2, generations=1),
        estimation=EstimationConfig(population=2, generations=1),
    )
    estimate_morphology(config=config, seed=seed, target_engine="numba", threads=1)
