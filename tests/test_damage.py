"""Damage: text, JSON and bodies agree, and bad descriptions are refused with a sentence."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aquafish_gym import held_out
from aquafish_gym.damage import CHANNELS, TIERS, Chance, Damage, Fault, Tier, edit_each
from aquafish_gym.damage.held_out import lists
from aquafish_gym.damage.words import PARTS, can_grow
from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import AQUAFISH, PLANS
from aquafish_gym.plans.plan import SIZES
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.validation import InvalidArgumentError, UnknownNameError

fins, channels = st.sampled_from(AQUAFISH.names), st.sampled_from(CHANNELS)
seconds = st.floats(0.0, 1e6)
onsets = st.one_of(
    st.just(0.0), seconds, st.tuples(seconds, seconds).map(lambda two: tuple(sorted(two)))
)
whens = st.fixed_dictionaries({"onset": onsets, "duration": st.none() | st.floats(1e-3, 1e6)})
growths = st.none() | st.floats(1e-3, 1e6)


def at_any_time(*kinds: st.SearchStrategy[Fault]) -> st.SearchStrategy[Fault]:
    """What breaks from the beginning to the end, or at some time for a while."""
    return st.one_of(*kinds) | st.builds(timed, st.one_of(*kinds), whens, growths)


def timed(fault: Fault, when: dict[str, Any], growth: float | None) -> Fault:
    grows = fault.part == "random" or can_grow(fault.word, PARTS[fault.part][fault.word])
    return replace(fault, **when, growth=growth if grows else None)


def faults_of(part: str, word: str) -> st.SearchStrategy[Fault]:
    """Return every fault of a part and a word, with any number that it takes."""
    kind = PARTS[part][word]
    if kind is None or kind.optional:
        return st.just(Fault(part, word))
    numbers = st.floats(kind.low, min(kind.high, 1e9))
    return numbers.map(lambda number: Fault(part, word, number))


shrinking = st.one_of(
    *(
        st.builds(Fault, fins, st.just(word), *([st.floats(0.0, 1.0)] * (word != "missing")))
        for word in (*SIZES, "missing")
    )
)
tiers = st.builds(Fault, st.just("random"), st.sampled_from(list(TIERS)))
others = st.one_of(
    tiers, *(faults_of(part, word) for part in ("caudal", "gyro", "up_x") for word in PARTS[part])
)
at_an_angle = st.builds(Fault, fins, st.just("seized"), st.floats(-math.pi, math.pi))
smaller = st.lists(shrinking, max_size=4).map(lambda f: Damage(tuple(f)))
damages = st.lists(at_any_time(shrinking, others) | at_an_angle, max_size=4).map(
    lambda f: Damage(tuple(f))
)


@given(damages)
def test_text_and_json_read_back_exactly(damage: Damage) -> None:
    assert Damage.parse(str(damage)) == damage
    assert Damage.coerce(json.loads(json.dumps(damage.to_list()))) == damage
    assert Damage.coerce(str(damage)) == damage


@given(smaller)
def test_a_broken_body_is_never_larger(damage: Damage) -> None:
    whole, broken = Morphology.nominal(), damage.apply(Morphology.nominal())
    assert (broken.to_array() <= whole.to_array()).all()
    for fault in damage:
        if fault.word == "missing":
            assert getattr(broken, fault.part) == (0.0, 0.0, 0.0)


def test_each_size_stands_on_its_own_axis() -> None:
    """Width is x for the pectorals and z for the upright tail."""
    nominal = Morphology.nominal()
    assert Damage.parse("left_pectoral:width=0.5").apply(nominal).left_pectoral == (0.2, 1.6, 0.1)
    assert Damage.parse("right_pectoral:thickness=0").apply(nominal).right_pectoral[2] == 0.0
    assert Damage.parse("caudal:width=0.5").apply(nominal).caudal == (0.4, 1.4, 0.3)
    assert Damage.parse("caudal:thickness=0.5").apply(nominal).caudal == (0.2, 1.4, 0.6)


def test_several_faults_join_in_any_form() -> None:
    expected = Damage((Fault("left_pectoral", "length", 0.5), Fault("caudal", "missing")))
    assert Damage.parse(" left_pectoral : length = .5 , caudal:missing") == expected
    assert Damage.coerce(list(expected.faults)) == expected
    fin = {"part": "caudal", "word": "missing"}
    assert Damage.coerce([expected.faults[0], fin]) == expected
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
        ("caudal:missing@soon", "part:word=number"),
        ("caudal:missing@1+x", "part:word=number"),
        ("caudal:missing@5-2", "the earliest and the latest; got 5 and 2"),
        ("caudal:missing@1e9", r"damage onset must lie in"),
        ("caudal:seized=1@3", "has an angle only from the beginning"),
        ("caudal:seized=4", "damage caudal:seized must lie in"),
        ("caudal:weka=0.5", "did you mean 'weak'"),
        ("caudal:dead=1", "takes no number"),
        ("caudal:weak", "needs a number"),
        ("caudal:weak=3", "damage caudal:weak must lie in"),
        ("caudal:entangled=2", "damage caudal:entangled must lie in"),
        ("gyro:noise=-1", "damage gyro:noise must lie in"),
        ("gyro_w:stuck", "did you mean 'gyro_"),
        ("up_x:bias=3", "damage up_x:bias must lie in"),
        ("random:moderat", "did you mean 'moderate'"),
        ("caudal:length", "needs a number"),
        ("caudal:length=", "part:word=number"),
        ("caudal:length=half", "part:word=number"),
        ("caudal:length=-0.5", "must lie in"),
        ("caudal:length=nan", "must be finite"),
        ("caudal:length=inf", "must be finite"),
        ("caudal:missing=1", "takes no number"),
        ("caudal:missing@4+0", "damage duration must lie in"),
        ("caudal:weak=0.5@4~0", "damage growth must lie in"),
        ("caudal:weak=0.5~2", "did you mean 'caudal:weak=0.5@0~2'"),
        ("caudal:seized@4~2", "strikes at once: of caudal, length and width and thickness and"),
        ("gyro:delay=1@4~2", "strikes at once: of gyro, noise and scale can grow"),
        ("caudal:Missing", "did you mean 'missing'"),
    ],
)
def test_bad_text_is_refused(text: str, sentence: str) -> None:
    with pytest.raises(InvalidArgumentError, match=sentence):
        Damage.parse(text)


def test_entangled_fin_gains_a_share_of_the_width_it_lacks() -> None:
    before = Morphology.nominal().to_array()
    after = Damage.parse("left_pectoral:entangled=0.25").apply(Morphology.nominal()).to_array()
    assert after[0] == pytest.approx(before[0] + 0.25 * (AQUAFISH.maxima[0] - before[0]))
    np.testing.assert_array_equal(after[1:], before[1:])


def test_a_fin_that_outgrows_its_range_is_refused() -> None:
    with pytest.raises(InvalidArgumentError, match=r"left_pectoral.length 3.2.*\[0, 2\]"):
        Damage.parse("left_pectoral:length=2").apply(Morphology.nominal())


def test_too_many_faults_are_refused_at_once() -> None:
    text = ";".join(["caudal:missing"] * 50_000)
    for value in (
        text,
        [Fault("caudal", "missing")] * 101,
        Damage.parse("gyro:noise=1").to_list() * 101,
    ):
        with pytest.raises(InvalidArgumentError, match="at most 100 faults of one robot; got"):
            Damage.coerce(value)


def test_unknown_parts_and_keys_are_refused() -> None:
    for wrong in (("dorsal", "missing"), ("caudal", "noise"), ("random", "light")):
        with pytest.raises(UnknownNameError):
            Fault(*wrong)
    for written in ({"part": "tail"}, {"part": "caudal", "word": "missing", "more": 1}):
        with pytest.raises(InvalidArgumentError):
            Damage.coerce(written)


@given(st.text(max_size=30))
def test_any_text_parses_or_is_refused(text: str) -> None:
    with contextlib.suppress(InvalidArgumentError):
        assert isinstance(Damage.parse(text), Damage)


@pytest.mark.parametrize("damage", ["caudal:dead", "gyro:noise=0.1", "caudal:missing@0.0+3"])
def test_apply_refuses_faults_that_a_body_cannot_express(damage: str) -> None:
    broken = f"left_pectoral:missing;{damage}"
    with pytest.raises(
        InvalidArgumentError, match=r"must be of its fins' sizes.*; got " + damage[:6]
    ):
        Damage.parse(broken).apply(Morphology.nominal())
    assert Damage.parse(broken).body(Morphology.nominal()).left_pectoral == (0, 0, 0)


def test_random_fins_are_one_or_two_with_one_fault_each() -> None:
    drawn = [Damage.random(np.random.default_rng(seed)) for seed in range(300)]
    assert {len(damage) for damage in drawn} == {1, 2}
    for damage in drawn:
        assert len({fault.part for fault in damage}) == len(damage)
        body, healthy = damage.apply(NOMINAL).to_array(), NOMINAL.to_array()
        assert (body <= healthy).all()
        assert (body != healthy).any()
    missing = np.mean([fault.word == "missing" for damage in drawn for fault in damage])
    assert missing == pytest.approx(0.25, abs=0.06)
    assert Damage.random(np.random.default_rng(3)) == drawn[3]


NOMINAL = Morphology.nominal()


def broken(text: str) -> Scenario:
    return Damage.parse(text).edit(Scenario.create())


def test_faults_edit_their_fields() -> None:
    whole = Scenario.create()
    robot = broken("left_pectoral:weak=0.5;left_pectoral:weak=0.5;right_pectoral:reversed")
    assert robot.servo_gain.tolist() == [[0.25, -1.0, 1.0]]
    assert robot.faults.tolist() == [3]
    assert (robot.body == whole.body).all()
    robot = broken("left_pectoral:seized;right_pectoral:seized=1.5;caudal:dead")
    assert robot.servo_gain.tolist() == [[0.0] * 3]
    np.testing.assert_array_equal(robot.fin_angles, [[0.0, 1.5, np.nan]])
    assert broken("gyro:noise=0.03;gyro:noise=0.04").gyro_noise == pytest.approx(0.05)
    robot = broken("gyro_y:bias=0.2;gyro_y:bias=-0.05;up_x:stuck;north_z:dropped")
    bias = dict(zip(CHANNELS, robot.sensor_bias[0], strict=True))
    assert bias.pop("gyro_y") == pytest.approx(0.15)
    assert not any(bias.values())
    assert np.flatnonzero(robot.sensor_stuck).tolist() == [CHANNELS.index("up_x")]
    assert np.flatnonzero(robot.sensor_dropped).tolist() == [CHANNELS.index("north_z")]
    assert not whole.sensor_bias.any(), "the whole robot stays whole"


def test_a_fault_that_grows_has_its_number_after_the_growth() -> None:
    damage = Damage.parse("gyro_x:bias=0.6@1+2~0.5; caudal:length=0.5@2~0.4; caudal:weak=0.2@0~1")
    scenario = damage.edit(Scenario.create(), hold=20)
    stages = {begin: to or scenario.beginning for begin, _, _, to in scenario.segments(10**6)}

    def each(number: Callable[[Scenario], float]) -> list[float]:
        steps = [max(begin for begin in stages if begin <= step) for step in range(0, 320, 20)]
        return np.round([number(stages[step]) for step in steps], 9).tolist()  # type: ignore[no-any-return]

    bias = each(lambda now: now.sensor_bias[0, CHANNELS.index("gyro_x")])
    assert bias == [0, 0, 0, 0, 0, 0.24, 0.48, *[0.6] * 8, 0]
    whole = NOMINAL.caudal[1]
    length = each(lambda now: now.body[0, 7] / whole)
    assert length == [*[1] * 10, 0.75, *[0.5] * 5]
    gain = each(lambda now: now.servo_gain[0, 2])
    assert gain == [0.84, 0.68, 0.52, 0.36, *[0.2] * 12]


def test_of_random_damage_what_has_a_size_grows() -> None:
    rng = np.random.default_rng(0)
    drawn = [Damage.parse("random:moderate@1~2").sample(rng).faults[0] for _ in range(50)]
    words = {fault.word: fault.growth for fault in drawn}
    assert words["weak"] == words["length"] == 2.0
    assert words["seized"] is None


def test_a_growth_of_too_many_steps_is_refused() -> None:
    damage = Damage.parse("caudal:weak=0.5@1~100")
    with pytest.raises(InvalidArgumentError, match=r"within 1000 steps of 0\.01 s; got 100 s"):
        damage.edit(Scenario.create())


def test_damage_of_a_scenario_with_changes_is_refused() -> None:
    later = Damage.parse("caudal:missing@1").edit(Scenario.create())
    assert Damage().edit(later) is later
    with pytest.raises(InvalidArgumentError, match="scenario must have no changes yet"):
        Damage.parse("left_pectoral:seized").edit(later)
    with pytest.raises(InvalidArgumentError, match="scenario must have no changes yet"):
        edit_each(later, [Damage.parse("left_pectoral:seized")])


@given(damages)
def test_sampled_damage_is_not_random(damage: Damage) -> None:
    drawn = damage.sample(np.random.default_rng(0))
    assert not drawn.is_random
    assert drawn.sample(np.random.default_rng(1)) is drawn
    assert drawn == damage.sample(np.random.default_rng(0))
    assert all(fault.span[0] < fault.span[1] for fault in drawn)


def test_random_damage_must_be_sampled_first() -> None:
    for text, sentence in (
        ("random:mild", "random:mild is left"),
        ("caudal:dead@1-2", "its onset"),
    ):
        with pytest.raises(InvalidArgumentError, match=f"{sentence}.* sample it first"):
            broken(text)
    with pytest.raises(InvalidArgumentError, match="sample it first"):
        Damage.parse("random:mild").apply(NOMINAL)


def test_an_added_tier_is_understood_also_with_lists(monkeypatch: pytest.MonkeyPatch) -> None:
    flippers = ["left_pectoral", "right_pectoral"]
    clipped = Tier(1, [Chance("length", 1.0, 0.3, 0.5, flippers)])  # type: ignore[arg-type]
    monkeypatch.setitem(TIERS, "clipped", clipped)
    rng = np.random.default_rng(0)
    drawn = [Damage.parse("random:clipped").sample(rng).faults[0] for _ in range(20)]
    assert {fault.part for fault in drawn} == set(flippers)
    assert all(0.3 <= fault.number <= 0.5 for fault in drawn)


@pytest.mark.parametrize("weights", [(0.5, 0.4), (1.5, -0.5), (np.nan, 1.0)])
def test_weights_of_a_tier_are_probabilities(
    weights: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    chances = tuple(Chance("missing", weight) for weight in weights)
    monkeypatch.setitem(TIERS, "odd", Tier(1, chances))
    with pytest.raises(InvalidArgumentError, match="the weights of damage random:odd"):
        Damage.parse("random:odd")


@pytest.mark.parametrize("tier", TIERS)
def test_tier_samples_follow_its_table(tier: str) -> None:
    count, chances = TIERS[tier]
    assert sum(chance.weight for chance in chances) == pytest.approx(1.0)
    damage, rng = Damage.parse(f"random:{tier}@2-8+3"), np.random.default_rng(0)
    drawn = [damage.sample(rng) for _ in range(1000)]
    seen: dict[str, list[float]] = {chance.word: [] for chance in chances}
    for one in drawn:
        assert len(one) == count
        assert len({str(fault).partition(":")[0] for fault in one}) == count
        assert {fault.span for fault in one} == {one.faults[0].span}
        assert 2.0 <= one.faults[0].span[0] <= 8.0
        one.edit(Scenario.create())  # fits
        for fault in one:
            seen[fault.word].append(abs(fault.number or 0.0))
    for chance in chances:
        numbers = seen[chance.word]
        assert len(numbers) / (1000 * count) == pytest.approx(chance.weight, abs=0.04)
        assert chance.low <= min(numbers)
        assert max(numbers) <= chance.high


def test_held_out_damages_never_change() -> None:
    """Numbers may be added: the hash is of those that were published first."""
    fewer = ("thickness", "too strong", "four faults", "two channels", "growing", "intermittent")
    fewer += tuple(f"return {tier}@15-30" for tier in ("severe", "moderate", "mild"))
    first = {
        name: [*damages.items()][: 200 if name in fewer else 300]
        for name, damages in lists().items()
    }
    text = json.dumps([(name, first[name]) for name in sorted(first)])
    assert len(first) == 36
    assert hashlib.sha256(text.encode()).hexdigest()[:16] == "a48f5c9cdcf6a37b"


@pytest.mark.parametrize("name", lists())
def test_held_out_damages_are_certain_and_fit_a_robot(name: str) -> None:
    plan = PLANS.get(name.split()[0], AQUAFISH)
    whole = Scenario.create(plan=plan)
    for damage in map(Damage.parse, held_out(name)):
        assert not damage.is_random
        assert len(damage) > 0
        damage.edit(whole)  # raises if it does not fit


def test_held_out_damages_are_found_by_number() -> None:
    assert held_out("severe@15-30", [120_007, 3]) == [
        lists()["severe@15-30"][120_007], lists()["severe@15-30"][3]
    ]  # fmt: skip
    assert held_out("recovery") == held_out("recovery", range(10))
    held_out("recovery").clear()  # a list of one's own
    assert len(held_out("recovery")) == 10
    with pytest.raises(UnknownNameError, match="did you mean 'severe'"):
        held_out("sever")
    with pytest.raises(InvalidArgumentError, match="'severe', which has 0 to 99; got 100"):
        held_out("severe", [0, 100])
    with pytest.raises(InvalidArgumentError, match="0 to 99 and 120000 to 120199; got 60000"):
        held_out("mild@15-30", [60_000])
    with pytest.raises(InvalidArgumentError, match=r"such as range\(100\)"):
        held_out("severe", 7)  # type: ignore[arg-type]
