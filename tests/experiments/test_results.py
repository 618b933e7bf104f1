"""Every committed result has a command that makes it, and a record of how it was made."""

from __future__ import annotations

import json
import re
import runpy
import shlex
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import tyro

from aquafish_gym.runs import command_line
from aquafish_gym.runs.manifest import lock
from aquafish_gym.utils.validation import InvalidArgumentError
from experiments import results
from experiments.league.whole import WholeLeague
from experiments.results import (
    GOLDEN,
    RESULTS,
    ROOT,
    MakeResults,
    Record,
    Result,
    files_digest,
    golden_digest,
    out_of_date,
    read_records,
)

FOLDERS = ("results", "recovery", "gap", "inference", "physics", "real")
COMMANDS = [(name, command) for name, one in RESULTS.items() for command in one.commands]


def test_every_committed_file_belongs_to_one_result() -> None:
    listed = ["git", "ls-files", *(f"docs/{folder}" for folder in FOLDERS)]
    committed = subprocess.check_output(listed, cwd=ROOT, text=True).split()
    owned = Counter(file for result in RESULTS.values() for file in result.files)
    assert [file for file, count in owned.items() if count > 1] == []
    assert sorted(set(committed) - set(owned)) == []
    assert [file for file in owned if not (ROOT / file).is_file()] == []
    assert set(read_records()) == set(RESULTS)


def test_every_episode_of_the_league_is_listed() -> None:
    """The smallest run of a result plays one of each tier, and does not see that others lack."""
    begin = "python -m experiments.league.whole "
    words = [one.removeprefix(begin).split() for _, one in COMMANDS if one.startswith(begin)]
    assert len(words) > 5
    for line in words:
        for league in tyro.cli(WholeLeague, args=line).leagues():
            assert league.jobs()  # refuses damages that are not listed


def test_every_committed_file_is_as_it_was_made() -> None:
    """A figure that somebody changes by hand is noticed."""
    changed = [n for n, one in read_records().items() if one.files != files_digest(RESULTS[n])]
    assert changed == []


def test_every_golden_case_exists() -> None:
    kept = json.loads(GOLDEN.read_text())
    for name, result in RESULTS.items():
        assert result.golden, name
        assert set(result.golden) <= set(kept), name


@pytest.mark.filterwarnings("ignore:.*found in sys.modules:RuntimeWarning")
@pytest.mark.parametrize(("name", "command"), COMMANDS)
@pytest.mark.parametrize("smallest", [False, True])
def test_every_command_can_be_read(
    name: str, command: str, smallest: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its program takes all its options, and its own checks pass."""
    read: list[Any] = []

    class Read:
        def execute(self) -> None:
            command = read[0]
            for check in ("jobs", "leagues", "treatments", "cases"):
                getattr(command, check, list)()

    def parse(*arguments: Any) -> Read:
        read.append(command_line_parse(*arguments))
        return Read()

    command_line_parse = command_line.parse
    monkeypatch.setattr(command_line, "parse", parse)
    program, *words = shlex.split(f"{command} {(RESULTS[name].smallest or '') if smallest else ''}")
    if program == "python":
        program, words = (words[1], words[2:]) if words[0] == "-m" else (words[0], words[1:])
    monkeypatch.setattr(sys, "argv", [program, *words, "--out", str(tmp_path / "out")])
    run = runpy.run_path if program.endswith(".py") else partial(runpy.run_module, alter_sys=True)
    with pytest.raises(SystemExit) as left:
        run(program, run_name="__main__")
    assert left.value.code == 0
    assert len(read) == 1


#: Gaits of twenty seeds, each of hardly any search.
TINY = Result(
    commands=(
        "python -m experiments.gaits --bodies none --searches fourier --others 20 --replicates 1 "
        "--budget-divisor 1000 --workers 1",
    ),
    files={"docs/results/tiny.md": "table.md"},
    golden=("evolve cma",),
    cpu_minutes=0.1,
)


@pytest.fixture
def clone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder in the place of the clone, in which one small result can be made."""
    records = tmp_path / "docs" / "provenance.json"
    records.parent.mkdir()
    records.write_text("{}")
    monkeypatch.setattr(results, "RECORDS", records)
    monkeypatch.setattr(results, "ROOT", tmp_path)
    monkeypatch.setattr(results, "RESULTS", {"tiny": TINY})
    monkeypatch.setattr(results, "present_commit", lambda: "0123abcd")
    monkeypatch.setattr(results, "fill_pages", lambda: None)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    return tmp_path


def interrupt_after(file: Path) -> None:
    """Send this process what Ctrl-C sends, once a file exists."""
    while not file.exists():
        time.sleep(0.01)
    signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)


@pytest.mark.slow
def test_an_interrupted_result_resumes_to_the_same_bytes(clone: Path) -> None:
    MakeResults(out=clone / "whole").execute()
    copy = clone / "docs" / "results" / "tiny.md"
    made = copy.read_bytes()
    results.RECORDS.write_text("{}")
    copy.unlink()
    runs = clone / "again" / "tiny" / "run" / "runs" / "none" / "fourier"
    thread = threading.Thread(target=interrupt_after, args=(runs / "000.json",), daemon=True)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        MakeResults(out=clone / "again").execute()
    thread.join()
    assert not copy.exists()
    assert not (runs / "019.json").exists()
    before = (runs / "000.json").stat().st_mtime_ns
    MakeResults(out=clone / "again").execute()
    assert copy.read_bytes() == made
    assert (runs / "000.json").stat().st_mtime_ns == before


@pytest.fixture
def trivial(clone: Path, monkeypatch: pytest.MonkeyPatch) -> Result:
    """Let the only result be a file that a program writes in a moment."""
    one = replace(TINY, commands=("python write.py",), files={"docs/one.md": "one.md"})
    monkeypatch.setattr(results, "RESULTS", {"tiny": one})
    (clone / "write.py").write_text(
        "import sys, pathlib\npathlib.Path(sys.argv[-1], 'one.md').write_text('one')\n"
    )
    return one


def test_a_result_is_made_once_and_its_record_says_how(
    clone: Path, trivial: Result, capsys: pytest.CaptureFixture[str]
) -> None:
    for _ in range(2):
        MakeResults(out=clone / "out").execute()
    assert capsys.readouterr().out.endswith("nothing to do\n")
    assert (clone / "docs" / "one.md").read_text() == "one"
    record = read_records()["tiny"]
    assert record.commands == list(trivial.commands)
    assert record.commit == "0123abcd"
    assert record.golden == golden_digest(GOLDEN.read_text(), TINY.golden)
    assert record.cpu_minutes is not None
    (clone / "docs" / "one.md").write_text("changed by hand")
    MakeResults(out=clone / "out", plan=True).execute()
    assert "tiny: other files" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("commits", "smallest", "said"),
    [
        ([""], True, ""),
        ([""], False, "uncommitted changes"),
        (["0123abcd", "4567abcd"], False, "changed in the meantime"),
    ],
    ids=["smallest", "changed sources", "sources that change as it is made"],
)
@pytest.mark.usefixtures("trivial")
def test_a_result_that_cannot_be_repeated_is_not_committed(
    commits: list[str],
    smallest: bool,
    said: str,
    clone: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    left = [*commits]
    last = commits[-1]
    monkeypatch.setattr(results, "present_commit", lambda: left.pop(0) if left else last)
    MakeResults(out=clone / "out", smallest=smallest).execute()
    out = capsys.readouterr().out
    reasons = ("uncommitted changes", "changed in the meantime")
    assert [why for why in reasons if why in out] == [why for why in (said,) if why]
    assert smallest or (clone / "out" / "tiny" / "run" / "one.md").exists()
    assert not (clone / "docs" / "one.md").exists()
    assert read_records() == {}
    if last == "4567abcd":
        MakeResults(out=clone / "out").execute()
        assert read_records()["tiny"].commit == last


def test_an_input_of_others_is_made_first_and_must_be_committed(
    clone: Path,
    trivial: Result,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    input_of_others = replace(trivial, files={"experiments/one.md": "one.md"})
    monkeypatch.setattr(results, "RESULTS", {"tiny": trivial, "weights": input_of_others})
    changed = clone / "experiments" / "one.md"
    changed.parent.mkdir()
    committed = []
    clean = lambda: "0123abcd" if committed or not changed.exists() else ""  # noqa: E731
    monkeypatch.setattr(results, "present_commit", clean)
    with pytest.raises(SystemExit) as left:
        MakeResults(out=clone / "out").execute()
    assert left.value.code == 1
    assert "weights is an input of others: commit it" in capsys.readouterr().out
    committed.append(True)
    MakeResults(out=clone / "out").execute()
    assert sorted(read_records()) == ["tiny", "weights"]


@pytest.mark.usefixtures("trivial")
def test_the_cpu_time_of_a_result_has_none_of_an_older_one(
    clone: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    golden = clone / "golden.json"
    golden.write_text('{"evolve cma": "one"}')
    monkeypatch.setattr(results, "GOLDEN", golden)
    spent = iter([0.0, 600.0, 600.0, 660.0])
    monkeypatch.setattr(results, "_children_seconds", lambda: next(spent))
    MakeResults(out=clone / "out").execute()
    assert read_records()["tiny"].cpu_minutes == 10.0
    golden.write_text('{"evolve cma": "two"}')
    MakeResults(out=clone / "out").execute()
    assert read_records()["tiny"].cpu_minutes == 1.0


@pytest.mark.usefixtures("trivial")
def test_two_runs_at_once_do_not_meet(clone: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second reads nothing that the first is about to write."""
    monkeypatch.setattr(results, "read_records", lambda: pytest.fail("it has read the records"))
    out = clone / "out"
    out.mkdir()
    with lock(out), pytest.raises(InvalidArgumentError, match="is in use by another command"):
        MakeResults(out=out).execute()


@pytest.mark.skipif(not shutil.which("make"), reason="make is not installed")
def test_make_refuses_a_word_that_is_no_target() -> None:
    """It would make all results first, and then say that there is no target physics."""
    # Within a make, such as that of the tests, it would say in which folder it is.
    words = ["make", "--no-print-directory", "--dry-run", "results", "physics", "gap"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "physics is no target" in done.stderr
    assert 'say make results ARGS="physics gap"' in done.stderr
    assert done.stdout == ""


def test_pages_with_new_results_do_not_change_the_commit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else no result could be recorded after one that README shows."""
    git = ["git", "-c", "user.name=A", "-c", "user.email=a@b.c", "-C", str(tmp_path)]
    files = [tmp_path / name for name in ("README.md", "docs/page.md", "aquafish_gym/__init__.py")]
    for file in files:
        file.parent.mkdir(exist_ok=True)
        file.write_text("before\n")
    subprocess.run([*git, "init", "-q"], check=True)
    subprocess.run([*git, "add", "."], check=True)
    subprocess.run([*git, "commit", "-q", "-m", "before"], check=True)
    monkeypatch.setattr(results, "ROOT", tmp_path)
    commit = results.present_commit()
    assert len(commit) == 8
    *shown, code = files
    for page in shown:
        page.write_text("after\n")
    assert results.present_commit() == commit
    code.write_text("after\n")
    assert results.present_commit() == ""


def test_a_copy_without_git_has_no_commit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also in a folder of another repository."""
    git = ["git", "-c", "user.name=A", "-c", "user.email=a@b.c", "-C", str(tmp_path)]
    subprocess.run([*git, "init", "-q"], check=True)
    subprocess.run([*git, "commit", "-q", "--allow-empty", "-m", "other"], check=True)
    copy = tmp_path / "copy"
    (copy / "aquafish_gym").mkdir(parents=True)
    (copy / "aquafish_gym" / "__init__.py").write_text("")
    monkeypatch.setattr(results, "ROOT", copy)
    with pytest.raises(InvalidArgumentError, match="results need a clone that git can read"):
        results.present_commit()
    monkeypatch.setattr(results, "ROOT", tmp_path)
    (copy / "aquafish_gym").rename(tmp_path / "aquafish_gym")
    assert len(results.present_commit()) == 8
    monkeypatch.setenv("PATH", "")
    with pytest.raises(InvalidArgumentError, match="results need a clone that git can read"):
        results.present_commit()


def test_a_failed_result_keeps_the_committed_one(
    clone: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    failing = replace(TINY, commands=("python absent.py",), files={"docs/one.md": "one.md"})
    silent = replace(failing, commands=("python nothing.py",))
    monkeypatch.setattr(results, "RESULTS", {"failing": failing, "silent": silent})
    (clone / "nothing.py").write_text("")
    with pytest.raises(SystemExit) as left:
        MakeResults(out=clone / "out").execute()
    assert left.value.code == 1
    error = capfd.readouterr().err
    assert "lacks one.md" in error
    assert "failed: failing, silent" in error
    assert read_records() == {}


def test_a_result_is_up_to_date_while_command_and_golden_cases_are() -> None:
    now = golden_digest(GOLDEN.read_text(), TINY.golden)
    files = files_digest(TINY)
    record = Record(list(TINY.commands), "0123abcd", "2026-11-27", 0.1, now, files)
    assert out_of_date(TINY, record) == ""
    assert out_of_date(TINY, None) == "not made yet"
    assert out_of_date(TINY, replace(record, commands=["other"])) == "other command"
    assert out_of_date(TINY, replace(record, golden=None)) == "golden cases unknown"
    assert out_of_date(TINY, replace(record, golden="0")) == "golden cases changed"
    assert out_of_date(TINY, replace(record, files="0")) == "other files"

    kept = replace(TINY, kept="its data are used as they are")
    assert out_of_date(kept, replace(record, golden="0")) == ""
    assert out_of_date(kept, replace(record, files="0")) == "other files"
    assert golden_digest('{"evolve cma": "a", "other": "b"}', TINY.golden) == golden_digest(
        '{"evolve cma": "a", "other": "c"}', TINY.golden
    )
    assert golden_digest('{"other": "b"}', TINY.golden) is None


def test_what_it_needs_and_is_not_here_is_said(
    clone: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    needy = replace(TINY, needs=("absent_module", "out/downloads/absent"))
    monkeypatch.setattr(results, "RESULTS", {"needy": needy})
    MakeResults(out=clone / "out").execute()
    assert capsys.readouterr().out == (
        "needy: left out, for it needs absent_module, out/downloads/absent\nnothing to do\n"
    )


@pytest.mark.usefixtures("clone")
def test_the_table_says_that_a_result_waits_for_a_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    needy = replace(TINY, needs=(results.GPU,))
    monkeypatch.setattr(results, "RESULTS", {"needy": needy})
    assert (
        results.provenance()
        .splitlines()[-1]
        .endswith("| to be made again on an NVIDIA GPU: not made yet |")
    )


#: A data set of Minari holds its time, and speeds are times.
WITHOUT_SAME_BYTES = re.compile("minari|performance-")


@pytest.mark.slow
@pytest.mark.timeout(7200)
def test_the_smallest_results_resume_to_the_same_bytes(tmp_path: Path) -> None:
    """Each is made at once, and again with SIGTERM after 10, 20, 40 ... seconds."""
    names = [name for name, one in RESULTS.items() if one.smallest is not None]
    names = [name for name in names if not RESULTS[name].missing()]
    assert len(names) > 20
    make = [sys.executable, "-m", "experiments.results", "--smallest", "--out"]
    subprocess.run([*make, tmp_path / "whole", *names], cwd=ROOT, check=True)
    seconds, code = 10.0, command_line.INTERRUPTED
    while code == command_line.INTERRUPTED:
        process = subprocess.Popen([*make, tmp_path / "again", *names], cwd=ROOT)
        with suppress(subprocess.TimeoutExpired):
            process.wait(seconds)
        process.terminate()
        code = process.wait()
        seconds *= 2.0
    assert code == 0
    for name in names:
        if WITHOUT_SAME_BYTES.match(name):
            continue
        result = RESULTS[name]
        for target, file in result.files.items():
            if "times" in Path(target).name:
                continue
            whole, again = (
                (tmp_path / out / "smallest" / (result.folder or name) / "run" / file).read_bytes()
                for out in ("whole", "again")
            )
            assert again == whole, f"{name}: {file}"
