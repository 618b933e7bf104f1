"""A replicate's files, and that whatever happens to them the same ones come out."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

import eea.study.replicate
from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.storage import append_record, read_records
from eea.core.config import CONDITIONS, EEAConfig
from eea.core.estimation import EstimationConfig
from eea.core.exploration import ExplorationConfig
from eea.core.inference import OutOfBandConfig
from eea.study.replicate import (
    Progress,
    Replicate,
    World,
    look,
    read_state,
    run_replicate,
    write_state,
)

CONFIG = EEAConfig(
    condition="none",
    steps=16,
    rounds=3,
    exploration=ExplorationConfig(4, 2),
    estimation=EstimationConfig(4, 3),
    out_of_band=OutOfBandConfig(period=2, inner_population=4, inner_generations=2, revisit=1),
)
WORLD = World(Morphology.nominal(), Damage.parse("left_pectoral:length=0.5"))


def make(folder, seed=0, **changes):
    return Replicate("arm", replace(CONFIG, **changes), seed, WORLD, folder)


def run(replicate):
    return list(run_replicate(replicate))


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The bytes of every condition's log."""
    folder = tmp_path_factory.mktemp("undisturbed")
    logs = {}
    for condition in CONDITIONS:
        replicate = make(folder / condition, condition=condition)
        run(replicate)
        logs[condition] = replicate.log.read_bytes()
    return logs


def test_a_finished_replicate_is_its_log_alone(tmp_path, undisturbed):
    replicate = make(tmp_path)
    assert look(replicate).records == []
    said = run(replicate)
    assert [p.round for p in said] == [0, 1, 2, 3]
    assert said[0] == Progress(0)
    assert all(p.wall > 0.0 and p.cpu >= 0.0 for p in said[1:])
    assert replicate.log == tmp_path / "runs" / "arm" / "16" / "0.jsonl"
    assert list(replicate.log.parent.iterdir()) == [replicate.log]
    records = read_records(replicate.log)
    assert replicate.log.read_bytes() == undisturbed["none"]
    assert "seconds" not in records[0]
    assert [r["round"] for r in records] == [1, 2, 3]
    assert said[-1].objective_fitness == records[-1]["objective_fitness"]
    standing = look(replicate)
    assert (standing.ended, standing.complaint, standing.records) == (True, None, records)
    assert run(replicate) == []


def test_the_seeds_and_the_conditions_differ_and_the_hidden_angles_are_paired(
    tmp_path, undisturbed
):
    other = make(tmp_path, seed=1)
    run(other)
    assert other.log.read_bytes() != undisturbed["none"]
    assert len(set(undisturbed.values())) == len(CONDITIONS)
    angles = [
        [json.loads(line)["record"]["true_angles"] for line in log.splitlines()]
        for log in undisturbed.values()
    ]
    assert all(a == angles[0] for a in angles)


class Killed(BaseException):
    """No handler of errors is for this."""


@pytest.mark.parametrize("condition", CONDITIONS)
@pytest.mark.parametrize("before", [True, False], ids=["before", "after"])
def test_a_kill_between_any_two_writes_changes_nothing(
    tmp_path, monkeypatch, undisturbed, condition, before
):
    for kill_at in range(1, 100):
        replicate = make(tmp_path / str(kill_at), condition=condition)
        count = 0

        def fatal(function, kill_at=kill_at):
            def wrapped(*arguments):
                nonlocal count
                count += 1
                if before and count == kill_at:
                    raise Killed
                function(*arguments)
                if count == kill_at:
                    raise Killed

            return wrapped

        with monkeypatch.context() as patch:
            for name in ("append_record", "write_state"):
                patch.setattr(eea.study.replicate, name, fatal(getattr(eea.study.replicate, name)))
            try:
                run(replicate)
            except Killed:
                killed = True
            else:
                killed = False
        said = run(replicate)
        assert replicate.log.read_bytes() == undisturbed[condition]
        assert not replicate.state.exists()
        if not killed:
            break
        if said:  # a line and then a state a round: it goes on after the last state
            assert said[0].round == (kill_at - before) // 2
    assert kill_at == 6  # no state after the last round


def test_a_torn_last_line_is_no_damage_and_is_made_again(tmp_path, undisturbed):
    whole = undisturbed["none"]
    lines = whole.splitlines(keepends=True)
    for cut in (1, len(lines[2]) // 2, len(lines[2]) - 1):
        replicate = make(tmp_path / str(cut))
        _stop_after(replicate, 2)
        replicate.log.write_bytes(b"".join(lines[:2]) + lines[2][:cut])
        assert look(replicate).complaint is None
        assert not look(replicate).ended
        assert [p.round for p in run(replicate)] == [2, 3]
        assert replicate.log.read_bytes() == whole


def _stop_after(replicate, rounds):
    steps = run_replicate(replicate)
    while next(steps).round < rounds:
        pass
    steps.close()
    assert replicate.state.exists()


DAMAGE = {
    "a changed digit": (2, lambda lines: [lines[0], lines[1].replace(b"0.", b"1.", 1), *lines[2:]]),
    "nonsense": (1, lambda lines: [b"nonsense\n", *lines[1:]]),
    "an empty line": (2, lambda lines: [lines[0], b"\n", *lines[1:]]),
    "a missing line": (2, lambda lines: [lines[0], *lines[2:]]),
    "a line too many": (4, lambda lines: [*lines, lines[-1]]),
    "torn beyond the end": (4, lambda lines: [*lines, b'{"checksum']),
    "a cut in the middle": (2, lambda lines: [lines[0], lines[1][:50] + b"\n", *lines[2:]]),
}


@pytest.mark.parametrize("stopped", [2, None], ids=["going on", "complete"])
@pytest.mark.parametrize("damage", DAMAGE)
def test_damage_is_named_and_the_replicate_is_made_again(tmp_path, undisturbed, damage, stopped):
    number, spoil = DAMAGE[damage]
    replicate = make(tmp_path)
    if stopped is None:
        run(replicate)
    else:
        _stop_after(replicate, stopped)
    lines = undisturbed["none"].splitlines(keepends=True)
    replicate.log.write_bytes(b"".join(spoil(lines)))
    standing = look(replicate)
    assert not standing.ended
    assert f"{replicate.log}, line {number}: " in standing.complaint
    assert len(standing.records) == number - 1
    run(replicate)
    assert replicate.log.read_bytes() == undisturbed["none"]
    assert look(replicate).complaint is None


def test_the_lines_before_the_damage_are_gone_on_from_if_the_state_is_theirs(tmp_path, undisturbed):
    replicate = make(tmp_path)
    _stop_after(replicate, 2)
    replicate.log.write_bytes(undisturbed["none"][:-10] + b"\n")
    assert "line 3: " in look(replicate).complaint
    assert [p.round for p in run(replicate)] == [2, 3]
    assert replicate.log.read_bytes() == undisturbed["none"]


def test_a_state_that_is_not_the_logs_is_not_gone_on_from(tmp_path, undisturbed):
    def other_seed(replicate):
        other = make(tmp_path / "other", seed=1)
        _stop_after(other, 2)
        replicate.state.write_bytes(other.state.read_bytes())

    def ahead(replicate):
        replicate.log.write_bytes(undisturbed["none"].splitlines(keepends=True)[0])

    def no_log(replicate):
        replicate.log.unlink()

    def cut(replicate):
        replicate.state.write_bytes(replicate.state.read_bytes()[:-100])

    def changed(replicate):
        replicate.state.write_bytes(replicate.state.read_bytes().replace(b"0.", b"1.", 1))

    def of_the_future(replicate):
        write_state(replicate.state, {**read_state(replicate.state), "schema": "eea.core.state/2"})

    def no_dict(replicate):
        write_state(replicate.state, [])

    def other_rounds(replicate):
        saved = read_state(replicate.state)
        saved["rounds"][0]["trials"] += 1
        write_state(replicate.state, saved)

    for spoil in (other_seed, ahead, no_log, cut, changed, of_the_future, no_dict, other_rounds):
        replicate = make(tmp_path / spoil.__name__)
        _stop_after(replicate, 2)
        spoil(replicate)
        assert [p.round for p in run(replicate)] == [0, 1, 2, 3], spoil.__name__
        assert replicate.log.read_bytes() == undisturbed["none"], spoil.__name__


def test_a_stale_state_of_a_complete_replicate_is_removed(tmp_path, undisturbed):
    replicate = make(tmp_path)
    _stop_after(replicate, 2)
    replicate.log.write_bytes(undisturbed["none"])
    assert look(replicate).ended
    assert run(replicate) == []
    assert not replicate.state.exists()
    assert replicate.log.read_bytes() == undisturbed["none"]


def test_what_a_kill_left_of_an_unfinished_file_is_cleared_away(tmp_path):
    replicate = make(tmp_path)
    directory = replicate.log.parent
    directory.mkdir(parents=True)
    mine, other = directory / ".0.state.bfy4m4rr", directory / ".10.state.bfy4m4rr"
    for left in (mine, other):
        left.touch()
    run(replicate)
    assert not mine.exists()
    assert other.exists()


def test_a_replicate_may_end_at_an_accurate_model(tmp_path):
    replicate = make(tmp_path, accurate=-1e9)
    assert [p.round for p in run(replicate)] == [0, 1]
    assert look(replicate).ended
    assert not replicate.state.exists()
    append_record(replicate.log, {**look(replicate).records[0], "round": 2})
    assert "line 2: there is no round 2" in look(replicate).complaint
