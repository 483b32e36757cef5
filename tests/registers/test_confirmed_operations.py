"""Register writes outside a run are audited and confirmed by a second engineer if the product requires it."""

from dataclasses import replace
from pathlib import Path

import pytest

from calstation.cli.app import run_app
from calstation.config import Confirmation, RunRequest
from calstation.config import site_folder as site
from calstation.errors import ConfigurationError, InputError
from calstation.records import audit_path, read_audit
from calstation.registers import journal, target_registers
from calstation.results import Result
from tests.helpers import ignore_progress, raises_code
from tests.registers.operations import RegisterOperations
from tests.site_folder import SiteFolder

SERIAL = "SN-000042"
VALUES = {"gyro_bias_x": 1e-6}
BOTH = Confirmation("B0001", "B0002", "personal")


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "home"))


def test_manual_write_is_in_the_audit_trail(site_folder: SiteFolder) -> None:
    operations = RegisterOperations(replace(site_folder.request(), operator="wang"))
    operations.write(VALUES, at_rest=True)
    (event,) = read_audit(audit_path(site())).entries
    assert (event.event, event.by, event.confirmed_by) == ("registers", "wang", None)
    assert event.values == {"serial": SERIAL, "what": "write", "source": "x.h5", "station": "test bench", "pin": None}


def test_without_the_second_engineer_nothing_is_written(site_folder: SiteFolder) -> None:
    site_folder.write({"confirmation": {"required_for": ["registers"]}})
    request = replace(site_folder.request(), operator="B0001")
    with raises_code(ConfigurationError, "confirmation.registers_required"):
        RegisterOperations(request).write(VALUES, at_rest=True)
    assert not journal.history(request.out, SERIAL)
    assert not read_audit(audit_path(site())).entries
    RegisterOperations(request).do("write", VALUES, at_rest=True, people=BOTH)
    assert journal.history(request.out, SERIAL)[-1].closing == "done"
    (event,) = read_audit(audit_path(site())).entries
    assert (event.by, event.confirmed_by, event.values["pin"]) == ("B0001", "B0002", "personal")


def another_product(site_folder: SiteFolder) -> Path:
    """A product for the same units that requires no second engineer."""
    own = site_folder.product.read_text(encoding="utf-8")
    site_folder.write({"name": "lenient"})
    lenient = site_folder.product.rename(site_folder.product.with_name("lenient.toml"))
    site_folder.product.write_text(own, encoding="utf-8")
    return lenient


def test_choosing_another_product_does_not_bypass_the_second_engineer(
    site_folder: SiteFolder, capsys: pytest.CaptureFixture[str]
) -> None:
    site_folder.write({"confirmation": {"required_for": ["registers"]}})
    request = site_folder.request()
    RegisterOperations(request).do("write", VALUES, at_rest=True, people=BOTH)
    lenient = another_product(site_folder)
    with raises_code(InputError, "transfer.other_product"):
        RegisterOperations(replace(request, product=lenient)).do("restore", at_rest=True)
    files = ["--station", str(site_folder.station), "--product", str(lenient), "--out", str(request.out)]
    assert run_app(["registers", "restore", SERIAL, *files, "--at-rest", "--yes"]) == InputError.exit_code
    assert "was made with product 'short', not with 'lenient'" in capsys.readouterr().err
    journal.begin(request.out, SERIAL, VALUES, VALUES, journal.Purpose("li", "run", "", transfer(request).unit_type))
    for what in ("finish", "restore"):
        with raises_code(InputError, "transfer.other_product"):
            RegisterOperations(replace(request, product=lenient)).do(what, at_rest=True)
    assert [event.event for event in read_audit(audit_path(site())).entries] == ["registers"]


def transfer(request: RunRequest) -> journal.Transfer:
    return journal.history(request.out, SERIAL)[-1]


def test_result_of_another_product_is_not_written(site_folder: SiteFolder) -> None:
    result = {
        "unit": {"serial": SERIAL},
        "product": "short",
        "parameters": {"gyro_bias_x": {"value": 1e-6, "sigma": 0.0}},
        "schema": "calstation.result/1",
        "stages": [],
        "outcome": "passed",
        "log": {"file": ""},
    }
    made, request = Result.from_json(result), site_folder.request()
    assert target_registers(ignore_progress, request, made).serial == SERIAL
    with raises_code(InputError, "transfer.result_other_product"):
        target_registers(ignore_progress, replace(request, product=another_product(site_folder)), made)
