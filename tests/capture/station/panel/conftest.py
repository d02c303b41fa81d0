"""A panel for each test, of a station that triggers fill."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from argon2 import PasswordHasher

from capture.sets.captured_set import CapturedSet
from capture.station.domain.users import Role
from tests.capture.station.panel.panels import PASSWORD, RunningPanel, running_panel
from tests.chromium import Chromium, chromium

QUICK = PasswordHasher(time_cost=1, memory_cost=8, parallelism=1)


@pytest.fixture(scope="session", autouse=True)
def quick_hashes() -> Iterator[None]:
    """Hash passwords in a millisecond."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("capture.station.domain.users.HASHER", QUICK)
        yield


@pytest.fixture
def panel(tmp_path: Path, captured: CapturedSet) -> Iterator[RunningPanel]:
    """A panel without users, on this machine."""
    with running_panel(tmp_path / "line-1", captured) as running:
        yield running


@pytest.fixture(scope="session")
def with_users(
    tmp_path_factory: pytest.TempPathFactory, captured: CapturedSet
) -> Iterator[RunningPanel]:
    """A panel with a user of each role, called like it, that tests share."""
    with running_panel(tmp_path_factory.mktemp("users") / "line-1", captured) as running:
        for role in Role:
            running.panel.users.put(role, role, PASSWORD)
        yield running


@pytest.fixture(scope="session")
def without_users(
    tmp_path_factory: pytest.TempPathFactory, captured: CapturedSet
) -> Iterator[RunningPanel]:
    """A panel without users that tests share."""
    with running_panel(tmp_path_factory.mktemp("nobody") / "line-1", captured) as running:
        yield running


@pytest.fixture(scope="session")
def started_browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    with chromium(tmp_path_factory.mktemp("profile")) as running:
        yield running


@pytest.fixture
def browser(started_browser: Chromium) -> Iterator[Chromium]:
    """A browser without cookies."""
    with started_browser.anew() as running:
        yield running
