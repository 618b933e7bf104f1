"""The statistics and the picture of the recovery league."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import trim_mean

from aquafish_gym.plans import KNOWN_FINS
from aquafish_gym.rendering.pictures import new_figure
from eea.study.drawing import grid, legend_below
from experiments.league.policy import DT
from gait.swims.evaluation import success_rate

Floats = NDArray[np.float64]
Result = Mapping[str, Any]

SHARES = (0.5, 0.8, 0.9)  # of the oracle's mean pace after the onset
SUCCESS = 0.8  # of them
WINDOW = round(5.0 / DT)  # actions over which a pace is taken at least
HORIZON = 30.0  # s after the onset, which every episode has; recovery times are censored there
FAR = 1.0  # units: an oracle that makes less cannot be compared with
CURRENT_ERROR = 0.03  # units/s, of a current that is named
RESAMPLES = 2000
# Of lines: Tol's muted colours (personal.sron.nl/~pault), black and orange; dashed after these.
COLOURS = (
    "#88ccee", "#ddcc77", "#117733", "#332288", "#cc6677", "#aa4499",
    "#44aa99", "#999933", "#882255", "#000000", "#e69f00", "#7f7f7f",
)  # fmt: skip


def after_onset(result: Result) -> float:
    """Return the way along +y from the first onset on, in units; the whole, if nothing broke."""
    return float(result["way"][-1] - result["way"][(result["onsets"] or [0])[0]])


def interval(
    values: Sequence[float], damages: int, trimmed: float = 0.25
) -> tuple[float, float, float]:
    """Return the mean of episodes without a share ``trimmed`` at each end, and its 95% interval.

    The default is the interquartile mean; 0 is the mean. Of D damages, episode i has the (i mod
    D)-th. The bootstrap is stratified: it resamples the episodes of each damage (Agarwal et al.,
    "Deep reinforcement learning at the edge of the statistical precipice", 2021). Where damage is
    drawn at random, or a damage has one episode, all are of one stratum.

    Examples
    --------
    >>> interval([1.0, 2.0, 3.0, 1000.0], 1)[0], interval([1.0, 2.0, 6.0], 1, trimmed=0.0)[0]
    (2.5, 3.0)
    """
    table = np.asarray(values, float)
    rng = np.random.default_rng(0)
    number = damages if len(table) >= 2 * damages else 1
    strata = [np.arange(d, len(table), number) for d in range(number)]
    drawn = [rng.choice(rows, (RESAMPLES, len(rows))) for rows in strata]
    means = trim_mean(table[np.concatenate(drawn, axis=1)], trimmed, axis=1)
    low, high = np.quantile(means, (0.025, 0.975)).tolist()
    return float(trim_mean(table, trimmed)), low, high


def share(results: Sequence[Result], others: Sequence[Result]) -> tuple[float, float, float]:
    """Return the mean pace after the onset as a share of another's, with its 95% interval.

    The bootstrap resamples the pairs.
    """
    table = np.array(
        [[pace(mine), pace(other)] for mine, other in zip(results, others, strict=True)]
    )
    rng = np.random.default_rng(0)
    means = table[rng.integers(len(table), size=(RESAMPLES, len(table)))].mean(axis=1)
    low, high = np.quantile(means[:, 0] / means[:, 1], (0.025, 0.975)).tolist()
    mine, other = table.mean(axis=0).tolist()
    return mine / other, low, high


def pace(result: Result) -> float:
    """Return the way after the onset by the seconds that were left, units/s."""
    left = len(result["way"]) - 1 - int((result["onsets"] or [0])[0])
    return after_onset(result) / (DT * left)


def recognition(results: Sequence[Result]) -> dict[str, Any]:
    """Return how soon and how well an agent with a self-model knew what broke in a tier.

    ``right`` of ``episodes`` end with a belief that needs no other gait than the truth, and with a
    current named within ``CURRENT_ERROR`` if one began; ``at_once`` of them after one alarm.
    ``named_fins`` have an inference that names a fault of a fin, ``unknown`` the answer "unknown".
    ``changed`` and ``refined`` are the median times in s from the onset to the first gait that was
    chosen, and to the first that was refined; None if never.
    """
    found: dict[str, Any] = {"episodes": len(results)}
    right = [_is_right(result) for result in results]
    events = [[e for e in r["events"] if e[0] > DT * (r["onsets"] or [0])[0]] for r in results]
    alarms = [sum(event[1] == "alarm" for event in some) for some in events]
    found["right"] = sum(right)
    found["at_once"] = sum(r and count <= 1 for r, count in zip(right, alarms, strict=True))
    found["named_fins"] = sum(
        any(
            event[1] == "inferred" and any(word in event[2] for word in KNOWN_FINS.values())
            for event in some
        )
        for some in events
    )
    found["unknown"] = sum(any(event[1] == "unknown" for event in some) for some in events)
    for name, what in (("changed", "chose"), ("refined", "refined")):
        waits = [
            next(event[0] for event in some if event[1] == what) - DT * r["onsets"][0]
            for r, some in zip(results, events, strict=True)
            if r["onsets"] and any(event[1] == what for event in some)
        ]
        found[name] = float(np.median(waits)) if waits else None
    return found


def _is_right(result: Result) -> bool:
    belief = result["belief"]
    if "flow" not in result:
        return bool(belief["alike"])
    if not belief["current"]:
        return False
    error = np.subtract(belief["current"], result["flow"])
    return bool(belief["alike"] and np.abs(error).max() <= CURRENT_ERROR)


def paired(results: Sequence[Result], others: Sequence[Result], damages: int) -> dict[str, Any]:
    """Return an entrant's gain over another one in the same episodes.

    ``mean`` is that of its way after the onset less the other's, in units, with its 95% interval
    from the bootstrap of the pairs. In ``worse`` of ``episodes`` its way is the shorter one. In a
    task with success, ``only_own`` and ``only_other`` count the episodes in which one alone
    succeeds.
    """
    gains = [
        after_onset(mine) - after_onset(other) for mine, other in zip(results, others, strict=True)
    ]
    worse = sum(gain < 0.0 for gain in gains)
    found = {"mean": interval(gains, damages, 0.0), "worse": worse, "episodes": len(gains)}
    if "success" in results[0]:
        pairs = [(a["success"], b["success"]) for a, b in zip(results, others, strict=True)]
        found["only_own"] = pairs.count((True, False))
        found["only_other"] = pairs.count((False, True))
    return found


def recovered(way: Sequence[float], onset: int, pace: float) -> float:
    """Return after how many s the pace is back to stay, at most ``HORIZON``.

    From then on, the robot has made at least ``pace`` (units/s) on the mean up to every later
    moment that is 5 s or more away.

    Examples
    --------
    >>> waits = [0.0] * 26 + [0.1 * k for k in range(275)]
    >>> recovered(waits, 0, 0.5), recovered(waits, 0, 0.25), recovered(waits, 0, 0.6)
    (5.2, 2.8, 30.0)
    """
    lead = np.array(way[onset:]) - pace * DT * np.arange(len(way) - onset)
    if len(lead) <= WINDOW:
        return HORIZON
    least = np.minimum.accumulate(lead[::-1])[::-1]  # of all later moments
    back = np.flatnonzero(least[WINDOW:] >= lead[:-WINDOW] - 1e-9)
    return float(min(HORIZON, round(DT * back[0], 9))) if len(back) else HORIZON


def summary(
    results: Sequence[Result],
    damages: int,
    others: Mapping[str, Sequence[Result]],
    oracle: Sequence[Result] | None,
) -> dict[str, Any]:
    """Return what an entrant made in the episodes of a tier, beside others in the same episodes.

    ``way_after_onset`` is the interquartile mean in units with its 95% interval; where nothing
    breaks, of the whole way. ``over`` has the gain over each of the ``others``; see :func:`paired`.
    ``success_rate`` is the share of episodes that ended with success, with Wilson's interval.
    ``seconds_to`` a share of the oracle's mean pace: the median, and the mean restricted to 30 s.
    Of ``compared`` episodes, ``successes`` are those in which 80% of that pace is back within 30 s,
    and ``failures`` those in which half of it is not, or the robot diverged.
    """
    ways = [after_onset(result) for result in results]
    alarms = [[event[0] for event in r["events"] if event[1] == "alarm"] for r in results]
    false = [
        any(not r["onsets"] or t < DT * (r["onsets"][0] - 0.5) for t in times)
        for r, times in zip(results, alarms, strict=True)
    ]
    found: dict[str, Any] = {
        "episodes": len(results),
        "way_after_onset": interval(ways, damages),
        "mean": float(np.mean(ways)),
        "ways": [round(way, 3) for way in ways],
        "false_alarms": sum(false),
        "over": {name: paired(results, theirs, damages) for name, theirs in others.items()},
    }
    if "success" in results[0]:
        found["success_rate"] = success_rate(sum(r["success"] for r in results), len(results))
    if oracle is not None:
        pairs = [
            (result, after_onset(best) / (DT * (len(best["way"]) - 1 - best["onsets"][0])))
            for result, best in zip(results, oracle, strict=True)
            if best["onsets"] and after_onset(best) > FAR
        ]
        if not pairs:
            return found
        times = {
            share: [
                recovered(r["way"], r["onsets"][0], share * pace) if r["onsets"] else HORIZON
                for r, pace in pairs
            ]
            for share in SHARES
        }
        found["seconds_to"] = {
            f"{share:.0%}": {"median": float(np.median(some)), "mean": float(np.mean(some))}
            for share, some in times.items()
        }
        gone = [r["diverged"] for r, _ in pairs]
        failed = {
            share: sum(t == HORIZON or g for t, g in zip(some, gone, strict=True))
            for share, some in times.items()
        }
        found["failures"] = failed[SHARES[0]]
        found["successes"] = len(pairs) - failed[SUCCESS]
        found["compared"] = len(pairs)
    return found


def pace_figure(
    played: Mapping[tuple[str, str], Sequence[Result]],
    entrants: Sequence[str],
    tiers: Sequence[str],
) -> Any:
    """Draw the mean pace against the seconds since something broke, an entrant a line."""
    figure = new_figure(1.0 + 3.4 * len(tiers), 3.6)
    for axes, tier in zip(
        figure.subplots(1, len(tiers), sharey=True, squeeze=False).flat, tiers, strict=True
    ):
        for i, entrant in enumerate(entrants):
            lines = []
            for result in played[entrant, tier]:
                onset = (result["onsets"] or [100])[0]
                way = np.array(result["way"][onset - WINDOW : onset + round(HORIZON / DT) + 1])
                lines.append((way[WINDOW:] - way[:-WINDOW]) / (WINDOW * DT))
            shortest = min(map(len, lines))
            mean = np.mean([line[:shortest] for line in lines], axis=0)
            hero = entrant == "self-model"
            seconds = DT * (np.arange(shortest) - WINDOW / 2)
            width = 2.2 if hero else 1.2
            style = "-" if i < len(COLOURS) else "--"
            colour = COLOURS[i % len(COLOURS)]
            axes.plot(seconds, mean, style, c=colour, lw=width, label=entrant, zorder=2 + hero)
        axes.axvline(0.0, color="0.6", lw=0.8)
        axes.set_title(tier)
        axes.set_xlabel("seconds since something broke")
        grid(axes)
    figure.axes[0].set_ylabel("pace, units/s, over 5 s")
    legend_below(figure, figure.axes[0], 4)
    return figure
