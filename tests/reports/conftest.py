"""Every test has a separate site, so that its audit trail contains no other certificates."""

from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The site folder."""
    folder = tmp_path / "home"
    monkeypatch.setenv("CALSTATION_HOME", str(folder))
    return folder
