"""Fixtures that all tests share."""

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile("ci", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow])
if os.environ.get("CI") == "true":
    settings.load_profile("ci")


@pytest.fixture(scope="session")
def mocap() -> Path:
    """Folder of real capture; tests that need it skip without one, and fail where CI should have had it."""
    folder = os.environ.get("CROWDSIM_MOCAP", "")
    if folder and Path(folder).is_dir():
        return Path(folder)
    reason = f"CROWDSIM_MOCAP names no folder with capture ({folder!r})"
    if os.environ.get("CI") == "true":
        pytest.fail(reason)
    pytest.skip(reason)
