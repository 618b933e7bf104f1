"""The words of damage: each changes a robot, and whoever speaks of damage knows or omits it."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from aquafish.online.hypotheses import FIRST_NUMBERS, NUMBERED, searched_range
from aquafish_gym.damage import TIERS, Chance, Damage, Fault, Tier
from aquafish_gym.damage.words import (
    CHANNEL_WORDS,
    PARTS,
    PHRASES,
    RANDOM,
    Range,
    needs_number,
)
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.plans.plan import SIZES
from aquafish_gym.runs.command_line import AnyDamage, EpisodeDamage
from aquafish_gym.scenario import CHANNELS, Scenario
from aquafish_gym.utils.validation import InvalidArgumentError
from eea.fish.hypotheses import FIN_FAULTS

PAGE = Path(__file__).parents[1] / "docs/environments/damage.md"
#: Who speaks of damage -> the words about fins that it knows, and those that it leaves out.
SPEAKERS = {
    # It infers sizes under every hypothesis; an entangled fin is a wider one, a scaled servo a weak
    # one. EngineTarget refuses late and slow servos.
    "joint inference": ({*SIZES, *FIN_FAULTS}, {"entangled", "scale", "delay", "hold"}),
    # docs/swimming_on.md: other thicknesses and lags are not among its hypotheses. In mid-swim a
    # dead servo is a seized one, and a scaled one is a weak one.
    "recognition": (set(FIRST_NUMBERS), {"thickness", "dead", "scale", "delay", "hold"}),
    "tiers": (
        {chance.word for tier in TIERS.values() for chance in tier.chances} & set(PARTS["caudal"]),
        {"thickness", "scale", "delay", "hold"},
    ),
}


def changed_fields(fault: Fault) -> list[str]:
    """Return the fields in which a fault changes the whole robot."""
    whole = Scenario.create()
    before, after = whole.arrays(), Damage((fault,)).edit(whole).arrays()
    return [
        name
        for name in before
        if name != "faults" and not np.array_equal(before[name], after[name], equal_nan=True)
    ]


@pytest.mark.parametrize(
    ("part", "word"), [(part, word) for part, words in PARTS.items() for word in words]
)
def test_every_word_changes_a_robot_and_its_neutral_number_does_not(part: str, word: str) -> None:
    number = PARTS[part][word]
    assert changed_fields(Fault(part, word, 0.5 if needs_number(number) else None))
    if number is not None and number.neutral is not None and number.low <= number.neutral:
        assert not changed_fields(Fault(part, word, number.neutral))


@pytest.mark.parametrize("speaker", SPEAKERS)
def test_every_word_about_a_fin_is_known_or_left_out(speaker: str) -> None:
    known, omitted = SPEAKERS[speaker]
    assert known.isdisjoint(omitted)
    assert known | omitted == set(PARTS["caudal"])


@pytest.mark.parametrize("tier", TIERS)
def test_tiers_stay_within_the_grammar(tier: str) -> None:
    for chance in TIERS[tier].chances:
        parts = [part for part, words in PARTS.items() if chance.word in words]
        assert parts
        for part in parts:
            number = PARTS[part][chance.word]
            assert not needs_number(number) or number.low <= chance.low < chance.high <= number.high


@pytest.mark.parametrize("word", FIRST_NUMBERS)
def test_recognition_searches_a_part_of_the_grammars_range(word: str) -> None:
    for fin in AQUAFISH.names:
        number = PARTS[fin][word]
        assert needs_number(number) == (word in NUMBERED)
        if needs_number(number):
            low, high = searched_range(word)
            assert number.low < low < high <= number.high
            assert all(low <= first <= high for first in FIRST_NUMBERS[word])
            assert not low <= (number.neutral or 0.0) <= high


def test_help_explains_every_word() -> None:
    text = AnyDamage.__metadata__[0].help  # type: ignore[attr-defined]
    for part, words in PARTS.items():
        assert part in text or part in CHANNELS
        for word, number in words.items():
            form = f"{word}={number.name}" if isinstance(number, Range) else word
            assert re.search(rf"[:, ]{form}[,;. ]", text), form
    for tier in TIERS:
        assert f"{RANDOM}:{tier}" in EpisodeDamage.__metadata__[0].help  # type: ignore[attr-defined]


def test_the_page_about_damage_has_every_word() -> None:
    heading = ""
    tables: dict[str, set[str]] = {}
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if found := re.fullmatch(r"\| (`\w+`.*)?\s*\| (`.*`) \| .+ \|", line):
            part, forms = found.groups()
            heading = part or heading
            words = [form.partition("=")[0] for form in re.findall(r"`([^`]+)`", forms)]
            tables.setdefault(heading.strip(), set()).update(words)
    expected = {
        "`left_pectoral`, `right_pectoral`, `caudal`": PARTS["caudal"],
        "`gyro`": PARTS["gyro"],
        "`up_x` to `gyro_z`": PARTS["up_x"],
        "`random`": TIERS,
        "`action_0`, `action_0-2`, `action`": CHANNEL_WORDS["action"],
        "`observation_3`, `observation_3-5`, `observation`": CHANNEL_WORDS["observation"],
    }
    assert tables == {part: set(words) for part, words in expected.items()}


@pytest.mark.parametrize(
    ("chance", "sentence"),
    [
        (Chance("lenght", 1.0, 0.3, 0.5), "the word of damage random:mine.*did you mean 'length'"),
        (Chance("noise", 1.0, 0.0, 0.1, ("caudal",)), "the word of damage random:mine"),
        (Chance("length", 1.0, 0.3, 0.5, ("codal",)), "did you mean 'caudal'"),
        (Chance("entangled", 1.0, 0.5, 1.5), r"in \[0, 1\]; got 0.5 to 1.5"),
        (Chance("weak", 1.0, 0.9, 0.2), "from a low to a high"),
    ],
)
def test_a_tier_of_faults_that_no_part_can_have_is_refused(
    monkeypatch: pytest.MonkeyPatch, chance: Chance, sentence: str
) -> None:
    monkeypatch.setitem(TIERS, "mine", Tier(1, (chance,)))
    with pytest.raises(InvalidArgumentError, match=sentence):
        Damage.parse("random:mine")


def test_every_word_has_a_phrase_and_no_other_has() -> None:
    assert PHRASES.keys() == {
        word for words in (*PARTS.values(), *CHANNEL_WORDS.values()) for word in words
    }


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        ("none", "nothing is broken"),
        ("left_pectoral:length=0.5", "the left flipper has 50% of its length"),
        (
            "caudal:length=0.45;right_pectoral:missing;caudal:width=0.7",
            "the tail has 45% of its length and 70% of its width and the right flipper is missing",
        ),
        (
            "caudal:length=1.2;caudal:weak=0.404",
            "the tail has 120% of its length and turns at 40% of its speed",
        ),
        (
            "caudal:length=0.998;caudal:weak=0.003",
            "the tail has 99.8% of its length and turns at 0.3% of its speed",
        ),
        ("caudal:seized@6", "the tail is seized from 6 s on"),
        ("caudal:seized=0.5@0+2", "the tail is seized at 0.5 rad from 0 s for 2 s"),
        ("caudal:entangled=0.2", "the tail drags something along"),
        ("gyro_z:bias=0.2@4~3", "gyro_z is off by 0.2 rad/s from 4 s on, growing for 3 s"),
        (
            "gyro:noise=0.02;north_y:dropped",
            "the gyroscope has noise of 0.02 rad/s and north_y gives no readings",
        ),
        (
            "action_0:hold=0.2;observation:noise=3",
            "action_0 changes only every 0.2 s and observation has noise of 3",
        ),
        ("random:mild@2-8", "something mild breaks at a time between 2 and 8 s"),
        ("random:severe", "something severe breaks"),
    ],
)
def test_damage_is_said_in_words(damage: str, words: str) -> None:
    assert Damage.parse(damage).said() == words


def test_a_fish_says_what_is_broken_of_itself() -> None:
    assert Damage.parse("caudal:missing;gyro:delay=0.1").said("my ") == (
        "my tail is missing and my gyroscope is 0.1 s late"
    )
