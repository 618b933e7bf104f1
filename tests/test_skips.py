"""Where skips are refused, a test that is skipped unnamed fails, and says what to do."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
UNNAMED = "import pytest\ndef test_it(): pytest.importorskip('no_such_package')\n"
LISTED = "import pytest\ndef test_it(): pytest.skip('no browser is installed here: x')\n"
MODULE = "import pytest\npytest.importorskip('no_such_package')\ndef test_it(): pass\n"
MARKED = "import pytest\n@pytest.mark.skipif(True, reason='why not')\ndef test_it(): pass\n"
EXPECTED = "import pytest\n@pytest.mark.xfail\ndef test_it(): assert False\n"


def run(folder: Path, code: str, refuse: str) -> tuple[int, str]:
    (folder / "test_it.py").write_text(code)
    words = [sys.executable, "-m", "pytest", "-p", "tests.skips", "-p", "no:cacheprovider"]
    words += ["--rootdir", str(folder), str(folder / "test_it.py")]
    done = subprocess.run(
        words, cwd=ROOT, env={"PATH": "", "REFUSE_SKIPS": refuse}, capture_output=True, text=True
    )
    return done.returncode, done.stdout


@pytest.mark.parametrize(
    ("code", "reason"),
    [(UNNAMED, "no_such_package"), (MODULE, "no_such_package"), (MARKED, "why not")],
)
def test_an_unnamed_skip_fails_where_skips_are_refused(
    tmp_path: Path, code: str, reason: str
) -> None:
    status, shown = run(tmp_path, code, "1")
    assert status in (1, 2)  # 2 if a whole file was skipped
    assert "say in tests/skips.py why" in shown
    assert reason in shown
    assert run(tmp_path, code, "")[0] in (0, 5)


@pytest.mark.parametrize("code", [LISTED, EXPECTED])
def test_a_listed_skip_and_an_expected_failure_pass(tmp_path: Path, code: str) -> None:
    assert run(tmp_path, code, "1")[0] == 0
