"""Operator page, engineer page and command line ask the same questions before a run and start the same run."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import date
from typing import Any

import pytest
import tomli_w
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QApplication, QLineEdit, QPushButton

from calstation.cli import run as run_module
from calstation.cli.app import run_app
from calstation.config import RunRequest, access
from calstation.gui.operator import ask
from calstation.gui.state.engine_link import EngineLink
from calstation.messages import Text
from calstation.results import History
from calstation.runs import RunStart, finish_incomplete
from tests.database.result_files import write_result
from tests.dead_logs import write_dead_log
from tests.gui.conftest import SERIAL, Operator
from tests.open_transfers import WRITTEN, write_open_transfer
from tests.site_folder import STATION, SiteFolder

PIN = "246813"
OVERDUE = [{"name": "Rate table A", "kind": "table", "due": date(2021, 3, 2)}]
SLOTS = [{"name": name, "port": f"socket://127.0.0.1:{port}"} for name, port in (("A", 7), ("B", 8))]
PORTS = {"table": {"profile": "bench", "port": "tcp://127.0.0.1:9"}}

#: The pages that start a run; the engineer page asks the same questions.
PAGES = ["operator_page", pytest.param("engineer_page", marks=pytest.mark.long)]


class Page:
    """Starts runs on a page of the window, in the role of an engineer."""

    def __init__(self, operator: Operator, page: str) -> None:
        self.operator, self.prefix = operator, "engineer_" if page == "engineer_page" else ""
        access.set_pin("", PIN)
        operator.window.app.role.unlock(PIN)
        operator.window.app.set_station(operator.site_folder.station)
        operator.window.show_page(page)

    def start(self, *serials: str) -> None:
        """Enter the units and press START."""
        edit = self.operator.widget(f"{self.prefix}serial_edit", QLineEdit)
        for serial in serials:
            edit.clear()
            self.operator.qtbot.keyClicks(edit, serial)
            if len(serials) > 1:
                self.operator.qtbot.keyClick(edit, Qt.Key.Key_Return)
        self.operator.press(f"{self.prefix}start_button")
        if self.prefix and len(serials) > 1:  # the first press shows the slots
            self.operator.press(f"{self.prefix}start_button")

    def asked(self) -> str:
        """Return the texts of the page."""
        return self.operator.says()

    def answer(self, name: str) -> None:
        """Press the button of an answer, and permit an override."""
        choices = self.operator.window.findChildren(QPushButton, f"{name}_choice")
        self.operator.qtbot.mouseClick(next(b for b in choices if b.isVisible()), Qt.MouseButton.LeftButton)
        if name == "override":
            for key, text in (("reason", "at the laboratory"), ("badge", "Li Na"), ("pin", PIN)):
                edit = self.operator.widget(f"{self.prefix}override_{key}_edit", QLineEdit)
                edit.clear()
                self.operator.qtbot.keyClicks(edit, text)
            self.operator.press(f"{self.prefix}override_confirm_button")


class Terminal:
    """Starts runs with the command line, whose questions it answers on a terminal."""

    def __init__(self, site: SiteFolder, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
        access.set_pin("", PIN)
        self._site, self._capsys, self._shown = site, capsys, ""
        self._units: tuple[str, ...] = ()
        self._answers: Iterator[bool] = iter(())
        monkeypatch.setattr("sys.stdin.isatty", lambda: True)
        monkeypatch.setattr("typer.confirm", lambda question, err: next(self._answers, False))
        monkeypatch.setattr("typer.prompt", lambda text, **options: PIN if "PIN" in text else "at the laboratory")

    def start(self, *serials: str) -> None:
        """Run the command for the units, and answer no."""
        self._units = serials
        self._run(())

    def _run(self, answers: tuple[bool, ...]) -> None:
        units = [word for serial in self._units for word in ("--serial", serial)]
        self._answers = iter(answers)
        where = ("--station", self._site.station, "--product", self._site.product, "--out", self._site.runs)
        run_app([str(word) for word in ("run", *where, *units, "--operator", "Li Na")])
        self._shown = self._capsys.readouterr().err

    def asked(self) -> str:
        """Return the output of the command."""
        return self._shown

    def answer(self, name: str) -> None:
        """Run the command again, and answer yes to the question named by the answer."""
        self._run((False, True) if name in ("anew", "finish") else (True,))


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[RunRequest]:
    """The requests of runs, recorded instead of starting an engine."""
    requests: list[RunRequest] = []

    def record(request: RunRequest, **options: object) -> Iterator[Any]:
        requests.append(request)
        yield from ()

    monkeypatch.setattr(EngineLink, "start", lambda _, order: requests.append(order))
    monkeypatch.setattr(run_module, "engine_events", record)
    return requests


@pytest.fixture(params=[*PAGES, "terminal"])
def front_end(request: pytest.FixtureRequest, site_folder: SiteFolder) -> Callable[[], Page | Terminal]:
    """Function that opens a front end with the current files of the site."""
    if request.param == "terminal":
        monkeypatch, capsys = (request.getfixturevalue(name) for name in ("monkeypatch", "capsys"))
        return lambda: Terminal(site_folder, monkeypatch, capsys)
    operator = request.getfixturevalue("operator")
    return lambda: Page(operator, request.param)


def passed(site: SiteFolder) -> None:
    """Store a passed run of the unit as another product."""
    write_result(site.runs, f"{SERIAL}_1", 1, serial=SERIAL, product="MEMS 7")


def known_in_other_case(site: SiteFolder) -> None:
    """Store a stopped run of a unit whose serial number differs only by lower case."""
    write_result(site.runs, f"{SERIAL.lower()}_1", 1, serial=SERIAL.lower(), outcome="stopped", product="short")


def failed(site: SiteFolder) -> None:
    """Allow one attempt, and store a failed run of the unit."""
    site.write({"attempts_allowed": 1})
    write_result(site.runs, f"{SERIAL}_1", 1, serial=SERIAL, outcome="failed", product="short")


def overdue(site: SiteFolder) -> None:
    """Use a station whose table has an expired certificate."""
    site.write(station={"instruments": OVERDUE})


def hardware(site: SiteFolder) -> None:
    """Use a station with a real table."""
    station = {**STATION, **PORTS, "name": "line 3", "imu": {"port": "socket://127.0.0.1:9"}}
    site.station.write_text(tomli_w.dumps(station), encoding="utf-8")


def interrupted(site: SiteFolder) -> None:
    """Store an incomplete run of another unit."""
    write_dead_log(site.runs)
    finish_incomplete(site.runs)


def interrupted_transfer(site: SiteFolder, *serials: str) -> None:
    """Record that writing the registers of units was interrupted."""
    for serial in serials or (SERIAL,):
        write_open_transfer(site.runs, serial)


def unverified(site: SiteFolder, *serials: str) -> None:
    """Record that registers were written to units, but not verified."""
    for serial in serials or (SERIAL,):
        write_open_transfer(site.runs, serial, *WRITTEN)


CASES: dict[str, tuple[Callable[[SiteFolder], None], str, str, dict[str, object]]] = {
    "transfer": (
        interrupted_transfer,
        f"Writing the registers of {SERIAL} was interrupted",
        "restore",
        {"unfinished": "restore"},
    ),
    "verification": (
        unverified,
        f"The new registers of {SERIAL} are written, but not verified",
        "finish",
        {"unfinished": "finish"},
    ),
    "spelling": (known_in_other_case, f"Known as {SERIAL.lower()}, not as {SERIAL}", "other_unit", {}),
    "passed": (passed, ", as MEMS 7. Calibrate it once more?", "repeat", {}),
    "attempts": (
        failed,
        "As short, it was outside its limits 1 time in a row. Allow one more attempt?",
        "beyond",
        {"beyond_attempts": True},
    ),
    "standard": (
        overdue,
        "the calibration of 'Rate table A' of station 'test bench' was due on 2021-03-02",
        "override",
        {"override_standard": "at the laboratory"},
    ),
    "table_moves": (hardware, "The table of 'line 3' will move", "clear", {}),
    "resume": (
        interrupted,
        "SN-000003 was interrupted in stage 2, ",
        "anew",
        {"serial": "SN-000003", "resume": None},
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_question_is_asked_and_its_answer_starts_the_run(
    case: str,
    front_end: Callable[[], Page | Terminal],
    site_folder: SiteFolder,
    started: list[RunRequest],
) -> None:
    prepare, question, answer, expected = CASES[case]
    site_folder.runs.mkdir()
    prepare(site_folder)
    History(site_folder.runs).refresh()
    opened = front_end()
    opened.start(str(expected.get("serial", SERIAL)))
    assert question in opened.asked()
    assert started == []
    opened.answer(answer)
    (request,) = started
    assert replace(request, **expected) == request  # type: ignore[arg-type]
    assert (request.serial, request.serials) == (expected.get("serial", SERIAL), ())


def test_units_in_slots_are_asked_about_together_and_run_as_a_batch(
    front_end: Callable[[], Page | Terminal], site_folder: SiteFolder, started: list[RunRequest]
) -> None:
    site_folder.runs.mkdir()
    station = {**STATION, **PORTS, "name": "line 3", "slots": SLOTS}
    site_folder.station.write_text(tomli_w.dumps(station), encoding="utf-8")
    opened = front_end()
    opened.start("SN-000001", "SN-000002")
    assert "The table of 'line 3' will move" in opened.asked()
    assert started == []
    opened.answer("clear")
    (request,) = started
    assert request.serials == ("SN-000001", "SN-000002")
    assert request.batch


@pytest.mark.parametrize(
    ("page", "language", "said"),
    [
        (
            "operator_page",
            "en",
            "As short, it was outside its limits 1 time in a row. An engineer can allow one more attempt",
        ),
        ("engineer_page", "zh_CN", "按产品型号“short”，它已连续 1 次超出限差。工程师可以再允许一次"),
    ],
)
def test_operator_cannot_allow_another_attempt(
    page: str, language: str, said: str, operator: Operator, started: list[RunRequest]
) -> None:
    operator.window.app.set_language(language)
    operator.site_folder.runs.mkdir()
    failed(operator.site_folder)
    History(operator.site_folder.runs).refresh()
    opened = Page(operator, page)
    operator.window.app.role.lock()
    opened.start(SERIAL)
    assert said in opened.asked()
    assert operator.window.findChild(QPushButton, "beyond_choice") is None
    opened.answer("unlock")
    assert started == []


@pytest.mark.long
@pytest.mark.parametrize("page", PAGES)
def test_permission_asked_for_is_dropped_with_its_station(
    page: str, operator: Operator, started: list[RunRequest]
) -> None:
    operator.site_folder.runs.mkdir()
    overdue(operator.site_folder)
    opened = Page(operator, page)
    opened.start(SERIAL)
    choices = operator.window.findChildren(QPushButton, "override_choice")
    operator.qtbot.mouseClick(next(b for b in choices if b.isVisible()), Qt.MouseButton.LeftButton)
    edit = operator.widget(f"{opened.prefix}override_reason_edit", QLineEdit)
    assert edit.isVisible()
    operator.window.app.set_station(None)
    assert not edit.isVisible()
    assert started == []


@pytest.mark.parametrize("case", [case for case in CASES if case not in ("spelling", "transfer", "verification")])
def test_command_without_a_terminal_names_the_option_and_refuses_what_needs_a_person(
    case: str, site_folder: SiteFolder, capsys: pytest.CaptureFixture[str], started: list[RunRequest]
) -> None:
    prepare, _, _, expected = CASES[case]
    site_folder.runs.mkdir()
    prepare(site_folder)
    where = ("--station", site_folder.station, "--product", site_folder.product, "--out", site_folder.runs)
    run = [str(word) for word in ("run", *where, "--serial", expected.get("serial", SERIAL))]
    repeated = case in ("passed", "resume")  # harmless, as scripts do it
    code = run_app(run)
    assert (code == 2) != repeated
    option = {
        "passed": ["--again"],
        "attempts": ["--beyond-attempts"],
        "standard": ["--override-standard", "at the laboratory"],
        "table_moves": ["--yes"],
        "resume": ["--restart"],
    }[case]
    assert option[0] in capsys.readouterr().err
    assert len(started) == repeated
    run_app([*run, *option])
    request = started[-1]
    assert option[0] not in capsys.readouterr().err
    assert replace(request, **expected) == request  # type: ignore[arg-type]


def test_command_without_a_terminal_leaves_an_interrupted_transfer_to_the_check_of_the_unit(
    site_folder: SiteFolder, capsys: pytest.CaptureFixture[str], started: list[RunRequest]
) -> None:
    unverified(site_folder)
    where = ("--station", site_folder.station, "--product", site_folder.product, "--out", site_folder.runs)
    run_app([str(word) for word in ("run", *where, "--serial", SERIAL)])
    assert f"New registers are written, but not verified: {SERIAL}." in capsys.readouterr().err
    assert started[0].unfinished is None, "the engine refuses the run unless the unit has its old registers"


def test_command_without_a_terminal_names_the_known_spelling(
    site_folder: SiteFolder, capsys: pytest.CaptureFixture[str], started: list[RunRequest]
) -> None:
    site_folder.runs.mkdir()
    known_in_other_case(site_folder)
    where = ("--station", site_folder.station, "--product", site_folder.product, "--out", site_folder.runs)
    run_app([str(word) for word in ("run", *where, "--serial", SERIAL)])
    assert f"If it is the same unit, give its serial number as {SERIAL.lower()}." in capsys.readouterr().err
    assert [request.serial for request in started] == [SERIAL]


@pytest.mark.parametrize(
    ("language", "sentence"),
    [("en", "scan sn-000042 again; or go on if it is another unit."), ("zh_CN", "再重新扫描 sn-000042；如果")],
)
def test_question_about_another_spelling_names_units_of_a_batch_and_can_be_cancelled(
    operator: Operator, started: list[RunRequest], language: str, sentence: str
) -> None:
    operator.site_folder.write(units=3)
    operator.site_folder.runs.mkdir(exist_ok=True)
    known_in_other_case(operator.site_folder)
    write_result(operator.site_folder.runs, "SN-000002_1", 1, serial="SN-000002", outcome="failed")
    write_result(operator.site_folder.runs, "sn-000002_1", 1, serial="sn-000002", outcome="failed")
    History(operator.site_folder.runs).refresh()
    operator.window.app.set_language(language)
    operator.window.app.set_station(operator.site_folder.station)
    for serial in (SERIAL, "SN-000002", "SN-000003"):
        operator.scan(serial)
    operator.press("start_button")
    assert sentence in operator.says()
    assert operator.widget("cancel_choice").hasFocus()
    operator.press("cancel_choice")
    assert started == []
    operator.press("start_button")
    operator.press("other_unit_choice")
    (request,) = started
    assert request.serials == (SERIAL, "SN-000002", "SN-000003")


@pytest.mark.parametrize(("language", "question"), [("en", "but not verified"), ("zh_CN", "新寄存器已写入，")])
def test_unverified_registers_are_asked_about_at_the_scan(
    operator: Operator, started: list[RunRequest], language: str, question: str
) -> None:
    unverified(operator.site_folder)
    operator.window.app.set_language(language)
    operator.scan(SERIAL)
    assert question in operator.says()
    start = operator.widget("start_button")
    assert not start.isEnabled()
    assert not {"READY", "可以开始"} & set(operator.says().splitlines())
    operator.press("finish_choice")
    (request,) = started
    assert (request.serial, request.unfinished) == (SERIAL, "finish")


def test_other_questions_follow_the_one_about_unverified_registers(site_folder: SiteFolder) -> None:
    site_folder.runs.mkdir(exist_ok=True)
    passed(site_folder)
    unverified(site_folder)
    History(site_folder.runs).refresh()
    start = RunStart(RunRequest(SERIAL, site_folder.station, site_folder.product, out=site_folder.runs), "operator")
    question = start.next_question()
    assert question is not None
    assert question.subject == "transfer"
    start.answer(question, "finish")
    following = start.next_question()
    assert following is not None
    assert (following.subject, start.request.unfinished) == ("passed", "finish")


@pytest.mark.long
@pytest.mark.parametrize("page", ["operator_page", "engineer_page"])
@pytest.mark.parametrize("key", [Qt.Key.Key_Space, Qt.Key.Key_Return])
def test_no_key_confirms_a_start_after_a_return_to_its_question(
    operator: Operator, started: list[RunRequest], page: str, key: Qt.Key
) -> None:
    operator.site_folder.runs.mkdir()
    passed(operator.site_folder)
    History(operator.site_folder.runs).refresh()
    opened = Page(operator, page)
    opened.start(SERIAL)
    other, edit = ("engineer_page", "engineer_serial_edit") if page == "operator_page" else ("operator_page", "")
    operator.window.show_page(other)
    if edit:  # which is above the page
        operator.widget(edit, QLineEdit).setFocus()
        operator.qtbot.keyClicks(operator.widget(edit, QLineEdit), "SN-000077")
        operator.qtbot.keyClick(operator.widget(edit, QLineEdit), Qt.Key.Key_Return)
    bar = operator.window.page_tabs.tabBar()
    shown = next(i for i in range(bar.count()) if operator.window.page_tabs.widget(i).objectName() == page)
    operator.qtbot.mouseClick(bar, Qt.MouseButton.LeftButton, pos=bar.tabRect(shown).center())
    focused = QApplication.focusWidget()
    assert focused is not None
    assert focused.objectName() == "cancel_choice"
    operator.qtbot.keyClick(focused, key)
    assert started == []


def ask_about_a_passed_unit(operator: Operator, page: str, language: str) -> None:
    """Start a run of a unit that has passed, on a page in a language, and leave its question open."""
    operator.site_folder.runs.mkdir()
    passed(operator.site_folder)
    History(operator.site_folder.runs).refresh()
    operator.window.app.set_language(language)
    Page(operator, page).start(SERIAL)


@pytest.mark.long
@pytest.mark.parametrize(
    ("language", "said", "ready"),
    [
        ("en", "Answer the question on the Operator page first.", "READY"),
        ("zh_CN", "请先到操作员页回答问题。", "就绪"),
    ],
)
def test_other_pages_name_the_question_on_the_operator_page(
    operator: Operator, started: list[RunRequest], language: str, said: str, ready: str
) -> None:
    ask_about_a_passed_unit(operator, "operator_page", language)
    for page in ("history_page", "engineer_page"):
        operator.window.show_page(page)
        if page == "engineer_page":
            operator.widget("engineer_serial_edit", QLineEdit).clear()
            operator.qtbot.keyClicks(operator.widget("engineer_serial_edit", QLineEdit), "SN-000077")
        lines = operator.says().splitlines()
        assert said in lines
        assert ready not in lines
    start = operator.widget("engineer_start_button", QPushButton)
    assert not start.isEnabled()
    operator.window.show_page("operator_page")
    assert said not in operator.says()
    operator.press("cancel_choice")
    operator.window.show_page("engineer_page")
    assert start.isEnabled(), start.toolTip()
    assert ready in operator.says().splitlines()


@pytest.mark.long
@pytest.mark.parametrize(
    ("language", "said", "ready"),
    [
        ("en", "Answer the question on the Engineer page first.", "READY"),
        ("zh_CN", "请先到工程师页回答问题。", "就绪"),
    ],
)
def test_other_pages_name_the_question_on_the_engineer_page(
    operator: Operator, started: list[RunRequest], language: str, said: str, ready: str
) -> None:
    ask_about_a_passed_unit(operator, "engineer_page", language)
    assert said not in operator.says()
    start = operator.widget("start_button", QPushButton)
    for page in ("history_page", "operator_page"):
        operator.window.show_page(page)
        lines = operator.says().splitlines()
        assert said in lines
        assert ready not in lines
    operator.widget("serial_edit", QLineEdit).setText("SN-000077")
    assert (start.isEnabled(), start.toolTip()) == (False, said)
    operator.window.show_page("engineer_page")
    operator.press("cancel_choice")
    operator.window.show_page("operator_page")
    assert start.isEnabled(), start.toolTip()
    assert ready in operator.says().splitlines()


@pytest.mark.long
def test_no_key_answers_a_question_without_a_safe_answer_after_a_return_to_it(operator: Operator) -> None:
    notice, answered = operator.window.operator_page.notice, list[str]()
    ask(notice, "paused", Text.of("question.same_units", serials=[SERIAL]), {"same_units": lambda: answered.append("")})
    assert operator.widget("same_units_choice") is not QApplication.focusWidget()
    for shown in ("history_page", "operator_page"):
        operator.window.show_page(shown)
    focused = QApplication.focusWidget()
    assert focused is notice
    operator.qtbot.keyClick(focused, Qt.Key.Key_Space)
    assert answered == []


def test_unverified_registers_of_several_units_are_asked_about_together(
    operator: Operator, started: list[RunRequest]
) -> None:
    unverified(operator.site_folder, "SN-000001", "SN-000003")
    operator.site_folder.write(units=3)
    operator.window.app.set_station(operator.site_folder.station)
    for serial in ("SN-000001", "SN-000002", "SN-000003"):
        operator.scan(serial)
    operator.press("start_button")
    assert "New registers are written, but not verified: SN-000001, SN-000003" in operator.says()
    assert started == []
    operator.press("restore_choice")
    (request,) = started
    assert (len(request.serials), request.unfinished) == (3, "restore")


def test_next_unit_of_the_virtual_bench_has_not_passed(site_folder: SiteFolder, started: list[RunRequest]) -> None:
    site_folder.runs.mkdir()
    write_result(site_folder.runs, "SN-000001_1", 1, serial="SN-000001")
    where = ("--station", site_folder.station, "--product", site_folder.product, "--out", site_folder.runs)
    run_app([str(word) for word in ("run", *where)])
    run_app([str(word) for word in ("run", *where, "--seed", "5")])
    assert [request.serial for request in started] == ["SN-000002", "SN-000001"]
