"""Profiles of hypothesis (HYPOTHESIS_PROFILE is dev or ci), and ``--update`` for golden files."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from pcsg.codecache import opened

# In CI the same examples are taken every time: a change is judged by itself, not by chance.
# Developers look further each time.
for profile, examples in (("dev", 50), ("ci", 300)):
    settings.register_profile(
        profile,
        max_examples=examples,
        deadline=None,
        derandomize="CI" in os.environ,
        suppress_health_check=[HealthCheck.too_slow],
    )
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "dev"))


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--update", action="store_true", help="write golden files anew instead of comparing them"
    )


@pytest.fixture
def update(request: pytest.FixtureRequest) -> bool:
    return bool(request.config.getoption("--update"))


@pytest.fixture
def kernel_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Return the folder of a cache of machine code that is empty, and this test's own."""
    monkeypatch.setenv("PCSG_CACHE", str(tmp_path / "cache"))
    opened.cache_clear()
    yield tmp_path / "cache" / "kernels"
    opened.cache_clear()
