"""What the pages of the agent that swims on say in numbers."""

from __future__ import annotations

import math
from collections import Counter

from scipy.stats import chi2

from aquafish.online import AgentConfig, thresholds
from aquafish.online.gaits import load_library
from aquafish.online.hypotheses import all_hypotheses
from aquafish_gym import AQUAFISH
from experiments.league import ceiling, draws, statistics, waters
from experiments.league.episodes import HELD_OUT, count_damages
from experiments.league.thresholds import EPISODES, documented
from experiments.league.whole import ELSEWHERE, OTHER_WATERS, TABLES
from experiments.results import read_records
from gait.search.templates import Template
from tests.docs.committed import (
    HERO,
    ROOT,
    TIERS,
    Claim,
    cell,
    cells_of,
    document,
    gain,
    number,
    numbers,
    rows,
    word,
    worse,
)

PAGE = "docs/swimming_on.md"
TABLES_PAGE = "docs/league.md"
THRESHOLDS_PAGE = "docs/thresholds.md"
LEAGUE = "results/league"
EARLY = f"{LEAGUE}/early.md"
WORTH = f"{LEAGUE}/thresholds-worth.md"
CEILING = [number(f"{LEAGUE}/ceiling.md", tier, "self-model, share") for tier in TIERS]
ORACLES = [number(f"{LEAGUE}/ceiling.md", tier, "oracle, share") for tier in TIERS]
EVERYTHING = (*TIERS, "none")
AGENT = AgentConfig()
LIBRARY = load_library()


def includes_zero(path: str, row: str, column: str) -> bool:
    """Return whether the interval of a cell includes zero."""
    _, low, high = numbers(path, row, column)
    return low <= 0.0 <= high


def early_share(of_oracle: bool = False) -> float:
    """Return the pace after an early fault as a share of the pace after a later one."""
    early, later = (
        number(EARLY, tier, "pace, units/s")
        / (number(EARLY, tier, "pace, of the oracle's") if of_oracle else 1.0)
        for tier in ("early", "after 15 s")
    )
    return early / later


def episodes_at_home() -> int:
    """Return the number of episodes of the league at home."""
    return sum(document(f"{LEAGUE}/league.json")[HERO][tier]["episodes"] for tier in TIERS)


def false_alarms() -> int:
    """Return the false alarms of the agent at home and in the held-out damages."""
    return sum(
        int(number(f"{LEAGUE}/{table}.md", HERO, "false alarms, all"))
        for table in ("table", "held-out")
    )


def page_rows(page: str, heading: str) -> list[list[str]]:
    """Return the cells of the first table of a page after a heading."""
    text = (ROOT / page).read_text(encoding="utf-8").partition(f"\n{heading}\n")[2]
    lines = text[text.index("\n|") + 1 :].partition("\n\n")[0].splitlines()
    return cells_of(lines)


def without_effect() -> list[str]:
    """Return the thresholds whose half and double change no episode."""
    return [row[0].strip("`") for row in rows(WORTH)[1:] if int(row[2]) == 0 and int(row[4]) == 0]


def bound_change() -> float:
    """Return by how much half of its probability moves an alarm's bound on nine squared errors."""
    usual = thresholds.ALARM_PROBABILITY
    return float(chi2.isf(usual / 2, 9) / chi2.isf(usual, 9)) - 1.0


def pass_minutes() -> float:
    """Return the CPU minutes of the thresholds' episodes with one factor on one threshold."""
    minutes = read_records()["league-thresholds"].cpu_minutes
    assert minutes is not None
    return minutes / (2 * len(rows(WORTH)) - 1)


#: The numbers that each page says of methods.
SETTINGS: dict[str, set[str]] = {
    PAGE: {"0.01", "90%", "95%"},
    TABLES_PAGE: set(),
    THRESHOLDS_PAGE: set(),
}
CLAIMS = [
    Claim(
        PAGE,
        "The filter's squared innovations are summed over {} to {} actions.",
        (min(thresholds.WINDOWS), max(thresholds.WINDOWS)),
    ),
    Claim(
        PAGE,
        "Some {:,} hypotheses",
        (round(sum(len(grid.numbers) for grid in all_hypotheses(AQUAFISH)), -2),),
    ),
    Claim(
        PAGE,
        "after {}, {}, {}, {}, {}, {} and {} observations.",
        AGENT.inferences,
    ),
    Claim(
        PAGE,
        "The {} gaits of a library, a teacher and the last {} refined gaits",
        (len(LIBRARY), word(thresholds.REFINED_GAITS)),
    ),
    Claim(
        PAGE,
        "Every {:g} s the gaits swim in simulation for {:g} s, and one that gains {:.0%} is taken.",
        (thresholds.CHOOSE_AGAIN_SECONDS, thresholds.AHEAD_SECONDS, thresholds.LEAST_GAIN),
    ),
    Claim(
        PAGE,
        "An inference can be used {} s later, and a refinement {} to {} s later. The first one "
        "after a fault is a third of the search, and can be used {} s later.",
        (
            AGENT.inference_seconds,
            AGENT.refinement_seconds,
            AGENT.both_seconds,
            AGENT.quick_seconds,
        ),
    ),
    Claim(
        PAGE,
        "Recognising is worth {:.1f} units after severe damage, {:.1f} after moderate and {:.1f} "
        "after mild. The agent is behind blind in {} of {} episodes. More is hardly to be had: "
        "the oracle gains {:.1f}, {:.1f} and {:.1f}.",
        (
            *(gain(HERO, tier) for tier in TIERS),
            worse(HERO),
            episodes_at_home(),
            *(gain("oracle", tier) for tier in TIERS),
        ),
    ),
    Claim(
        PAGE,
        "Without refinement (*library only*) the agent loses {:.1f}, {:.1f} and {:.1f} units. RMA "
        "searches nothing in an episode and is {:.1f}, {:.1f} and {:.1f} units behind the agent; "
        "it is better than blind after severe damage alone.",
        (
            *(gain(HERO, tier, "self-model, library only") for tier in TIERS),
            *(gain(HERO, tier, "RMA") for tier in TIERS),
        ),
        [tier for tier in TIERS if gain("RMA", tier) > 0.0] == ["severe"],
    ),
    Claim(
        PAGE,
        "CMA-ES searches the {} numbers of a recurrent network in {:.1f} million swims.",
        (
            len(Template.like(LIBRARY[1]).vector(LIBRARY[1])),
            ceiling.POPULATION * sum(count * each for count, each in ceiling.STAGES) / 1e6,
        ),
    ),
    Claim(
        PAGE,
        "The agent keeps {:.0f}% of the ceiling's way after severe damage, and {:.0f}% or more "
        "after moderate and mild. What is left is not recognition: the oracle keeps {:.0f}% to "
        "{:.0f}%.",
        (CEILING[0], math.floor(min(CEILING[1:])), min(ORACLES), max(ORACLES)),
    ),
    Claim(
        PAGE,
        "Two kinds are not solved. What *grows* spans two steps",
        (),
        [
            kind.removeprefix("gain over blind, ")
            for kind in rows(f"{LEAGUE}/outside-blind.md")[0]
            if kind.startswith("gain") and includes_zero(f"{LEAGUE}/outside-blind.md", HERO, kind)
        ]
        == ["growing", "intermittent"],
    ),
    Claim(
        PAGE,
        "the agent keeps {:.0f}% of the oracle's pace, and is right in {} episodes",
        (
            100.0 * number(f"{LEAGUE}/three-faults.md", "three faults", "pace, of the oracle's"),
            cell(f"{LEAGUE}/three-faults.md", "three faults", "right"),
        ),
    ),
    Claim(
        PAGE,
        "right in {}. They leave {:.0%} of the pace that the same fault leaves after 15 s.",
        (cell(EARLY, "early", "right"), early_share()),
    ),
    Claim(
        PAGE,
        "**A current that begins**: found within {} units/s in {} episodes",
        (
            statistics.CURRENT_ERROR,
            cell(f"{LEAGUE}/current-begins.md", "current begins", "right"),
        ),
    ),
    Claim(
        PAGE,
        "**{} held-out damages**: the agent gains {:.1f} units over blind and keeps {:.0f}% of the "
        "oracle's pace",
        (
            count_damages(HELD_OUT),
            number(f"{LEAGUE}/held-out.md", "blind", "lost, held-out")
            - number(f"{LEAGUE}/held-out.md", HERO, "lost, held-out"),
            100.0
            * number(f"{LEAGUE}/held-out-recognition.md", "held-out", "pace, of the oracle's"),
        ),
    ),
    Claim(
        PAGE,
        "after severe damage the agent returns in time in {:g}% of the episodes, blind in {:g}%. "
        "After other damage both always return.",
        tuple(number(f"{LEAGUE}/return.md", who, "success, severe") for who in (HERO, "blind")),
        all(
            number(f"{LEAGUE}/return.md", who, f"success, {tier}") == 100.0
            for who in (HERO, "blind")
            for tier in EVERYTHING[1:]
        ),
    ),
    Claim(
        PAGE,
        "that is {:.2f} units ({:.2f}) at home, on PyBullet, {:.2f} ({:.2f}) in an unknown "
        "current, {:.2f} ({:.2f}) with added mass, {:.2f} ({:.2f}) among vortices and "
        "{:.2f} ({:.2f}) in MuJoCo's box water. With dense fins and more friction its "
        "worth is not certain, "
        "{:.2f} [{:.2f}, {:.2f}] ({:.2f}). In MuJoCo's ellipsoid model no gait of the library "
        "swims forward, and it is worth less than nothing.",
        (
            *(
                number(f"{LEAGUE}/waters-severe.md", who, water)
                for water in ("pybullet", "current", "reactive", "vortices", "mujoco")
                for who in (HERO, "oracle")
            ),
            *numbers(f"{LEAGUE}/waters-severe.md", HERO, "dense"),
            number(f"{LEAGUE}/waters-severe.md", "oracle", "dense"),
        ),
        includes_zero(f"{LEAGUE}/waters-severe.md", HERO, "dense")
        and numbers(f"{LEAGUE}/waters-severe.md", HERO, "mujoco-lift")[2] < 0.0
        and number(f"{LEAGUE}/waters-none.md", "blind", "mujoco-lift") < 0.0,
    ),
    Claim(
        PAGE,
        "with unknown fin angles recognising is worth {:.2f} units after severe damage, with the "
        "gyroscope alone {:.2f}.",
        tuple(
            number(f"{LEAGUE}/{table}.md", HERO, "gain over blind, severe")
            for table in ("imu", "gyroscope")
        ),
    ),
    Claim(
        PAGE,
        "**False alarms**: {} in the {} episodes at home and the {} of held-out damages.",
        (word(false_alarms()), episodes_at_home(), TABLES[HELD_OUT]["episodes"]),
    ),
    Claim(
        TABLES_PAGE,
        "how often {:.0%} of the oracle's pace is back within {:g} s, to stay (*successes*). A "
        "pace is back to stay at t if the mean pace from t to every moment from t + {:g} s on "
        "reaches it.",
        (
            statistics.SUCCESS,
            statistics.HORIZON,
            round(statistics.WINDOW * statistics.DT, 9),
        ),
    ),
    Claim(
        TABLES_PAGE,
        "a library of {} gaits, and two teachers",
        (len(LIBRARY),),
    ),
    Claim(
        TABLES_PAGE,
        "Twenty episodes of each",
        (),
        all(
            cell(f"{LEAGUE}/{table}.md", row, "right").endswith(" of 20")
            for table in ("three-faults", "early", "current-begins")
            for row, *_ in rows(f"{LEAGUE}/{table}.md")[1:]
        ),
    ),
    Claim(
        TABLES_PAGE,
        "An early fault costs the agent {:.0%} and the oracle {:.0%}",
        (1.0 - early_share(), 1.0 - early_share(of_oracle=True)),
    ),
    Claim(
        TABLES_PAGE,
        "A current of {} to {} units/s that begins in still water. *Right* is each of its three "
        "numbers within {} units/s:",
        (draws.FASTEST / 2.0, draws.FASTEST, statistics.CURRENT_ERROR),
    ),
    Claim(
        TABLES_PAGE,
        "{} damages that were frozen before any agent was tried on them",
        (count_damages(HELD_OUT),),
    ),
    Claim(
        TABLES_PAGE,
        "There are {} episodes of a tier; at home {}, and {} if nothing breaks.",
        (ELSEWHERE, TABLES["home"]["episodes"], TABLES["none"]["episodes"]),
        {water for row in page_rows(TABLES_PAGE, "## Other water") for water in row[0].split(", ")}
        == {"water", *rows(f"{LEAGUE}/waters-severe.md")[0][1:]}
        and all(TABLES[water]["episodes"] == ELSEWHERE for water in OTHER_WATERS),
    ),
    Claim(
        TABLES_PAGE,
        "| current | an unknown current of up to {} units/s |",
        (draws.FASTEST,),
    ),
    Claim(
        TABLES_PAGE,
        "up to {} units/s side by side, each {:g} cm wide; the agent lets the current wander |",
        (waters.VORTEX_SPEED, 5.0 * waters.VORTEX_WIDTH),
    ),
    Claim(
        TABLES_PAGE,
        "| dense | {} times the skin friction, fins twice as dense |",
        (word(round(waters.SKIN_FRICTION)),),
    ),
    Claim(
        TABLES_PAGE,
        "The agent does not fit dense fins and more friction. The oracle, which is given the "
        "damage in a model of the usual water, gains after severe damage alone.",
        (),
        all(
            includes_zero(f"{LEAGUE}/waters-{tier}.md", who, "dense")
            for who in (HERO, "oracle")
            for tier in EVERYTHING
            if (who, tier) != ("oracle", "severe")
        )
        and numbers(f"{LEAGUE}/waters-severe.md", "oracle", "dense")[1] > 0.0,
    ),
    Claim(
        TABLES_PAGE,
        "In the ellipsoid model the library's gaits and the teachers swim backward: standing still "
        "is better, and a gait for what broke is worse than blind's.",
        (),
        all(
            number(f"{LEAGUE}/waters-{tier}.md", "still", "mujoco-lift")
            > max(0.0, number(f"{LEAGUE}/waters-{tier}.md", who, "mujoco-lift"))
            for who in ("oracle", "oracle, teacher alone")
            for tier in EVERYTHING
        )
        and all(number(f"{LEAGUE}/waters-{tier}.md", HERO, "mujoco-lift") < 0.0 for tier in TIERS),
    ),
    Claim(
        THRESHOLDS_PAGE,
        "the league's short form: {} short episodes",
        (len(EPISODES),),
    ),
    Claim(
        THRESHOLDS_PAGE,
        "It takes about half a CPU minute for each factor on each threshold",
        (),
        0.3 < pass_minutes() < 0.7,
    ),
    Claim(
        THRESHOLDS_PAGE,
        "{} numbers changed no episode. {} have gone from the code since",
        (
            word(len(without_effect())).capitalize(),
            word(len({*without_effect()} - {one.name for one in documented()})).capitalize(),
        ),
        {row[0].strip("`") for row in page_rows(THRESHOLDS_PAGE, "## Numbers without effect")[1:]}
        == {*without_effect()},
    ),
    Claim(
        THRESHOLDS_PAGE,
        "A factor of two moves the bound on nine squared errors by {:.0%}.",
        (bound_change(),),
    ),
    Claim(
        THRESHOLDS_PAGE,
        "between the {} nodes of most gaits of the library and the {} of the first",
        (Counter(gait.nodes for gait in LIBRARY).most_common(1)[0][0], LIBRARY[0].nodes),
    ),
]
