"""A register write outside a run is in the audit trail; where the product requires it, a second engineer confirms."""

from dataclasses import replace
from pathlib import Path

import pytest

from calstation.config import site_folder as site
from calstation.errors import ConfigurationError
from calstation.records import audit_path, read_audit
from calstation.registers import journal
from tests.helpers import raises_code
from tests.registers.operations import Errands
from tests.site_folder import SiteFolder

SERIAL = "SN-000042"
VALUES = {"gyro_bias_x": 1e-6}


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "home"))


def test_a_write_by_hand_is_in_the_audit_trail(site_folder: SiteFolder) -> None:
    errands = Errands(replace(site_folder.request(), operator="wang"))
    errands.write(VALUES, at_rest=True)
    (event,) = read_audit(audit_path(site())).events
    assert (event.event, event.by, event.confirmed_by) == ("registers", "wang", None)
    assert event.values == {"serial": SERIAL, "what": "write", "source": "x.h5", "station": "test bench"}


def test_without_the_second_engineer_nothing_is_written(site_folder: SiteFolder) -> None:
    site_folder.write({"confirmation": {"required_for": ["registers"]}})
    request = replace(site_folder.request(), operator="B0001")
    with raises_code(ConfigurationError, "confirmation.registers_required"):
        Errands(request).write(VALUES, at_rest=True)
    assert not journal.history(request.out, SERIAL)
    assert not read_audit(audit_path(site())).events
    Errands(request).do("write", VALUES, at_rest=True, confirmed_by="B0002")
    assert journal.history(request.out, SERIAL)[-1].closing == "done"
    (event,) = read_audit(audit_path(site())).events
    assert (event.by, event.confirmed_by) == ("B0001", "B0002")
