"""Fixtures of the tests of logs."""

from __future__ import annotations

import io
from contextlib import redirect_stderr, redirect_stdout

import pytest

from eea.logs.tables import read_streams


@pytest.fixture
def read_here(monkeypatch):
    """Read logs in this process: hundreds of processes take minutes to start."""

    def read(path, format_name, _size, remarks):
        said = io.StringIO()
        with redirect_stdout(said), redirect_stderr(said):
            return list(read_streams(path, format_name, remarks))

    monkeypatch.setattr("eea.logs.tables.read_in_child", read)
