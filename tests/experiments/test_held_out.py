"""Lists of held-out damages can be extended, and are never changed."""

from __future__ import annotations

from pathlib import Path

import pytest

from aquafish_gym.damage import Damage
from aquafish_gym.damage.held_out import SCHEMA, lists
from aquafish_gym.utils.storage import read_document
from aquafish_gym.utils.validation import InvalidArgumentError
from experiments import held_out
from experiments.held_out import LISTS, HeldOut


def test_new_numbers_come_to_those_that_are_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(held_out, "PLACE", tmp_path / "held_out.json")
    HeldOut(first=130_000, count=2).execute()
    found = read_document(tmp_path / "held_out.json", SCHEMA)["lists"]
    assert set(found) == set(lists()) == {"recovery", "league", *LISTS}
    for name, damages in lists().items():
        kept = {str(number): text for number, text in damages.items()}
        new = found[name].keys() - kept.keys()
        assert {number: found[name][number] for number in kept} == kept
        assert new == (set() if name in ("recovery", "league") else {"130000", "130001"})
        assert not any(Damage.parse(found[name][number]).is_random for number in new)


def test_numbers_that_are_there_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(held_out, "PLACE", tmp_path / "held_out.json")
    with pytest.raises(InvalidArgumentError, match=r"'severe' lacks.*; it has 98 to 99"):
        HeldOut(lists=("severe",), first=98, count=10).execute()
    assert list(tmp_path.iterdir()) == []
