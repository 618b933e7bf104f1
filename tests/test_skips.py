"""Where skips are refused, a test that is skipped unnamed fails, and says what to do."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FILES = {
    "unnamed": "import pytest\ndef test_it(): pytest.importorskip('no_such_package')\n",
    "module": "import pytest\npytest.importorskip('no_such_package')\ndef test_it(): pass\n",
    "marked": "import pytest\n@pytest.mark.skipif(True, reason='why')\ndef test_it(): pass\n",
    "listed": "import pytest\ndef test_it(): pytest.skip('no browser is installed here: x')\n",
    "expected": "import pytest\n@pytest.mark.xfail\ndef test_it(): assert False\n",
}


@pytest.mark.parametrize(
    ("refuse", "failed"), [("1", {"unnamed", "module", "marked"}), ("", set())]
)
def test_only_unnamed_skips_fail_and_only_where_skips_are_refused(
    tmp_path: Path, refuse: str, failed: set[str]
) -> None:
    for name, code in FILES.items():
        (tmp_path / f"test_{name}.py").write_text(code)
    words = [sys.executable, "-m", "pytest", "-p", "tests.skips", "-p", "no:cacheprovider"]
    words += ["--continue-on-collection-errors", "--rootdir", str(tmp_path), str(tmp_path)]
    done = subprocess.run(
        words, cwd=ROOT, env={"PATH": "", "REFUSE_SKIPS": refuse}, capture_output=True, text=True
    )
    assert done.returncode == bool(failed)
    assert set(re.findall(r"^(?:FAILED|ERROR) .*test_(\w+)\.py", done.stdout, re.M)) == failed
    assert ("say in tests/skips.py why" in done.stdout) == bool(failed)
