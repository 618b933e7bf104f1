"""What a belief says to a person."""

from __future__ import annotations

from dataclasses import replace

from swing import infer


def test_a_hypothesis_has_a_probability_only_where_it_explains_what_was_felt() -> None:
    belief = infer(motor=0.0, alternatives="always").belief
    assert belief is not None
    assert belief.good
    assert belief.findings[0].startswith("the motor is dead (")
    wrong = replace(belief.goodness, good=False, verdict="none swims like this")
    said = replace(belief, goodness=wrong).findings
    assert said[:2] == [
        "none swims like this",
        "the best of the hypotheses that fail: the motor is dead",
    ]
