"""What the pages of the paper's experiments, of gaits and of the reality gap say in numbers."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import mean
from typing import Any

from eea.study.arms import MINUS
from experiments.reality_gap.report import LEAST_DISTANCE
from experiments.results import read_records
from tests.docs.committed import (
    Claim,
    angle_errors,
    distance,
    document,
    figures,
    number,
    percent,
    recovered,
    rows,
    wins,
    word,
)

RESULTS = "docs/results.md"
GAITS = "docs/gaits.md"
GAP = "docs/reality_gap.md"
STUDY = "results/figs-5-to-10/summary.json"
STEPS = (128, 256, 512, 1024)
CEILING = "results/gaits/ceiling.md"
DAMAGES = "results/gaits/damages.md"
SAMPLE = "results/gaits/sample.md"
BODIES = [row[0] for row in rows(CEILING)[1:]]
SEARCHES = rows(CEILING)[0][1:]
FIN_GAINS = [
    100.0 * (number(CEILING, body, "recurrent, fins") / number(CEILING, body, "recurrent") - 1.0)
    for body in BODIES
]
REPLICATES = len(document("recovery/report.json")["seeds"])
JOINT_BY_WORLD = {
    one["world"]: one for one in document("gap/report.json")["summary"] if one["method"] == "joint"
}
GAP_SETTINGS = document("gap/report.json")["settings"]
HEALTHY = [number(CEILING, "whole", search) for search in SEARCHES]


def memory_wins(table: str) -> int:
    """Return on how many bodies a network with memory swims farther than one without."""
    bodies = [row[0] for row in rows(table)[1:]]
    return sum(number(table, body, "recurrent") > number(table, body, "mlp") for body in bodies)


def tail_alone(treatment: str) -> float:
    """Return how far a treatment of the case study swims where the tail alone is broken."""
    swims = zip(
        recovered(treatment, "spread", "target_distance_random_poses", "values"),
        document("recovery/report.json")["replicates"][treatment],
        strict=True,
    )
    return mean(distance for distance, row in swims if "pectoral" not in row["damage"])


def paired(first: str, second: str, *durations: int) -> dict[str, Any]:
    """Return how much better a condition of the paper's figures is in the last round."""
    (found,) = (
        one["last_round"]
        for one in document(STUDY)["paired"]
        if (one["first"], one["second"]) == (first, second)
        and one["durations"] == list(durations or STEPS)
    )
    return dict(found)


def with_interval(first: str, second: str) -> list[str]:
    """Return the mean of a paired difference and the ends of its interval."""
    found = paired(first, second)
    return [f"{x:.3f}".replace("-", MINUS) for x in (found["mean"], *found["interval"])]


def size_errors(arm: str, size: str) -> list[float]:
    """Return the sorted errors of a size of each fin, as shares of its range."""
    found = document(STUDY)["dimension_error"][arm]
    return sorted(one["mean"] for name, one in found.items() if name.endswith(f".{size}"))


def inferred(arm: str) -> dict[str, Sequence[bool]]:
    """Return of each size whether it is inferred better than guessed, fin by fin."""
    found = document(STUDY)["dimension_error"][arm]
    return {
        size: [one["better_than_guessing"] for name, one in found.items() if name.endswith(size)]
        for size in ("length", "width", "thickness")
    }


def rise(arm: str) -> float:
    """Return the lower end of the interval of a condition's rise in the last rounds."""
    (found,) = (
        one["rise"]["interval"][0]
        for one in document(STUDY)["fitness"]
        if one["arm"] == arm and one["durations"] == list(STEPS)
    )
    return float(found)


ORDER = [("ideal", "out-of-band"), ("out-of-band", "in-band"), ("in-band", "none")]
MORE = paired("out-of-band-100", "out-of-band")

#: The numbers that each page says of methods, of the paper, or of statistics.
SETTINGS: dict[str, set[str]] = {
    RESULTS: set(),
    GAITS: {"0.1"},
    GAP: {"0.01", "0.90", "90%", "95%"},
}
CLAIMS = [
    Claim(
        GAITS,
        "The healthy robot swims between {:.0f} and {:.0f} units in 20 s",
        (min(HEALTHY), max(HEALTHY)),
    ),
    Claim(
        GAITS,
        "swims farther than NEAT on these three bodies, in less time",
        (),
        all(number(CEILING, body, "recurrent") > number(CEILING, body, "NEAT") for body in BODIES)
        and number("results/gaits/ceiling-times.md", "CPU s a gait", "recurrent")
        < number("results/gaits/ceiling-times.md", "CPU s a gait", "NEAT"),
    ),
    Claim(
        GAITS,
        "then does as well.",
        (),
        all(
            number(CEILING, body, "mlp, fins") > 0.95 * number(CEILING, body, "recurrent, fins")
            for body in BODIES
        ),
    ),
    Claim(
        GAITS,
        "recurrent network swims farther than the feed-forward one on {} of these three bodies, "
        "and on {} of the ten below.",
        (word(memory_wins(CEILING)), word(memory_wins(DAMAGES))),
    ),
    Claim(
        GAITS,
        "**Losing the tail helps**",
        (),
        all(
            number(CEILING, "caudal:missing", search) > number(CEILING, "whole", search)
            for search in SEARCHES
        ),
    ),
    Claim(
        GAITS,
        "Shorter flippers on both sides cost most",
        (),
        min(rows(DAMAGES)[1:], key=lambda row: float(row[-1]))[0].count("pectoral:length") == 2,
    ),
    Claim(
        GAITS,
        "where both flippers are whole, the old gait is on average nearly as good as a new one. "
        "Self-modelling pays there only with known fin angles.",
        (),
        tail_alone("undamaged") > 0.9 * tail_alone("joint")
        and tail_alone("joint-fins") > 1.1 * tail_alone("undamaged"),
    ),
    Claim(
        GAITS,
        "{} trials determine the body to about {:.0%} of its ranges",
        (
            word(recovered("joint-fins", "trials")).capitalize(),
            1.0 - recovered("joint-fins", "objective_fitness"),
        ),
    ),
    Claim(
        GAITS,
        "A sample does not pay here",
        (),
        number(SAMPLE, "0.1|fifty draws", "mean")
        < 1.02 * number(SAMPLE, "0.1|the median body", "mean"),
    ),
    Claim(
        GAITS,
        "{} trials give a gait that swims {:.0f}% as far as a gait for the truth. It swims {:.0f}% "
        "farther than a gait evolved for any damage and {:.0f}% farther than the old gait, in {} "
        "of {} damages each.",
        (
            word(recovered("joint-fins", "trials")),
            100.0 + percent("joint-fins", "oracle-fins"),
            percent("joint-fins", "randomised"),
            percent("joint-fins", "undamaged"),
            word(wins("joint-fins", "randomised")),
            word(REPLICATES),
        ),
        wins("joint-fins", "randomised") == wins("joint-fins", "undamaged"),
    ),
    Claim(
        GAITS,
        "the gain over the gait for any damage is {:.0f}%, in {} of {}.",
        (percent("joint", "randomised"), word(wins("joint", "randomised")), word(REPLICATES)),
    ),
    Claim(
        GAITS,
        "makes {:.0f}% more in the 20 s after the damage than the gait for the true body",
        (percent("swims-on", "oracle-fins"),),
    ),
    Claim(
        GAITS,
        "takes {:.0f} hours of swimming and reaches the gait of joint inference in {} of {}.",
        (
            recovered("direct", "trials") * 20.0 / 3600.0,
            word(sum(hours is not None for hours in recovered("direct", "robot_hours"))),
            word(REPLICATES),
        ),
    ),
    Claim(
        GAITS,
        "The paper's method keeps {:.0f}% of the distance of its own oracle, and is still no "
        "better than the old gait",
        (100.0 + percent("out-of-band", "oracle-neat"),),
        distance("out-of-band") < distance("undamaged"),
    ),
    Claim(
        GAITS,
        "add {:.0f} to {:.0f}% to a recurrent network",
        (min(FIN_GAINS), max(FIN_GAINS)),
    ),
    Claim(
        RESULTS,
        "They take {:.1f} core-hours",
        ((read_records()["figures"].cpu_minutes or 0.0) / 60.0,),
    ),
    Claim(
        RESULTS,
        "in each of {} replicates on average and at each duration, with every paired interval "
        "excluding zero. Out-of-Band is {} [{}, {}] above In-Band, and rises to the end.",
        (paired("ideal", "out-of-band")["replicates"], *with_interval("out-of-band", "in-band")),
        all(paired(*pair)["wins"] == paired(*pair)["replicates"] for pair in ORDER)
        and all(paired(*pair, one)["interval"][0] > 0.0 for pair in ORDER for one in STEPS)
        and rise("out-of-band") > 0.0,
    ),
    Claim(
        RESULTS,
        "ends worse than a random body at every duration",
        (),
        all(figures("none", one) < document(STUDY)["guesses"]["random bodies"] for one in STEPS),
    ),
    Claim(
        RESULTS,
        "over the same {} seeds {} [{}, {}] above 25 models, better in {} of {} (sign test p = "
        "{:.2f}).",
        (
            word(MORE["replicates"]),
            *with_interval("out-of-band-100", "out-of-band"),
            MORE["wins"],
            MORE["replicates"],
            MORE["sign_test_p"],
        ),
        MORE["interval"][0] > 0.0,
    ),
    Claim(
        RESULTS,
        "**In-Band gains twice as much over None**: {} [{}, {}] instead of 0.10 to 0.15.",
        tuple(with_interval("in-band", "none")),
    ),
    Claim(
        RESULTS,
        "**In-Band gains nothing from 200 models**: {} [{}, {}] against 25 models",
        tuple(with_interval("in-band-200", "in-band")),
        paired("in-band-200", "in-band")["interval"][0] < 0.0,
    ),
    Claim(
        RESULTS,
        "Out-of-Band infers lengths best (errors of {:.0f} to {:.0%} of the range) and widths "
        "worst ({:.0f} to {:.0%}), In-Band lengths and thicknesses but not widths",
        tuple(
            error
            for low, *_, high in [size_errors("out-of-band", one) for one in ("length", "width")]
            for error in (100.0 * low, high)
        ),
        size_errors("out-of-band", "thickness")[-1] < size_errors("out-of-band", "width")[-1]
        and all(inferred("in-band")["length"] + inferred("in-band")["thickness"])
        and not any(inferred("in-band")["width"]),
    ),
    Claim(
        RESULTS,
        "{:.3f}, {:.3f}, {:.3f} and {:.3f} at 128, 256, 512 and 1024 steps",
        tuple(figures("ideal", steps) for steps in STEPS),
    ),
    Claim(
        RESULTS,
        "**Out-of-Band is better than in the paper**, {:.3f} instead of about 0.90.",
        (figures("out-of-band", *STEPS),),
    ),
    Claim(
        RESULTS,
        "Out-of-Band infers the angles to {:.0f} to {:.0f} degrees, In-Band to {:.0f} to {:.0f}.",
        (
            angle_errors("out-of-band")[0],
            angle_errors("out-of-band")[-1],
            angle_errors("in-band")[0],
            angle_errors("in-band")[-1],
        ),
    ),
    Claim(
        GAP,
        "Every method infers its body from {} trials of 2.56 s",
        (word(GAP_SETTINGS["eea"]["rounds"]),),
    ),
    Claim(
        GAP,
        "Mean OBJ_FIT of {} replicates after {} trials.",
        (len(document("gap/report.json")["seeds"]), word(GAP_SETTINGS["eea"]["rounds"])),
    ),
    Claim(
        GAP,
        "One world for {} trials",
        (word(document("gap/ten-trials/report.json")["settings"]["eea"]["rounds"]),),
    ),
    Claim(
        GAP,
        "The intervals of joint inference hold {:.0%} to {:.0%},",
        (
            min(one["covered"]["90%"]["mean"] for one in JOINT_BY_WORLD.values()),
            max(one["covered"]["90%"]["mean"] for one in JOINT_BY_WORLD.values()),
        ),
    ),
    Claim(
        GAP,
        "with `substeps-8` it accepts {:.0%} of the fits.",
        (JOINT_BY_WORLD["substeps-8"]["fits"]["mean"],),
        all(
            one["fits"]["mean"] == 1.0
            for name, one in JOINT_BY_WORLD.items()
            if name != "substeps-8"
        ),
    ),
    Claim(
        GAP,
        "by {} generations of NEAT, which often miss a better gait.",
        (GAP_SETTINGS["gait"]["generations"],),
    ),
    Claim(
        GAP,
        "where the lower end of the 95% interval of its mean distance is at least {:g} units",
        (LEAST_DISTANCE,),
    ),
]
