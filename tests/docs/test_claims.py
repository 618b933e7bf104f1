"""What README, paper and pages say in numbers is what the committed results say."""

from __future__ import annotations

import math
import re

import pytest

from eea.study.arms import MINUS
from experiments.pages import pages
from tests.docs import claims_environments, claims_physics
from tests.docs.committed import (
    DOCS,
    ROOT,
    Claim,
    angle_errors,
    cell,
    distance,
    figures,
    gain,
    number,
    percent,
    recovered,
    way,
    wins,
    worse,
)

CM_PER_UNIT = 5.0
TIERS = ("severe", "moderate", "mild")
LEAGUE = "results/league"
HERO = "self-model"
CEILING = [number(f"{LEAGUE}/ceiling.md", tier, "self-model, share") for tier in TIERS]
ORACLES = [number(f"{LEAGUE}/ceiling.md", tier, "oracle, share") for tier in TIERS]
FIN_GAINS = [
    100.0 * (number(path, body, "recurrent, fins") / number(path, body, "recurrent") - 1.0)
    for path in ["results/gaits/ceiling.md"]
    for body in ("whole", "left_pectoral:length=0.5", "caudal:missing")
]
CLAIMS = [
    Claim(
        "README.md",
        "NEAT, its search, is weaker: on the true body it swims {:.0f} cm",
        (CM_PER_UNIT * distance("oracle-neat"),),
    ),
    Claim(
        "paper/paper.md",
        "joint inference finds the body with a mean error of the nine fin sizes of {:.3f} of their "
        "ranges (OBJ_FIT {:.3f}, 95% interval {:.3f} to {:.3f}). The gait for it swims {:.1f} "
        "units (of 5 cm) in 20 s, as far as the gait for the true body and fin angles. The old "
        "gait swims {:.1f} units. The paper's method takes {} trials to an OBJ_FIT of {:.3f}, and "
        "its gait by NEAT swims {:.1f} units; NEAT on the true body reaches {:.1f}.",
        (
            1.0 - recovered("joint-fins", "objective_fitness"),
            recovered("joint-fins", "objective_fitness"),
            *recovered("joint-fins", "spread", "objective_fitness", "interval"),
            distance("joint-fins"),
            distance("undamaged"),
            recovered("out-of-band", "trials"),
            recovered("out-of-band", "objective_fitness"),
            distance("out-of-band"),
            distance("oracle-neat"),
        ),
    ),
    Claim(
        "paper/paper.md",
        "After severe damage the agent swims {:.1f} units, an oracle that is given the truth "
        "{:.1f}, and the same agent without recognition {:.1f}. In the same episodes recognition "
        "is worth {:.1f} units after severe damage, {:.1f} after moderate and {:.1f} after mild "
        "damage.",
        (
            way(HERO, "severe"),
            way("oracle", "severe"),
            way("blind", "severe"),
            *(gain(HERO, tier) for tier in TIERS),
        ),
    ),
    Claim(
        "paper/paper.md",
        "the agent keeps {:.0f}% of its way after severe damage.",
        (number(f"{LEAGUE}/ceiling.md", "severe", "self-model, share"),),
    ),
    Claim(
        "docs/swimming_on.md",
        "Recognising is worth {:.1f} units after severe damage, {:.1f} after moderate and {:.1f} "
        "after mild. The agent is behind blind in {} of 120 episodes. More is hardly to be had: "
        "the oracle gains {:.1f}, {:.1f} and {:.1f}.",
        (
            *(gain(HERO, tier) for tier in TIERS),
            worse(HERO),
            *(gain("oracle", tier) for tier in TIERS),
        ),
    ),
    Claim(
        "docs/swimming_on.md",
        "Without refinement (*library only*) the agent loses {:.1f}, {:.1f} and {:.1f} units. RMA "
        "searches nothing in an episode and is {:.1f}, {:.1f} and {:.1f} units behind the agent",
        (
            *(gain(HERO, tier, "self-model, library only") for tier in TIERS),
            *(gain(HERO, tier, "RMA") for tier in TIERS),
        ),
    ),
    Claim(
        "docs/swimming_on.md",
        "The agent keeps {:.0f}% of the ceiling's way after severe damage, and {:.0f}% or more "
        "after moderate and mild. What is left is not recognition: the oracle keeps {:.0f}% to "
        "{:.0f}%.",
        (CEILING[0], math.floor(min(CEILING[1:])), min(ORACLES), max(ORACLES)),
    ),
    Claim(
        "docs/swimming_on.md",
        "the agent keeps {:.0f}% of the oracle's pace, and is right in {} episodes",
        (
            100.0 * number(f"{LEAGUE}/three-faults.md", "three faults", "pace, of the oracle's"),
            cell(f"{LEAGUE}/three-faults.md", "three faults", "right"),
        ),
    ),
    Claim(
        "docs/swimming_on.md",
        "right in {}. They leave {:.0%} of the pace that the same fault leaves after 15 s.",
        (
            cell(f"{LEAGUE}/early.md", "early", "right"),
            number(f"{LEAGUE}/early.md", "early", "pace, units/s")
            / number(f"{LEAGUE}/early.md", "after 15 s", "pace, units/s"),
        ),
    ),
    Claim(
        "docs/swimming_on.md",
        "**A current that begins**: found within 0.03 units/s in {} episodes",
        (cell(f"{LEAGUE}/current-begins.md", "current begins", "right"),),
    ),
    Claim(
        "docs/swimming_on.md",
        "the agent gains {:.1f} units over blind and keeps {:.0f}% of the oracle's pace",
        (
            number(f"{LEAGUE}/held-out.md", "blind", "lost, held-out")
            - number(f"{LEAGUE}/held-out.md", HERO, "lost, held-out"),
            100.0
            * number(f"{LEAGUE}/held-out-recognition.md", "held-out", "pace, of the oracle's"),
        ),
    ),
    Claim(
        "docs/swimming_on.md",
        "after severe damage the agent returns in time in {:g}% of the episodes, blind in {:g}%",
        tuple(number(f"{LEAGUE}/return.md", who, "success, severe") for who in (HERO, "blind")),
    ),
    Claim(
        "docs/swimming_on.md",
        "{:.2f} units after severe damage in MuJoCo's box water, {:.2f} with added mass, {:.2f} "
        "among vortices",
        tuple(
            number(f"{LEAGUE}/waters-severe.md", HERO, water)
            for water in ("mujoco", "reactive", "vortices")
        ),
    ),
    Claim(
        "docs/swimming_on.md",
        "with unknown fin angles recognising is worth {:.2f} units after severe damage, with the "
        "gyroscope alone {:.2f}.",
        tuple(
            number(f"{LEAGUE}/{table}.md", HERO, "gain over blind, severe")
            for table in ("imu", "gyroscope")
        ),
    ),
    Claim(
        "docs/gaits.md",
        "It swims {:.0f}% farther than a gait evolved for any damage and {:.0f}% farther than the "
        "old gait, in ten of ten damages each.",
        (percent("joint-fins", "randomised"), percent("joint-fins", "undamaged")),
    ),
    Claim(
        "docs/gaits.md",
        "the gain over the gait for any damage is {:.0f}%, in nine of ten",
        (percent("joint", "randomised"),),
    ),
    Claim(
        "docs/gaits.md",
        "makes {:.0f}% more in the 20 s after the damage than the gait for the true body",
        (percent("swims-on", "oracle-fins"),),
    ),
    Claim(
        "docs/gaits.md",
        "takes {:.0f} hours of swimming",
        (recovered("direct", "trials") * 20.0 / 3600.0,),
    ),
    Claim(
        "docs/gaits.md",
        "The paper's method keeps {:.0f}% of the distance of its own oracle",
        (100.0 + percent("out-of-band", "oracle-neat"),),
    ),
    Claim(
        "docs/gaits.md",
        "add {:.0f} to {:.0f}% to a recurrent network",
        (min(FIN_GAINS), max(FIN_GAINS)),
    ),
    Claim(
        "docs/results.md",
        "{:.3f}, {:.3f}, {:.3f} and {:.3f} at 128, 256, 512 and 1024 steps",
        tuple(figures("ideal", steps) for steps in (128, 256, 512, 1024)),
    ),
    Claim(
        "docs/results.md",
        "**Out-of-Band is better than in the paper**, {:.3f} instead of about 0.90.",
        (figures("out-of-band", 128, 256, 512, 1024),),
    ),
    Claim(
        "docs/results.md",
        "Out-of-Band infers the angles to {:.0f} to {:.0f} degrees, In-Band to {:.0f} to {:.0f}.",
        (
            angle_errors("out-of-band")[0],
            angle_errors("out-of-band")[-1],
            angle_errors("in-band")[0],
            angle_errors("in-band")[-1],
        ),
    ),
    *claims_environments.CLAIMS,
    *claims_physics.CLAIMS,
]


def plain(text: str) -> str:
    """Return a page's text in one line."""
    return " ".join(text.split())


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda c: f"{c.page}: {c.sentence[:40]}")
def test_a_page_claims_what_was_measured(claim: Claim) -> None:
    assert plain(claim.written()) in plain((ROOT / claim.page).read_text(encoding="utf-8"))


#: What README and paper say of methods, not of results.
SETTINGS = {"2.56", "0.01", "95%", "0.05"}


@pytest.mark.parametrize(
    ("page", "begin", "end"),
    [("README.md", "## Does it recover?", "## Where to go"), ("paper/paper.md", "# Summary", "")],
)
def test_every_number_is_claimed(page: str, begin: str, end: str) -> None:
    """A number with decimals or a share that no claim has is not compared with anything."""
    text = (ROOT / page).read_text(encoding="utf-8").partition(begin)[2]
    if end:
        text = text.partition(end)[0]
    text = plain(re.sub(r"<!-- make pages:.*?<!-- end -->|`[^`]*`", "", text, flags=re.DOTALL))
    for claim in CLAIMS:
        text = text.replace(plain(claim.written()), "")
    assert set(re.findall(r"\d+\.\d+|\d+%", text)) <= SETTINGS


def test_every_interval_that_the_results_quote_is_in_a_summary() -> None:
    number = rf"[{MINUS}+]?\d\.\d+"
    quoted = re.findall(
        rf"({number}) \[({number}), ({number})\]", (DOCS / "results.md").read_text()
    )
    summary = (DOCS / "results" / "figs-5-to-10" / "summary.md").read_text().replace("+", "")
    assert len(quoted) >= 10
    for mean, low, high in quoted:
        interval = rf"\[{low}, {high}\]"
        assert re.search(rf"{mean} {interval}|\| {mean} \| [^|]*\| {interval}", summary), mean


def test_gaits_win_as_often_as_the_page_says() -> None:
    """Of docs/gaits.md: ten of ten, nine of ten, none of ten."""
    assert wins("joint-fins", "randomised") == wins("joint-fins", "undamaged") == 10
    assert wins("joint", "randomised") == 9


FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
NAMED = re.compile(r"\bcommits? `?[0-9a-f]{7,40}\b")
#: A commit, as ``git log`` abbreviates one: digits and letters.
COMMIT = re.compile(r"(?<![\w.#/-])(?=[0-9a-f]*\d)(?=[0-9a-f]*[a-f])[0-9a-f]{7,40}(?![\w.])")


def test_prose_has_no_commit() -> None:
    """Where each result comes from stands on docs/provenance.md."""
    found = []
    for page in pages():
        if page.name != "provenance.md":
            text = FENCE.sub("", page.read_text(encoding="utf-8"))
            found += [f"{page.relative_to(ROOT)}: {one}" for one in COMMIT.findall(text)]
            found += [f"{page.relative_to(ROOT)}: {one}" for one in NAMED.findall(text)]
    assert found == []


def test_a_commit_in_prose_is_found() -> None:
    for said in ("at commit 96bd305 or earlier", "of 7b9410a,", "(e2c1527c)", "**0953460b**"):
        assert COMMIT.search(said) or NAMED.search(said), said
    for said in ("1.0e+09", "20000000", "defaced", "a fin of 0.25", "episodes 1234567", "#a1b2c3d"):
        assert not COMMIT.search(said), said
