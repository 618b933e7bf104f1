"""The NEAT run on its page, from the reader's ``.ini`` to C."""

from __future__ import annotations

import pathlib
import shutil

import pytest
from test_shell import commands, run
from test_snippets import PAGES, ROOT

from gait import Controller

PAGE = "docs/howto/gait.md"


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler, cc")
@pytest.mark.parametrize("feed_forward", [True, False])
def test_a_run_of_ones_own_ends_in_c(
    feed_forward: bool,
    tmp_path: pathlib.Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    folder = tmp_path / "docs" / "howto"
    folder.mkdir(parents=True)
    settings = (ROOT / "docs" / "howto" / "neat.ini").read_text()
    line = "feed_forward                      = True"
    assert line in settings
    (folder / "neat.ini").write_text(
        settings.replace(line, line.replace("True", str(feed_forward)))
    )
    monkeypatch.chdir(tmp_path)
    body, *_, run_of_ones_own = (code for code, _ in PAGES[PAGE])
    assert "run(evaluate, 100)" in run_of_ones_own
    names: dict[str, object] = {}
    exec(body.partition("gait = ")[0] + "from gait import random_poses", names)
    exec(run_of_ones_own.replace("run(evaluate, 100)", "run(evaluate, 3)"), names)
    found = Controller.load("own.json")
    assert (found.layers is None) is feed_forward
    assert found.connections
    capfd.readouterr()
    for line in commands(PAGE)[-2:]:
        assert run(line) == 0, capfd.readouterr().err
    assert "1000 steps, 0 numbers differ, by at most 0" in capfd.readouterr().out
