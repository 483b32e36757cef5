"""The Operator page says that the validation of the installation must be repeated, and does not prevent a run."""

import pytest
from PySide6.QtWidgets import QPushButton

from calstation.records import append_audit
from calstation.validation.report import identity
from tests.gui.conftest import SERIAL, Operator, SiteFolder


@pytest.fixture
def updated(site_folder: SiteFolder) -> None:
    """An installation that was validated with another version of numpy."""
    versions = {**identity(), "numpy": "1.0"}
    append_audit(site_folder.home, "validation", "", verdict="passed", identity=versions, files={})


def test_an_update_is_shown_when_the_window_opens(updated: None, operator: Operator) -> None:
    notice = operator.widget("validation_notice")
    operator.until(notice.isVisible)
    assert "numpy 1.0 →" in operator.says()
    operator.scan(SERIAL)
    assert operator.widget("start_button", QPushButton).isEnabled()
