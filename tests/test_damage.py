"""Damage: text, JSON and bodies agree, and bad descriptions are refused with a sentence."""

from __future__ import annotations

import contextlib
import json
import math
from dataclasses import asdict, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aquafish_gym.damage import (
    CHANNELS,
    TIERS,
    ChannelBias,
    ChannelDropped,
    ChannelStuck,
    Damage,
    Effect,
    Fault,
    FinEntangled,
    FinMissing,
    FinScaled,
    GyroNoise,
    RandomFaults,
    ServoDead,
    ServoGain,
    ServoSeized,
)
from aquafish_gym.envs.course import course_of
from aquafish_gym.morphology import FINS, SIZES, Morphology, change_in_words
from aquafish_gym.utils.validation import InvalidArgumentError, UnknownNameError

fins, channels = st.sampled_from(FINS), st.sampled_from(CHANNELS)
seconds = st.floats(0.0, 1e6)
onsets = st.one_of(
    st.just(0.0), seconds, st.tuples(seconds, seconds).map(lambda two: tuple(sorted(two)))
)
whens = st.fixed_dictionaries({"onset": onsets, "duration": st.none() | st.floats(1e-3, 1e6)})


def at_any_time(*kinds: st.SearchStrategy[Fault]) -> st.SearchStrategy[Fault]:
    """What breaks from the beginning to the end, or at some time for a while."""
    return st.one_of(*kinds) | st.builds(
        lambda f, when: replace(f, **when), st.one_of(*kinds), whens
    )


shrinking = (
    st.builds(FinScaled, fins, st.sampled_from(SIZES), st.floats(0.0, 1.0)),
    st.builds(FinMissing, fins),
)
others = (
    st.builds(FinEntangled, fins, st.floats(0.0, 1.0)),
    st.builds(ServoGain, fins, st.floats(-2.0, 2.0)),
    st.builds(ServoSeized, fins),
    st.builds(ServoDead, fins),
    st.builds(GyroNoise, st.floats(0.0, 100.0)),
    st.builds(ChannelBias, channels, st.floats(-2.0, 2.0)),
    st.builds(ChannelStuck, channels),
    st.builds(ChannelDropped, channels),
    st.builds(RandomFaults, st.sampled_from(list(TIERS))),
)
at_an_angle = st.builds(ServoSeized, fins, st.floats(-math.pi, math.pi))
smaller = st.lists(st.one_of(shrinking), max_size=4).map(lambda f: Damage(tuple(f)))
damages = st.lists(at_any_time(*shrinking, *others) | at_an_angle, max_size=4).map(
    lambda f: Damage(tuple(f))
)


@given(damages)
def test_text_and_json_read_back_exactly(damage: Damage) -> None:
    assert Damage.parse(str(damage)) == damage
    assert Damage.from_json(damage.to_json()) == damage
    assert Damage.coerce(damage.to_list()) == damage
    assert Damage.coerce(json.loads(json.dumps(asdict(damage)))) == damage
    assert Damage.coerce(str(damage)) == damage


@given(smaller)
def test_a_broken_body_is_never_larger(damage: Damage) -> None:
    whole, broken = Morphology.nominal(), damage.apply(Morphology.nominal())
    assert (broken.to_array() <= whole.to_array()).all()
    for fault in damage:
        if isinstance(fault, FinMissing):
            assert getattr(broken, fault.fin) == (0.0, 0.0, 0.0)


def test_each_size_stands_on_its_own_axis() -> None:
    """Width is x for the pectorals and z for the upright tail."""
    nominal = Morphology.nominal()
    assert Damage.parse("left_pectoral:width=0.5").apply(nominal).left_pectoral == (0.2, 1.6, 0.1)
    assert Damage.parse("right_pectoral:thickness=0").apply(nominal).right_pectoral[2] == 0.0
    assert Damage.parse("caudal:width=0.5").apply(nominal).caudal == (0.4, 1.4, 0.3)
    assert Damage.parse("caudal:thickness=0.5").apply(nominal).caudal == (0.2, 1.4, 0.6)


def test_several_faults_join_in_any_form() -> None:
    expected = Damage((FinScaled("left_pectoral", "length", 0.5), FinMissing("caudal")))
    assert Damage.parse(" left_pectoral : length = .5 , caudal:missing") == expected
    assert Damage.coerce(list(expected.faults)) == expected
    assert Damage.coerce([expected.faults[0], {"kind": "FinMissing", "fin": "caudal"}]) == expected
    assert Damage.coerce(expected.to_list()) == expected
    assert Damage.coerce(expected) is expected
    assert Damage.coerce(None) == Damage.parse("") == Damage.parse("none") == Damage()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("left_pectorl:length=0.5", "did you mean 'left_pectoral'"),
        ("caudal:lenght=0.5", "did you mean 'length'"),
        ("caudal:misssing", "did you mean 'missing'"),
        ("caudal", "part:word=number"),
        ("caudal:", "part:word=number"),
        ("caudal:missing;", "part:word=number"),
        ("caudal:missing@", "part:word=number"),
        ("caudal:missing@1@2", "part:word=number"),
        ("caudal:missing@soon", "damage onset needs a number"),
        ("caudal:missing@1+x", "damage duration needs a number"),
        ("caudal:missing@5-2", "the earliest and the latest; got 5 and 2"),
        ("caudal:missing@1e9", r"damage onset must lie in"),
        ("caudal:seized=1@3", "has an angle only from the beginning"),
        ("caudal:seized=4", "damage angle of caudal:seized must lie in"),
        ("caudal:weka=0.5", "did you mean 'weak'"),
        ("caudal:dead=1", "takes no number"),
        ("caudal:weak", "needs a number"),
        ("caudal:weak=3", "damage gain of caudal:weak must lie in"),
        ("caudal:entangled=2", "damage share of caudal:entangled must lie in"),
        ("gyro:noise=-1", "damage gyro:noise must lie in"),
        ("gyro_w:stuck", "did you mean 'gyro_"),
        ("up_x:bias=3", "damage up_x:bias must lie in"),
        ("random:moderat", "did you mean 'moderate'"),
        ("caudal:length", "needs a number"),
        ("caudal:length=", "needs a number"),
        ("caudal:length=half", "needs a number"),
        ("caudal:length=-0.5", "must lie in"),
        ("caudal:length=nan", "must be finite"),
        ("caudal:length=inf", "must be finite"),
        ("caudal:missing=1", "takes no number"),
        ("caudal:missing@4+0", "damage duration must lie in"),
        ("caudal:Missing", "did you mean 'missing'"),
        ("left_pectoral:shortened=0.5", "did you mean 'length=0.5'"),
        ("caudal:oversized", "did you mean 'entangled=0.5'"),
        ("gyro:stuck", "did you mean 'gyro_x:stuck'"),
    ],
)
def test_bad_text_is_refused(text: str, sentence: str) -> None:
    with pytest.raises(InvalidArgumentError, match=sentence):
        Damage.parse(text)


@pytest.mark.parametrize(
    "several", [["caudal:missing"], ["caudal:missing", "none"], [Damage(), Damage()]]
)
def test_what_may_be_several_robots_is_not_joined(several: list[object]) -> None:
    with pytest.raises(InvalidArgumentError, match="must be one robot's, whose faults are joined"):
        Damage.coerce(several)


def test_a_fin_that_outgrows_its_range_is_refused() -> None:
    with pytest.raises(InvalidArgumentError, match=r"left_pectoral.length 3.2.*\[0, 2\]"):
        Damage.parse("left_pectoral:length=2").apply(Morphology.nominal())


@pytest.mark.parametrize("value", [3, 0.5, [3], [["caudal:length=x"]], {"fin": "caudal"}, b"x"])
def test_other_things_are_refused(value: object) -> None:
    with pytest.raises(InvalidArgumentError):
        Damage.coerce(value)


@pytest.mark.parametrize(
    "text",
    ["", "{", "3", "{}", "[3]", '[{"kind": "FinMissing"}]', '[{"kind": "FinMissing", "fin": 3}]',
     '[{"kind": "FinMissing", "fin": "caudal", "more": 1}]', '[{"kind": "FinScalde"}]'],
)  # fmt: skip
def test_bad_json_is_refused(text: str) -> None:
    with pytest.raises(InvalidArgumentError):
        Damage.from_json(text)


@pytest.mark.parametrize(
    "text", [None, 3, "[" * 100_000, "1" * 5000, b"\xff", "{}", '{"caudal": [0, 0, 0]}']
)
def test_what_is_no_json_of_a_body_or_a_damage_is_a_sentence(text: object) -> None:
    for read, name in ((Morphology.from_json, "morphology"), (Damage.from_json, "damage")):
        with pytest.raises(InvalidArgumentError, match=name):
            read(text)  # type: ignore[arg-type]


def test_sizes_of_too_many_digits_are_a_sentence() -> None:
    huge = json.dumps({**Morphology.nominal().to_dict(), "caudal": [10**400, 0, 0]})
    with pytest.raises(InvalidArgumentError, match=r"morphology\.caudal must be numbers"):
        Morphology.from_json(huge)


@given(st.text(max_size=30))
def test_any_text_parses_or_is_refused(text: str) -> None:
    with contextlib.suppress(InvalidArgumentError):
        assert isinstance(Damage.parse(text), Damage)


@pytest.mark.parametrize("factor", [-1.0, math.nan, math.inf, "x", None])
def test_bad_factors_are_refused(factor: object) -> None:
    with pytest.raises(InvalidArgumentError, match="damage factor of caudal:length"):
        FinScaled("caudal", "length", factor)  # type: ignore[arg-type]


def test_unknown_names_are_refused() -> None:
    with pytest.raises(UnknownNameError):
        FinMissing("tail")
    with pytest.raises(InvalidArgumentError, match="made of faults"):
        Damage(("caudal:missing",))  # type: ignore[arg-type]
    with pytest.raises(InvalidArgumentError, match="must be a row of faults"):
        Damage(FinMissing("caudal"))  # type: ignore[arg-type]
    assert isinstance(FinMissing("caudal"), Fault)


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        ("none", "nothing is broken"),
        ("left_pectoral:length=0.5", "left flipper: half its length, 0.80 where it was 1.60"),
        ("caudal:missing", "tail: missing"),
        (
            "right_pectoral:width=0.6;right_pectoral:length=0.25;caudal:length=0",
            "right flipper: a quarter of its length, 0.40 where it was 1.60, 60% of its width, "
            "0.24 where it was 0.40; tail: none of its length, 0.00 where it was 1.40",
        ),
        (
            "left_pectoral:thickness=3",
            "left flipper: 300% of its thickness, 0.30 where it was 0.10",
        ),
        (
            "caudal:missing;caudal:dead;left_pectoral:length=0.5@4+2;up_x:stuck@4+2",
            "tail: missing; servo of the tail: dead; left flipper: half its length, 0.80 where it "
            "was 1.60, from 4 to 6 s; up_x: stuck, from 4 to 6 s",
        ),
        (
            "left_pectoral:reversed@3;right_pectoral:weak=0.4;caudal:seized=0.5;caudal:seized",
            "servo of the left flipper: turns the other way, from 3 s on; servo of the right "
            "flipper: turns at 0.4 times what it is told; servo of the tail: seized at 0.5 rad; "
            "servo of the tail: seized",
        ),
        (
            "gyro:noise=0.02;gyro_y:bias=-0.1;north_z:bias=0.1;up_y:dropped;random:mild@2-8+3",
            "gyro: noise of 0.02 rad/s; gyro_y: says 0.1 rad/s too little; north_z: says 0.1 too "
            "much; up_y: says 0; mild damage that chance decides, from some time between 2 and 8 s "
            "on, for 3 s",
        ),
    ],
)
def test_damage_is_said_in_words(damage: str, words: str) -> None:
    assert Damage.parse(damage).in_words(Morphology.nominal()) == words


@pytest.mark.parametrize("damage", ["caudal:dead", "gyro:noise=0.1", "caudal:missing@0.0+3"])
def test_no_body_has_what_is_not_of_its_sizes_or_does_not_last(damage: str) -> None:
    broken = f"left_pectoral:missing;{damage}"
    with pytest.raises(
        InvalidArgumentError, match=r"must be of its fins' sizes.*; got " + damage[:6]
    ):
        Damage.parse(broken).apply(Morphology.nominal())
    assert Damage.parse(broken).effect(Morphology.nominal()).body.left_pectoral == (0, 0, 0)


def test_an_estimate_within_the_tolerance_is_no_damage() -> None:
    whole = Morphology.nominal()
    near = Morphology.coerce({"left_pectoral": (0.4, 0.79, 0.1), "caudal": (0.4, 1.45, 0.6)})
    assert change_in_words(whole, near, tolerance=0.05) == (
        "left flipper: half its length, 0.79 where it was 1.60"
    )
    assert change_in_words(whole, near).endswith("tail: 104% of its length, 1.45 where it was 1.40")
    grown = Morphology.coerce({"caudal": (0.0, 0.0, 0.0)})
    assert change_in_words(grown, whole).count("instead of none") == 3


def test_a_body_reads_back_from_its_json_exactly() -> None:
    body = Damage.parse("caudal:width=0.3").apply(Morphology.nominal())
    assert Morphology.from_json(body.to_json()) == body


def test_what_happens_at_sea_is_one_fault_or_two_in_different_fins() -> None:
    drawn = [Damage.random(np.random.default_rng(seed)) for seed in range(300)]
    assert {len(damage) for damage in drawn} == {1, 2}
    for damage in drawn:
        assert len({fault.fin for fault in damage}) == len(damage)
        body, healthy = damage.apply(Morphology.nominal()).to_array(), Morphology.nominal()
        assert (body <= healthy.to_array()).all()
        assert (body != healthy.to_array()).any()
        assert Damage.parse(str(damage)) == damage
    missing = np.mean([isinstance(fault, FinMissing) for damage in drawn for fault in damage])
    assert missing == pytest.approx(0.25, abs=0.06)
    assert {fault.fin for damage in drawn for fault in damage} == set(FINS)
    again = Damage.random(np.random.default_rng(3))
    assert again == drawn[3]


NOMINAL = Morphology.nominal()


def effect(text: str) -> Effect:
    return Damage.parse(text).effect(NOMINAL)


def test_each_word_says_what_the_robot_is() -> None:
    assert effect("none") == Effect(NOMINAL)
    robot = effect("left_pectoral:weak=0.5;left_pectoral:weak=0.5;right_pectoral:reversed")
    assert (robot.gains, robot.faults, robot.body) == ((0.25, -1.0, 1.0), 3, NOMINAL)
    robot = effect("left_pectoral:seized;right_pectoral:seized=1.5;caudal:dead")
    assert (robot.gains, robot.stands) == ((0.0,) * 3, (None, 1.5, "anywhere"))
    assert effect("gyro:noise=0.03;gyro:noise=0.04").noise == pytest.approx(0.05)
    robot = effect("gyro_y:bias=0.2;gyro_y:bias=-0.05;up_x:stuck;north_z:dropped")
    rows = zip(robot.biases, robot.stuck, robot.dropped, strict=True)
    told = dict(zip(CHANNELS, rows, strict=True))
    assert told.pop("gyro_y") == (pytest.approx(0.15), False, False)
    assert (told.pop("up_x"), told.pop("north_z")) == ((0.0, True, False), (0.0, False, True))
    assert set(told.values()) == {(0.0, False, False)}


def test_what_hangs_on_a_fin_makes_it_wider_within_its_range() -> None:
    assert effect("left_pectoral:entangled=0.5").body.left_pectoral == (0.7, 1.6, 0.1)
    assert effect("caudal:entangled=1").body.caudal == (0.4, 1.4, 1.0)


@given(damages)
def test_what_is_drawn_leaves_nothing_to_chance_and_has_a_time(damage: Damage) -> None:
    drawn = damage.drawn(np.random.default_rng(0))
    assert not drawn.is_random
    assert drawn.drawn(np.random.default_rng(1)) is drawn
    assert drawn == damage.drawn(np.random.default_rng(0))
    assert all(fault.span[0] < fault.span[1] for fault in drawn)


def test_what_is_left_to_chance_must_be_drawn() -> None:
    for text, sentence in (
        ("random:mild", "random:mild is left"),
        ("caudal:dead@1-2", "its onset"),
    ):
        with pytest.raises(InvalidArgumentError, match=f"{sentence}.* draw it first"):
            course_of(Damage.parse(text), NOMINAL, 0.05)
    with pytest.raises(InvalidArgumentError, match="draw it first"):
        Damage.parse("random:mild").apply(NOMINAL)


@pytest.mark.parametrize("tier", TIERS)
def test_a_tier_draws_what_its_table_says(tier: str) -> None:
    count, chances = TIERS[tier]
    assert sum(chance.weight for chance in chances) == pytest.approx(1.0)
    damage, rng = Damage.parse(f"random:{tier}@2-8+3"), np.random.default_rng(0)
    drawn = [damage.drawn(rng) for _ in range(1000)]
    seen: dict[str, list[float]] = {chance.word: [] for chance in chances}
    for one in drawn:
        assert len(one) == count
        assert len({str(fault).partition(":")[0] for fault in one}) == count
        assert {fault.span for fault in one} == {one.faults[0].span}
        assert 2.0 <= one.faults[0].span[0] <= 8.0
        one.effect(NOMINAL)  # fits
        for fault in one:
            word, _, number = fault.what.partition(":")[2].partition("=")
            seen[word].append(abs(float(number)) if number else 0.0)
    for chance in chances:
        numbers = seen[chance.word]
        assert len(numbers) / (1000 * count) == pytest.approx(chance.weight, abs=0.04)
        assert chance.low <= min(numbers)
        assert max(numbers) <= chance.high
