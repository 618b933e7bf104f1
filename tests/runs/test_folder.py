"""One command a folder at a time, one description a folder, and no litter."""

from __future__ import annotations

import fcntl
import os
import re

import pytest

from aquafish_gym.runs.folder import claim, described, first_difference, flat, held
from aquafish_gym.runs.storage import write_bytes
from aquafish_gym.utils.validation import InvalidArgumentError

SETTINGS = {"steps": 3, "damage": [{"fin": "left"}], "gait": {"seed": 1, "poses": 8}}
CODE = {"numpy": "2.0", "source": "abc"}


def test_a_folder_is_held_by_one(tmp_path):
    with held(tmp_path):
        lock = (tmp_path / "lock").read_text()
        with (
            pytest.raises(InvalidArgumentError, match=rf"in use .* process {os.getpid()} since 20"),
            held(tmp_path),
        ):
            pass
        assert (tmp_path / "lock").read_text() == lock  # it was not touched
    assert not list(tmp_path.iterdir())
    with held(tmp_path):  # free again
        pass


def test_a_dead_commands_lock_is_taken_over(tmp_path):
    (tmp_path / "lock").write_text('{"pid": 1, "since": "long ago"}\n')
    with held(tmp_path):
        assert "long ago" not in (tmp_path / "lock").read_text()


def test_a_lock_without_words_says_so(tmp_path):
    with (tmp_path / "lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        for content in ("", "[1]", "[" * 100_000):
            (tmp_path / "lock").write_text(content)
            with (
                pytest.raises(InvalidArgumentError, match="which is just beginning"),
                held(tmp_path),
            ):
                pass


def test_what_a_kill_left_is_swept_and_nothing_else(tmp_path, monkeypatch):
    below = tmp_path / "runs" / "none"
    below.mkdir(parents=True)
    kept = [tmp_path / name for name in (".hidden", "a.part", ".a.part", ".config.settings")]
    for path in kept:
        path.touch()
    with monkeypatch.context() as patch:  # as kill -9 in the middle of it
        patch.setattr(os, "replace", lambda *_: os.kill)
        patch.setattr(os, "unlink", lambda *_: None)
        for folder in (tmp_path, below):
            write_bytes(folder / "result.json", b"half")
    assert len(list(tmp_path.rglob(".result.json.*.part"))) == 2
    with held(tmp_path):
        found = sorted(path for path in tmp_path.rglob("*") if path.is_file())
        assert found == sorted([*kept, tmp_path / "lock"])


def test_a_folder_says_what_it_holds(tmp_path):
    assert described(tmp_path) is None
    claim(tmp_path, "a study", SETTINGS, CODE, ["runs"])
    before = (tmp_path / "settings.json").read_bytes()
    claim(tmp_path, "a study", SETTINGS, CODE, ["settings.json"])
    assert (tmp_path / "settings.json").read_bytes() == before
    assert described(tmp_path) == {"kind": "a study", "settings": SETTINGS, "code": [CODE]}


@pytest.mark.parametrize(
    ("kind", "settings", "code", "message"),
    [
        ("a gait run", SETTINGS, CODE, "must be a new directory or hold a gait run; .* a study"),
        ("a study", SETTINGS | {"steps": 4}, CODE, "a study with steps 3, not 4; choose another"),
        ("a study", SETTINGS | {"more": 1}, CODE, "with more None, not 1"),
        ("a study", SETTINGS | {"gait": {"seed": 2, "poses": 8}}, CODE, r"gait\.seed 1, not 2"),
        ("a study", {"steps": 3}, CODE, r"with damage \[.*\], not None"),
        ("a study", SETTINGS, CODE | {"numpy": "2.1"}, "results of numpy 2.0, not 2.1; .*--other-"),
        ("a study", SETTINGS, {"numpy": "2.0", "source": "d"}, "results of source abc, not d"),
    ],
)
def test_what_differs_is_named_and_nothing_changed(tmp_path, kind, settings, code, message):
    claim(tmp_path, "a study", SETTINGS, CODE)
    before = (tmp_path / "settings.json").read_bytes()
    with pytest.raises(InvalidArgumentError, match=message):
        claim(tmp_path, kind, settings, code)
    assert (tmp_path / "settings.json").read_bytes() == before


def test_results_without_a_description_are_nobodys(tmp_path):
    (tmp_path / "runs").mkdir()
    with pytest.raises(InvalidArgumentError, match=re.escape("holds runs but no settings.json")):
        claim(tmp_path, "a study", SETTINGS, CODE, ["report.json", "runs"])
    assert not (tmp_path / "settings.json").exists()


def test_other_code_is_noted_when_it_is_allowed(tmp_path):
    claim(tmp_path, "a study", SETTINGS, CODE)
    newer = CODE | {"numpy": "2.1"}
    claim(tmp_path, "a study", SETTINGS, newer, other_code=True)
    assert described(tmp_path)["code"] == [CODE, newer]
    claim(tmp_path, "a study", SETTINGS, CODE)  # both are its own from now on
    claim(tmp_path, "a study", SETTINGS, newer)
    assert described(tmp_path)["code"] == [CODE, newer]


def test_differences_have_dotted_names():
    assert flat(SETTINGS)["gait.poses"] == 8
    assert first_difference(SETTINGS, SETTINGS) is None
    assert first_difference({"a": {}}, {}) is None  # nothing is said in it
    assert first_difference({"a": {"b": None}}, {"a": {}}) == "a.b"
