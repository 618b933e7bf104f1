"""Settings of this folder's tests."""

from __future__ import annotations

from hypothesis import settings

# A shared machine may stall any example; time is no property under test here.
settings.register_profile("eea", deadline=None)
settings.load_profile("eea")
