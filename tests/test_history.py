"""The history of the project's figures: which commits have a row, and which one moved a figure."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

from aquafish_gym.utils.storage import DamagedFileError
from aquafish_gym.utils.validation import InvalidArgumentError
from instruments.__main__ import main
from instruments.history.changes import FALSE_ALARM_PROBABILITY, find_bands, find_changes
from instruments.history.command import make_tables
from instruments.history.figures import RATIOS, SOURCES, Figure, family_of
from instruments.history.plots import history_picture
from instruments.history.rows import Row, new_rows, read_rows, write_rows
from instruments.verification.tables import fill_page

ROOT = Path(__file__).parents[1]
COMMITTED = ROOT / "docs" / "results" / "history" / "figures.jsonl"
LEAGUE = "docs/results/league/league.json"
PAGE = "docs/performance.md"


def git(folder: Path, *words: str) -> str:
    who = ["-c", "user.name=A", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false"]
    done = subprocess.run(
        ["git", *who, *words], cwd=folder, check=True, capture_output=True, encoding="utf-8"
    )
    return done.stdout.strip()


def commit(folder: Path, path: str, text: str) -> str:
    file = folder / path
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text, encoding="utf-8")
    git(folder, "add", path)
    git(folder, "commit", "-m", f"Write {path}")
    return git(folder, "rev-parse", "HEAD")[:9]


def league(way: float) -> str:
    part = {"way_after_onset": [way, way - 2.0, way + 2.0]}
    return json.dumps({"self-model": {"severe": part}, "still": {"severe": part}})


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    git(tmp_path, "init", "-q", "-b", "main")
    commit(tmp_path, "README.md", "A fish.\n")
    return tmp_path


def synthetic(
    rng: np.random.Generator, steps: dict[int, float], intervals: bool, figures: int = 8
) -> list[Row]:
    """Return 12 rows of noise of 1, or of 10% without intervals, with steps at rows."""
    rows = []
    level = 10.0
    for i in range(12):
        level += steps.get(i, 0.0)
        found = {}
        for k in range(figures):
            value = level + float(rng.normal())
            exact = Figure(value, value - 1.96, value + 1.96)
            found[f"some: {k}"] = exact if intervals else Figure(float(np.exp(0.1 * value)))
        rows.append(Row(f"{i:09}", f"2026-01-{i + 1:02}T00:00:00+00:00", "", found))
    return rows


def test_the_page_shows_the_committed_history() -> None:
    rows = read_rows(COMMITTED)
    page = (ROOT / "docs" / "history.md").read_text(encoding="utf-8")
    assert fill_page(page, make_tables(rows, find_changes(rows))) == page


@pytest.mark.parametrize("path", SOURCES)
def test_figures_are_found_in_the_present_files(path: str) -> None:
    found = SOURCES[path]((ROOT / path).read_text(encoding="utf-8"))
    families = {family_of(name)[0] for name in found}
    assert families
    if path == PAGE:
        assert families == {"ratio of speed", "seconds to 90% of the score"}
        assert {family_of(name)[1] for name in found} >= set(RATIOS.values())
    else:
        assert all(figure.sd is not None for figure in found.values())


def test_a_commit_has_a_row_if_it_measured_something_again(repository: Path) -> None:
    first = commit(repository, LEAGUE, league(20.0))
    commit(repository, "other.txt", "code\n")
    commit(repository, LEAGUE, league(20.0) + "\n")  # the same figures
    last = commit(repository, LEAGUE, league(24.0))
    rows = new_rows(repository, [])
    assert [row.commit for row in rows] == [first, last]
    assert rows[1].subject == f"Write {LEAGUE}"
    assert rows[1].figures == {"league, severe: self-model": Figure(24.0, 22.0, 26.0)}


def test_the_same_commit_is_appended_once(repository: Path) -> None:
    arguments = ["history", "--repository", str(repository), "--file", str(repository / "h.jsonl")]
    commit(repository, LEAGUE, league(20.0))
    assert main(arguments) == 0
    before = (repository / "h.jsonl").read_bytes()
    assert main(arguments) == 0
    assert (repository / "h.jsonl").read_bytes() == before
    commit(repository, LEAGUE, league(24.0))
    assert main(arguments) == 0
    assert (repository / "h.jsonl").read_bytes().startswith(before)
    assert len(read_rows(repository / "h.jsonl")) == 2


def test_a_merge_is_the_commit_of_its_branch(repository: Path) -> None:
    commit(repository, LEAGUE, league(20.0))
    git(repository, "checkout", "-q", "-b", "side")
    commit(repository, LEAGUE, league(21.0))
    commit(repository, LEAGUE, league(22.0))
    git(repository, "checkout", "-q", "main")
    git(repository, "merge", "-q", "--no-ff", "-m", "Merge the side", "side")
    assert [row.subject for row in new_rows(repository, [])] == [
        f"Write {LEAGUE}",
        "Merge the side",
    ]


def test_rows_of_another_history_are_refused(repository: Path) -> None:
    commit(repository, LEAGUE, league(20.0))
    with pytest.raises(InvalidArgumentError, match="123456789, which is not in this clone"):
        new_rows(repository, [Row("123456789", "2026-01-01T00:00:00+00:00", "", {})])


def test_a_folder_without_commits_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidArgumentError, match="folder of a Git repository"):
        new_rows(tmp_path / "none", [])


def test_rows_survive_their_file(tmp_path: Path) -> None:
    rows = synthetic(np.random.default_rng(0), {}, intervals=False)
    write_rows(tmp_path / "rows.jsonl", rows)
    found = read_rows(tmp_path / "rows.jsonl")
    assert [row.commit for row in found] == [row.commit for row in rows]
    assert found[3].figures["some: 1"].value == pytest.approx(rows[3].figures["some: 1"].value)


@pytest.mark.parametrize("line", ["[]", "{}", '{"commit": "a", "date": "b"', "7"])
def test_a_damaged_line_is_named(tmp_path: Path, line: str) -> None:
    (tmp_path / "rows.jsonl").write_text(f"{line}\n")
    with pytest.raises((DamagedFileError, InvalidArgumentError), match=r"rows.jsonl, line 1"):
        read_rows(tmp_path / "rows.jsonl")


@pytest.mark.parametrize("intervals", [True, False])
def test_false_alarms_are_as_rare_as_stated(intervals: bool) -> None:
    rng = np.random.default_rng(1)
    named = [
        len({change.noticed for change in find_changes(synthetic(rng, {}, intervals))})
        for _ in range(60)
    ]
    share = sum(named) / (12 * len(named))
    sd = np.sqrt(FALSE_ALARM_PROBABILITY / (12 * len(named)))
    assert share < FALSE_ALARM_PROBABILITY + 3.0 * sd


@pytest.mark.parametrize("intervals", [True, False])
def test_a_step_names_its_row(intervals: bool) -> None:
    changes = find_changes(synthetic(np.random.default_rng(2), {6: 9.0}, intervals))
    named = {change.figure for change in changes if change.row == 6}
    assert named == {f"some: {k}" for k in range(8)}
    if intervals:
        assert {change.row for change in changes} == {6}
        assert changes[0].before == pytest.approx(10.0, abs=1.5)
        assert changes[0].since == pytest.approx(19.0, abs=3.0)
        assert {change.noticed for change in changes} == {6}


def test_a_small_step_is_noticed_later_and_mostly_names_its_row() -> None:
    changes = [
        change
        for seed in range(50)
        for change in find_changes(synthetic(np.random.default_rng(seed), {4: 3.0}, True, 1))
    ]
    right = [change for change in changes if change.row == 4]
    assert len(right) > 30
    assert len([change for change in right if change.noticed > 4]) > 10


def test_two_steps_are_two_changes() -> None:
    changes = find_changes(synthetic(np.random.default_rng(4), {4: 9.0, 8: -9.0}, True, 1))
    assert [change.row for change in changes] == [4, 8]


def test_two_values_without_intervals_show_no_change() -> None:
    rows = [Row(str(i), "", "", {"ratio: a": Figure(10.0**i)}) for i in range(2)]
    assert find_changes(rows) == []


def test_a_band_holds_the_values_between_changes() -> None:
    rows = synthetic(np.random.default_rng(5), {6: 9.0}, True, 1)
    first, second = find_bands(rows, find_changes(rows))["some: 0"]
    assert (first.first, first.last, second.first, second.last) == (0, 5, 6, 11)
    assert first.low < 10.0 < first.high < 19.0
    assert second.low < 19.0 < second.high


def test_the_picture_has_a_panel_for_each_family() -> None:
    rows = read_rows(COMMITTED)
    families = {family_of(name)[0] for row in rows for name in row.figures}
    titles = {axes.get_title() for axes in history_picture(rows).axes}
    assert titles - {""} == families
