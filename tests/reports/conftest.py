"""Every test has a site of its own, so that its audit trail knows no other certificates."""

from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The site's folder."""
    folder = tmp_path / "home"
    monkeypatch.setenv("CALSTATION_HOME", str(folder))
    return folder
