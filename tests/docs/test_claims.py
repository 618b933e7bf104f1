"""What README, paper and pages say in numbers is what the committed results say."""

from __future__ import annotations

import re
import runpy
import sys

import pytest

from aquafish.recovery.report import shown_replicate
from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from eea.core.fitness import chance_level, mid_range_level, objective_fitness
from eea.fish import fish_problem
from experiments.pages import pages
from tests.docs import claims_environments, claims_league, claims_methods, claims_physics
from tests.docs.committed import (
    HERO,
    ROOT,
    TIERS,
    WORDS,
    Claim,
    distance,
    document,
    gain,
    number,
    percent,
    recovered,
    way,
)

CM_PER_UNIT = 5.0
LEAGUE = "results/league"
WHOLE = Morphology.nominal()
HALF_A_FLIPPER = Damage.parse("left_pectoral:length=0.5").body(WHOLE).to_array()
SIZES = fish_problem().models
CLAIMS = [
    Claim(
        "CONTRIBUTING.md",
        "On the robot with half a flipper a random body scores {:.2f}, a body in the middle of the "
        "ranges {:.2f}, the undamaged body {:.2f}",
        (
            chance_level(HALF_A_FLIPPER, SIZES),
            mid_range_level(HALF_A_FLIPPER, SIZES),
            float(objective_fitness(WHOLE.to_array(), HALF_A_FLIPPER, SIZES)),
        ),
    ),
    Claim(
        "docs/gallery.md",
        "`aquafish recover --held-out --seed {}` with the extra `film` makes this replicate alone",
        (shown_replicate(document("recovery/report.json")["replicates"]),),
    ),
    Claim(
        "README.md",
        "NEAT, its search, is weaker: on the true body it swims {:.0f} cm",
        (CM_PER_UNIT * distance("oracle-neat"),),
    ),
    Claim(
        "paper/paper.md",
        "joint inference finds the body with a mean error of the nine fin sizes of {:.3f} of their "
        "ranges (OBJ_FIT {:.3f}, 95% interval {:.3f} to {:.3f}). The gait for it swims {:.1f} "
        "units (of 5 cm) in 20 s, {:.0f}% as far as the gait for the true body and fin angles. The "
        "old gait swims {:.1f} units. The paper's method takes {} trials to an OBJ_FIT of {:.3f}, "
        "and its gait by NEAT swims {:.1f} units; NEAT on the true body reaches {:.1f}.",
        (
            1.0 - recovered("joint-fins", "objective_fitness"),
            recovered("joint-fins", "objective_fitness"),
            *recovered("joint-fins", "spread", "objective_fitness", "interval"),
            distance("joint-fins"),
            100.0 + percent("joint-fins", "oracle-fins"),
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
    *claims_environments.CLAIMS,
    *claims_league.CLAIMS,
    *claims_methods.CLAIMS,
    *claims_physics.CLAIMS,
]


def plain(text: str) -> str:
    """Return a page's text in one line."""
    return " ".join(text.split())


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda c: f"{c.page}: {c.sentence[:40]}")
def test_a_page_claims_what_was_measured(claim: Claim) -> None:
    assert plain(claim.written()) in plain((ROOT / claim.page).read_text(encoding="utf-8"))
    assert claim.holds, claim.written()


#: Pages of which every number is compared, from a heading to another one, and the numbers that
#: they say of methods, not of results.
COMPARED: dict[str, tuple[str, str, set[str]]] = {
    "README.md": ("## Does it recover?", "## Where to go", {"0.01", "95%"}),
    "paper/paper.md": ("# Summary", "", {"2.56"}),
    "CONTRIBUTING.md": ("# ", "", {"0.1", "0.5", "3.11"}),  # versions, and the range of a command
    "docs/design.md": ("# ", "", {"5.12"}),
    "docs/gallery.md": ("# ", "", {"1.2"}),  # the second of a picture
    "docs/index.md": ("# ", "", set()),
    "docs/provenance.md": ("# ", "", set()),
    **{
        page: ("# ", "", settings)
        for group in (claims_environments, claims_league, claims_methods, claims_physics)
        for page, settings in group.SETTINGS.items()
    },
}
COUNTS = "|".join(WORDS)
NUMBER = rf"\d+\.\d+|\d+%|\d+ of \d+|(?:{COUNTS}) of (?:{COUNTS})"
#: What other tests look at: tables that are filled, code, and where links lead.
CUT = re.compile(
    r"<!-- make pages:.*?<!-- end -->|^```.*?^```$|`[^`]*`|\]\([^)]*\)", re.DOTALL | re.MULTILINE
)


@pytest.mark.parametrize("page", COMPARED)
def test_every_number_is_claimed(page: str) -> None:
    """A number with decimals, a share or a count that no claim has is compared with nothing."""
    begin, end, settings = COMPARED[page]
    text = (ROOT / page).read_text(encoding="utf-8").partition(begin)[2]
    if end:
        text = text.partition(end)[0]
    text = plain(CUT.sub("", text))
    for claim in (one for one in CLAIMS if one.page == page):
        text = text.replace(plain(CUT.sub("", claim.written())), "")
    assert sorted(set(re.findall(NUMBER, text))) == sorted(settings)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_methods_compare_as_the_page_of_inference_says(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["compare_conditions"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(ROOT / "examples" / "compare_conditions.py"), run_name="__main__")
    assert ended.value.code == 0
    printed = capsys.readouterr().out
    row = r"^[│|] `?([a-z-]+)\b.*?([01]\.\d{3}) [│|] ([01]\.\d{3}) "
    found = set(re.findall(row, printed, re.MULTILINE))
    assert len(found) == 6
    page = (ROOT / "docs" / "inference.md").read_text(encoding="utf-8")
    assert set(re.findall(row, page, re.MULTILINE)) == found
    levels = re.findall(r"│ +(0\.\d{3}) │ +(0\.\d{3}) │$", printed, re.MULTILINE)[0]
    assert f"a random body | {levels[0]} |" in page
    assert f"middle of all ranges | {levels[1]} |" in page


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
