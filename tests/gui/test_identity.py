"""One person per window: runs, versions, releases and certificates have the same name, and never the login name."""

from typing import Any

import pytest
import tomli_w
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel, QLineEdit, QPushButton
from pytestqt.qtbot import QtBot

from calstation.config import (
    access,
    computer_user,
    library,
    versions,
)
from calstation.gui.settings import StationPage
from calstation.gui.shell.main_window import MainWindow
from calstation.gui.state.engine_link import EngineLink
from calstation.gui.text import language
from calstation.records import audit_path, read_audit
from tests.gui.conftest import SERIAL, Operator
from tests.prepared import prepare_run
from tests.site_folder import BENCH, STATION, SiteFolder

PIN = "246813"


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The requests of the runs that would be started."""
    requests: list[Any] = []
    monkeypatch.setattr(EngineLink, "start", lambda _, request: requests.append(request))
    return requests


def enter(operator: Operator, name: str, text: str) -> None:
    """Replace the text of an input by typing."""
    edit = operator.widget(name, QLineEdit)
    edit.setFocus()
    edit.selectAll()
    operator.qtbot.keyClick(edit, Qt.Key.Key_Delete)
    operator.qtbot.keyClicks(edit, text)


def unlock(operator: Operator, person: str | None, *, first: bool = True) -> None:
    """Enter the PIN, and a person unless the panel shows one."""
    operator.press("role_button")
    if person is not None:
        enter(operator, "role_person_edit", person)
    for name in ("pin_edit", "pin_again_edit") if first else ("pin_edit",):
        operator.qtbot.keyClicks(operator.widget(name, QLineEdit), PIN)
    operator.press("unlock_button")


def sign_in_station(site_folder: SiteFolder) -> None:
    """Write the station with badges."""
    badges = {"badge_pattern": r"B\d{4}", "names": {"B1234": "Li Na", "B5678": "Wang Fang"}}
    station = {**STATION, "bench": BENCH, "sign_in": badges}
    site_folder.station.write_text(tomli_w.dumps(station), encoding="utf-8")


@pytest.mark.long
@pytest.mark.parametrize("personal", [True, False])
def test_name_of_a_saved_file_is_authenticated_only_by_a_personal_pin(operator: Operator, personal: bool) -> None:
    site, own, app = operator.site_folder, "135790", operator.window.app
    names = {"B0001": "Li Na", "B0002": "Wang Wei"}
    badges = {"badge_pattern": r"B\d{4}", "engineers": [*names], "names": names}
    site.station.write_text(tomli_w.dumps({**STATION, "bench": BENCH, "sign_in": badges}), encoding="utf-8")
    app.set_station(site.station)
    access.set_pin("", PIN)
    access.set_pin(PIN, own, "B0001")
    operator.press("role_button")
    enter(operator, "role_person_edit", "B0001" if personal else "B0002")
    operator.qtbot.keyClicks(operator.widget("pin_edit", QLineEdit), own if personal else PIN)
    operator.press("unlock_button")
    assert app.role.engineer
    page = operator.window._tabs["station_page"].page
    assert isinstance(page, StationPage)
    page.drafts.station.set({("name",): "line 9"})
    assert page.save()
    event = read_audit(audit_path(library.site_folder())).entries[-1]
    person = "Li Na (B0001)" if personal else "Wang Wei (B0002)"
    assert (event.event, event.by, event.unproven) == ("file_saved", person, not personal)
    assert event.values["pin"] == ("personal" if personal else "site")


def test_pin_of_another_badge_does_not_unlock(operator: Operator) -> None:
    site, own, app = operator.site_folder, "135790", operator.window.app
    badges = {"badge_pattern": r"B\d{4}", "engineers": ["B0001", "B0002"]}
    site.station.write_text(tomli_w.dumps({**STATION, "bench": BENCH, "sign_in": badges}), encoding="utf-8")
    app.set_station(site.station)
    access.set_pin("", PIN)
    access.set_pin(PIN, own, "B0001")
    access.set_pin(PIN, own, "B0003")  # who is no longer an engineer
    for badge in ("B0002", "B0003"):
        assert not app.role.unlock(own, badge, app.engineer_badge(badge))
    assert app.role.unlock(own, "B0001", app.engineer_badge("B0001"))
    app.operator = app.badge = "B0002"  # another person signs in
    assert (app.author.by, app.author.pin) == ("B0002", None)


@pytest.mark.long
def test_entered_name_stands_in_every_record(operator: Operator, started: list[Any]) -> None:
    enter(operator, "operator_edit", "Li Na")
    operator.scan(SERIAL)
    operator.press("start_button")
    assert [request.operator for request in started] == ["Li Na"]
    unlock(operator, None)
    assert operator.window.app.role.engineer, "the name need not be entered twice"
    operator.window.show_page("engineer_page")
    assert operator.widget("engineer_name_edit", QLineEdit).text() == "Li Na"
    page = operator.window._tabs["station_page"].page
    assert isinstance(page, StationPage)
    page.drafts.station.set({("name",): "line 9"})
    assert page.save()
    assert versions.list_versions("stations", operator.site_folder.station.stem)[0].author == "Li Na"
    events = read_audit(audit_path(library.site_folder())).entries
    assert "pin_set" in [event.event for event in events]
    assert {event.by for event in events if event.event != "file_changed_outside"} == {"Li Na"}
    enter(operator, "engineer_name_edit", "Wang Fang")
    assert operator.widget("operator_edit", QLineEdit).text() == operator.window.app.person == "Wang Fang"


def test_login_name_is_not_the_operator_of_a_run(operator: Operator, started: list[Any]) -> None:
    operator.scan(SERIAL)
    operator.press("start_button")
    (request,) = started
    assert prepare_run(request).request.operator is None
    assert computer_user() is not None


def test_engineer_role_is_unlocked_by_a_person(operator: Operator) -> None:
    unlock(operator, None)
    assert not operator.window.app.role.engineer
    for code, words in (("en", "Enter your name or badge"), ("zh_CN", "请填写姓名或工牌")):
        language.use(code)
        operator.press("unlock_button")
        assert words in operator.says()
    language.use("en")
    enter(operator, "role_person_edit", "Wang Fang")
    operator.press("unlock_button")
    assert operator.window.app.role.engineer
    assert operator.widget("operator_edit", QLineEdit).text() == "Wang Fang"


@pytest.mark.parametrize(
    ("code", "hints", "remedies"),
    [
        ("en", ("your name", "scan your badge"), ("Enter your name or badge", "Scan your badge first.")),
        ("zh_CN", ("姓名", "扫描工牌"), ("请填写姓名或工牌", "请先扫描工牌。")),
    ],
)
def test_engineer_role_asks_for_a_badge_where_only_a_badge_is_accepted(
    operator: Operator, code: str, hints: tuple[str, str], remedies: tuple[str, str]
) -> None:
    app, person = operator.window.app, operator.widget("role_person_edit", QLineEdit)
    app.set_language(code)
    for hint, remedy in zip(hints, remedies, strict=True):
        app.role.ask()
        assert (person.placeholderText(), person.accessibleName()) == (hint, hint)
        operator.press("unlock_button")
        errors = [each.text() for each in person.parentWidget().findChildren(QLabel) if each.isVisible()]
        assert any(text.startswith(remedy) for text in errors)
        sign_in_station(operator.site_folder)
        app.set_station(operator.site_folder.station)


def test_sign_out_of_the_operator_locks_the_engineer_role(operator: Operator) -> None:
    sign_in_station(operator.site_folder)
    app = operator.window.app
    app.set_station(operator.site_folder.station)
    unlock(operator, "B9999")
    assert not app.role.engineer
    assert any("B9999" in label.text() for label in operator.window.findChildren(QLabel) if label.isVisible())
    enter(operator, "role_person_edit", "B5678")
    operator.press("unlock_button")
    assert app.role.engineer
    assert (app.operator, app.badge, app.person) == ("Wang Fang", "B5678", "Wang Fang")
    operator.press("sign_out_button")
    assert (app.operator, app.badge) == (None, None)
    assert (app.role.engineer, app.person) == (False, "")
    operator.scan("B1234")
    assert app.person == "Li Na"
    operator.press("sign_out_button")
    assert app.person == ""


@pytest.mark.parametrize("badges", [True, False])
def test_lock_signs_out_the_engineer_whom_unlocking_has_signed_in(operator: Operator, badges: bool) -> None:
    if badges:
        sign_in_station(operator.site_folder)
    app = operator.window.app
    app.set_station(operator.site_folder.station)
    person, name = ("B1234", "Li Na") if badges else ("Li Na", "Li Na")
    unlock(operator, person)
    assert (app.role.engineer, app.person) == (True, name)
    assert operator.widget("operator_edit", QLineEdit).text() == name
    operator.press("role_button")
    assert (app.role.engineer, app.person, app.operator) == (False, "", None)
    assert operator.widget("operator_edit", QLineEdit).text() == ""


def test_lock_keeps_an_operator_who_had_signed_in_before(operator: Operator) -> None:
    sign_in_station(operator.site_folder)
    app = operator.window.app
    app.set_station(operator.site_folder.station)
    operator.scan("B1234")
    unlock(operator, None)
    assert app.role.engineer
    operator.press("role_button")
    assert (app.role.engineer, app.person, app.badge) == (False, "Li Na", "B1234")


def test_engineer_role_is_locked_only_while_nobody_works(
    window: MainWindow, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    access.set_pin("", PIN)
    role, busy = window.app.role, [True]
    monkeypatch.setattr(role, "_busy", lambda: busy[0])
    role._idle.setInterval(300)
    assert role.unlock(PIN, "Wang Fang")
    for _ in range(8):
        qtbot.wait(60)
        qtbot.keyClick(window, Qt.Key.Key_Shift)
    assert role.engineer, "a person types"
    qtbot.wait(400)
    assert role.engineer, "a run is in progress"
    busy[0] = False
    qtbot.waitUntil(lambda: not role.engineer, timeout=3000)
    assert window.findChild(QPushButton, "role_button").text() == "Operator"
