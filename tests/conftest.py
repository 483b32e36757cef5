"""Fixtures of all tests; benches and engines are forked from warm servers (`lent`)."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import lent
import pytest

if TYPE_CHECKING:
    from tests.shared_runs import SharedRuns
    from tests.site_folder import SiteFolder


def pytest_configure(config: pytest.Config) -> None:
    """Install the servers where tests run: not in the process that only hands tests to workers."""
    if "PYTEST_XDIST_WORKER" in os.environ or not config.getoption("numprocesses", default=None):
        lent.install()


@pytest.fixture
def site_folder(tmp_path: Path) -> SiteFolder:
    """A folder with a product and a station file."""
    from tests.site_folder import SiteFolder

    return SiteFolder(tmp_path)


@pytest.fixture(scope="session")
def shared_runs(tmp_path_factory: pytest.TempPathFactory) -> SharedRuns:
    """Runs made once for all tests that only read what they left."""
    from tests.shared_runs import SharedRuns

    root = tmp_path_factory.getbasetemp()
    return SharedRuns((root.parent if "PYTEST_XDIST_WORKER" in os.environ else root) / "shared")
