"""One command a folder at a time, with one group of settings."""

from __future__ import annotations

import errno
import os
import re

import pytest

from aquafish_gym.runs import manifest
from aquafish_gym.runs.manifest import (
    LOCK,
    check_manifest,
    lock,
    read_manifest,
    versions,
    write_manifest,
)
from aquafish_gym.utils.storage import write_document
from aquafish_gym.utils.validation import InvalidArgumentError

SETTINGS = {"steps": 3, "damage": [{"fin": "left"}], "gait": {"seed": 1, "poses": 8}}


def refused(folder, message):
    with pytest.raises(InvalidArgumentError, match=message), lock(folder):
        pass


@pytest.mark.parametrize("removes_open_files", [True, False])  # as Windows does not
def test_a_folder_is_locked_once(tmp_path, monkeypatch, removes_open_files):
    monkeypatch.setattr(manifest, "REMOVES_OPEN_FILES", removes_open_files)
    with lock(tmp_path):
        refused(tmp_path, "in use by another command")
    assert not list(tmp_path.iterdir())
    with lock(tmp_path):  # free again
        pass


def test_the_lock_of_a_dead_process_is_taken_over(tmp_path):
    (tmp_path / LOCK).touch()
    with lock(tmp_path):
        refused(tmp_path, "in use by another command")


def test_a_file_system_without_locks_is_named(tmp_path, monkeypatch):
    def fail(*_arguments, **_options):
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr("filelock.lock_descriptor", fail)
    refused(tmp_path, "cannot lock .*: No locks available")


@pytest.mark.parametrize("removes_open_files", [True, False])
def test_a_file_of_the_user_is_no_lock(tmp_path, monkeypatch, removes_open_files):
    monkeypatch.setattr(manifest, "REMOVES_OPEN_FILES", removes_open_files)
    mine = tmp_path / "mine"
    mine.write_text("my notes")
    (tmp_path / "lock").write_text("my notes")
    with lock(tmp_path):
        pass
    (tmp_path / LOCK).symlink_to(mine)
    refused(tmp_path, "cannot lock")
    (tmp_path / LOCK).unlink()
    os.link(mine, tmp_path / LOCK)
    refused(tmp_path, "no lock of ours")
    assert mine.read_text() == (tmp_path / "lock").read_text() == "my notes"


def test_a_manifest_is_written_once(tmp_path):
    assert read_manifest(tmp_path) is None
    write_manifest(tmp_path, "a study", SETTINGS, ["runs"])
    before = (tmp_path / "settings.json").read_bytes()
    write_manifest(tmp_path, "a study", SETTINGS, ["settings.json"])
    assert (tmp_path / "settings.json").read_bytes() == before
    held = read_manifest(tmp_path)
    assert (held["kind"], held["settings"]) == ("a study", SETTINGS)
    assert held["versions"] == [versions()]


@pytest.mark.parametrize(
    ("kind", "settings", "message"),
    [
        ("a gait run", SETTINGS, "must be a new directory or hold a gait run; .* a study"),
        ("a study", SETTINGS | {"steps": 4}, "a study with steps 3, not 4; choose another"),
        ("a study", SETTINGS | {"more": 1}, "with more None, not 1"),
        ("a study", SETTINGS | {"gait": {"seed": 2, "poses": 8}}, r"gait\.seed 1, not 2"),
        ("a study", {"steps": 3}, r"with damage \[.*\], not None"),
    ],
)
def test_the_first_difference_is_named_and_nothing_changes(tmp_path, kind, settings, message):
    write_manifest(tmp_path, "a study", SETTINGS)
    before = (tmp_path / "settings.json").read_bytes()
    with pytest.raises(InvalidArgumentError, match=message):
        write_manifest(tmp_path, kind, settings)
    assert (tmp_path / "settings.json").read_bytes() == before


def test_a_command_that_starts_again_says_with_which_versions(tmp_path):
    old = {"kind": "a study", "settings": SETTINGS, "versions": [{"numpy": "1.0"}]}
    write_document(tmp_path / "settings.json", old, "aquafish.folder/1")
    write_manifest(tmp_path, "a study", SETTINGS)
    assert read_manifest(tmp_path)["versions"] == [versions()]


def test_versions_of_another_form_are_refused_and_not_joined(tmp_path):
    write_manifest(tmp_path, "a study", SETTINGS, work=versions)
    held = read_manifest(tmp_path) | {"versions": versions()}
    write_document(tmp_path / "settings.json", held, "aquafish.folder/1")
    before = (tmp_path / "settings.json").read_bytes()
    with pytest.raises(InvalidArgumentError, match="does not say what the folder holds"):
        write_manifest(tmp_path, "a study", SETTINGS, work=versions)
    assert (tmp_path / "settings.json").read_bytes() == before


def test_a_command_that_continues_at_another_commit_adds_its_versions(tmp_path, monkeypatch):
    write_manifest(tmp_path, "a study", SETTINGS, work=versions)
    first = (tmp_path / "settings.json").read_bytes()
    write_manifest(tmp_path, "a study", SETTINGS, work=versions)
    assert (tmp_path / "settings.json").read_bytes() == first
    here = versions()
    monkeypatch.setattr(manifest, "version", lambda: "0.1.dev2+g123456789")
    for _ in range(2):
        write_manifest(tmp_path, "a study", SETTINGS, work=versions)
        held = read_manifest(tmp_path)["versions"]
        assert held == [here, here | {"aquafish-gym": "0.1.dev2+g123456789"}]


def test_a_command_that_continues_refuses_results_of_unknown_code(tmp_path):
    write_manifest(tmp_path, "a study", SETTINGS)
    before = (tmp_path / "settings.json").read_bytes()
    with pytest.raises(InvalidArgumentError, match=r"that other code made \(hash missing, here "):
        write_manifest(tmp_path, "a study", SETTINGS, work=lock)
    assert (tmp_path / "settings.json").read_bytes() == before
    check_manifest(tmp_path, "a study", SETTINGS)  # what only draws reads them


def test_results_without_a_manifest_are_left_alone(tmp_path):
    (tmp_path / "runs").mkdir()
    with pytest.raises(InvalidArgumentError, match=re.escape("holds runs but no settings.json")):
        write_manifest(tmp_path, "a study", SETTINGS, ["report.json", "runs"])
    assert not (tmp_path / "settings.json").exists()
