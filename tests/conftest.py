"""Fixtures of all tests; benches and engines are forked from warm servers (`lent`)."""

from pathlib import Path

import lent
import pytest

lent.install()

from tests.site_folder import SiteFolder  # noqa: E402 - after the servers are in place


@pytest.fixture
def site_folder(tmp_path: Path) -> SiteFolder:
    """A folder with a product and a station file."""
    return SiteFolder(tmp_path)
