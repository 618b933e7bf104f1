"""A skipped test fails where ``REFUSE_SKIPS`` is set, unless its reason is listed here."""

from __future__ import annotations

import os
from collections.abc import Generator
from typing import Any

import pytest

#: The beginning of a skip's reason, and why a complete installation may lack what it names.
MAY_BE_SKIPPED = {
    "no browser is installed here": "pip has none, and apt is not everywhere",
    "Xvfb is not installed": "pip has none, and apt is not everywhere",
    "could not import 'jax'": "no extra has it",
    "needs tkinter": "Python may be built without it",
    "no GPU is here": "few machines have one",
    "there is no C compiler, cc": "pip has none",
    "there is no JavaScript engine, node": "pip has none, and apt is not everywhere",
    "the tests of": "other projects' tests need their repositories, which are not everywhere",
    "this machine cannot run": "another processor's instructions",
}


def refused(report: Any) -> bool:
    """Return whether a report is of a skip that must not be; make it a failure."""
    if not (os.environ.get("REFUSE_SKIPS") and report.skipped) or hasattr(report, "wasxfail"):
        return False
    place, line, reason = report.longrepr
    reason = reason.removeprefix("Skipped: ")
    if reason.startswith(tuple(MAY_BE_SKIPPED)):
        return False
    report.outcome = "failed"
    report.longrepr = (
        f"{place}:{line}: skipped, although REFUSE_SKIPS is set: {reason}\n"
        "Install what it needs, or say in tests/skips.py why it may be skipped."
    )
    return True


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    refused(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    report = yield
    refused(report)
    return report
