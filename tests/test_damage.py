"""Damage: text, JSON and bodies agree, and bad descriptions are refused with a sentence."""

from __future__ import annotations

import contextlib
import json
import math
from dataclasses import asdict

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aquafish_gym.damage import Damage, Fault, FinMissing, FinScaled
from aquafish_gym.morphology import FINS, SIZES, Morphology, change_in_words
from aquafish_gym.utils.validation import InvalidArgumentError, UnknownNameError

faults = st.one_of(
    st.builds(
        FinScaled,
        st.sampled_from(FINS),
        st.sampled_from(SIZES),
        st.floats(0.0, 1.0),
    ),
    st.builds(FinMissing, st.sampled_from(FINS)),
)
damages = st.lists(faults, max_size=4).map(lambda f: Damage(tuple(f)))


@given(damages)
def test_text_and_json_read_back_exactly(damage: Damage) -> None:
    assert Damage.parse(str(damage)) == damage
    assert Damage.from_json(damage.to_json()) == damage
    assert Damage.coerce(damage.to_list()) == damage
    assert Damage.coerce(json.loads(json.dumps(asdict(damage)))) == damage
    assert Damage.coerce(str(damage)) == damage


@given(damages)
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
    assert Damage.coerce(["left_pectoral:length=0.5", FinMissing("caudal")]) == expected
    assert Damage.coerce([Damage(expected.faults[:1]), {"kind": "FinMissing", "fin": "caudal"}])
    assert Damage.coerce(expected) is expected
    assert Damage.coerce(None) == Damage.parse("") == Damage.parse("none") == Damage()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("left_pectorl:length=0.5", "did you mean 'left_pectoral'"),
        ("caudal:lenght=0.5", "did you mean 'length'"),
        ("caudal:misssing", "did you mean 'missing'"),
        ("caudal", "fin:word=number"),
        ("caudal:", "fin:word=number"),
        ("caudal:missing;", "fin:word=number"),
        ("caudal:length", "needs a factor"),
        ("caudal:length=", "needs a number"),
        ("caudal:length=half", "needs a number"),
        ("caudal:length=-0.5", "must lie in"),
        ("caudal:length=nan", "must be finite"),
        ("caudal:length=inf", "must be finite"),
        ("caudal:missing=1", "takes no number"),
    ],
)
def test_bad_text_is_refused(text: str, sentence: str) -> None:
    with pytest.raises(InvalidArgumentError, match=sentence):
        Damage.parse(text)


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
    ],
)
def test_damage_is_said_in_words(damage: str, words: str) -> None:
    assert Damage.parse(damage).in_words(Morphology.nominal()) == words


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
