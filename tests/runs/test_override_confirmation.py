"""Overrides before a run are confirmed with a PIN if the site has one, and are in the audit trail."""

from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import pytest
import tomli_w
import typer

from calstation.cli.confirmation import confirm_override
from calstation.config import Confirmation, RunRequest, access
from calstation.errors import ConfigurationError
from calstation.records import AuditEvent, audit_path, read_audit, restart_trail
from calstation.runs import RunStart, prepare
from calstation.sequencer import Control
from tests.helpers import raises_code
from tests.results.test_history import write
from tests.site_folder import ONE_STAGE, SiteFolder

OVERDUE = {"name": "rate table", "kind": "table", "due": date(2020, 1, 2)}
REASON = "table is at the laboratory"
ENGINEERS = {"badge_pattern": r"B\d{4}", "engineers": ["B0001", "B0002"]}


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "home"))
    return tmp_path / "home"


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Prompts on the terminal, answered with the site PIN."""
    questions: list[str] = []

    def prompt(question: str, **options: object) -> str:
        questions.append(question)
        return "000000"

    monkeypatch.setattr(typer, "prompt", prompt)
    return questions


def overdue(site: SiteFolder, **station: Any) -> RunRequest:
    """Request a run at a station with an overdue table certificate."""
    text = site.station.read_text(encoding="utf-8")
    site.station.write_text(tomli_w.dumps({"instruments": [OVERDUE]}) + text + tomli_w.dumps(station), encoding="utf-8")
    return site.request()


def confirmed(request: RunRequest) -> RunRequest:
    """Return the request of a run that is permitted despite the certificate."""
    start = RunStart(request, "operator")
    question = start.next_question()
    assert question is not None
    assert (question.subject, question.refusal.code) == ("standard", "quality.standard_certificate")
    confirm_override(start, REASON, None)
    assert start.next_question() is None
    return start.request


def prepared(site: SiteFolder, request: RunRequest) -> None:
    prepare(request, site.events.append, Control())


def events(home: Path, name: str) -> list[AuditEvent]:
    return [each for each in read_audit(audit_path(home)).entries if each.event == name]


def test_override_requires_a_pin_at_a_site_with_a_pin(site_folder: SiteFolder, home: Path, asked: list[str]) -> None:
    access.set_pin("", "000000")
    request = overdue(site_folder)
    with raises_code(ConfigurationError, "confirmation.standard_required"):
        prepared(site_folder, replace(request, override_standard=REASON))
    assert not events(home, "standard_overridden")
    permitted = confirmed(request)
    assert asked == ["PIN of tester"]
    assert permitted.overridden_by == Confirmation("tester", pin="site")
    prepared(site_folder, permitted)
    (event,) = events(home, "standard_overridden")
    assert (event.by, event.why) == ("tester", REASON)
    access.set_pin("000000", "111111")
    with raises_code(ConfigurationError, "confirmation.wrong_pin"):
        confirmed(request)


def test_station_with_engineers_asks_for_an_engineers_pin(site_folder: SiteFolder, asked: list[str]) -> None:
    request = overdue(site_folder, sign_in=ENGINEERS)
    with raises_code(ConfigurationError, "confirmation.not_engineer"):
        confirmed(replace(request, operator="B0003"))
    request = replace(request, operator="B0001")
    with raises_code(ConfigurationError, "confirmation.standard_required"):
        prepared(site_folder, replace(request, override_standard=REASON))
    access.set_pin("", "999999")
    access.set_pin("999999", "000000", "B0001")
    prepared(site_folder, confirmed(request))


def test_override_requires_only_a_reason_at_a_site_without_a_pin(
    site_folder: SiteFolder, home: Path, asked: list[str]
) -> None:
    prepared(site_folder, confirmed(overdue(site_folder)))
    assert not asked
    (event,) = events(home, "standard_overridden")
    assert event.by == "tester"


def test_attempt_beyond_the_allowed_number_is_in_the_audit_trail(site_folder: SiteFolder, home: Path) -> None:
    site_folder.write({"attempts_allowed": 1})
    request = replace(site_folder.request(), beyond_attempts=True)
    prepared(site_folder, request)
    assert not events(home, "attempt_allowed"), "the first attempt needs no permission"
    write(request.out, "another product", request.serial, "failed", 1)
    prepared(site_folder, request)
    assert not events(home, "attempt_allowed"), "failures as another product do not count"
    write(request.out, "a", request.serial, "failed", 2, product="short", attempt=2)
    with raises_code(ConfigurationError, "run.attempts_used"):
        prepared(site_folder, site_folder.request())
    assert not events(home, "attempt_allowed")
    prepared(site_folder, request)
    (event,) = events(home, "attempt_allowed")
    assert event.by == "tester"
    about = {"serial": request.serial, "failures": 1, "allowed": 1, "product": "short", "station": "test bench"}
    assert event.values == {**about, "pin": None}
    prepared(site_folder, replace(request, allowed_by=Confirmation("Li Na (B1234)", pin="personal")))
    event = events(home, "attempt_allowed")[-1]
    assert (event.by, event.values["pin"]) == ("Li Na (B1234)", "personal")


def test_no_run_that_writes_registers_starts_on_a_changed_audit_trail(site_folder: SiteFolder, home: Path) -> None:
    access.set_pin("", "000000")
    prepared(site_folder, site_folder.request())
    audit_path(home).unlink()
    with raises_code(ConfigurationError, "audit.broken"):
        prepared(site_folder, site_folder.request())
    restart_trail(home, "li", "disk repaired", None)
    prepared(site_folder, site_folder.request())


def test_start_warns_about_limits_that_no_stage_of_the_product_judges(site_folder: SiteFolder) -> None:
    site_folder.write({"stages": ["six_position"]})
    (warning,) = RunStart(site_folder.request(), "engineer").warnings
    assert (warning.code, warning.values["names"]) == ("run.unjudged_limits", ("gyro_bias", "gyro_scale"))
    site_folder.write(ONE_STAGE)
    assert RunStart(site_folder.request(), "engineer").warnings == []
