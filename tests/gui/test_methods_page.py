"""Methods in the log workspace: recordings are simulated, opened, solved, plotted, refused and exported."""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QApplication, QComboBox, QFileDialog, QLabel, QPushButton
from pytestqt.qtbot import QtBot

from calstation.config import RunRequest, library, pair_folder
from calstation.connection import OtherUnit, PairProcess, PairStatus
from calstation.errors import CalstationError, InputError
from calstation.estimation.common import SampleBlock
from calstation.estimation.pairs import WatchEvent
from calstation.gui.logs.methods import MethodPanel, pair_live
from calstation.gui.logs.methods.pair_parts import event_sentence
from calstation.gui.operator import advice
from calstation.gui.shell.main_window import MainWindow
from calstation.gui.state.run_strip import needs_no_run, run_badge
from calstation.gui.text import check_text, language
from calstation.gui.widgets import ChecksTable, theme
from calstation.judgement import Check
from calstation.records import CheckKind, context_from_meta, export_csv, load_pair, open_log, prior_from_meta
from calstation.results import CorrectedTrace, PairProgress
from calstation.simulation import record_on_bench
from procedures import method
from tests.check_rows import check_row
from tests.gui.conftest import Operator, SiteFolder, result_with

pytestmark = pytest.mark.timeout(120)
#: Longest wait for a job, ms: a loaded machine is no failure.
WAIT = 60_000

KINDS = {"multi_position": "hand", "gimbal": "gimbal", "cross_calibration": "pair"}
CHINESE = re.compile(r"[\u4e00-\u9fff]")


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """One recording of the virtual bench for each method, with a truth file."""
    folder = tmp_path_factory.mktemp("recordings")
    return {
        stage: record_on_bench(lambda *a, **k: None, kind, folder / f"{stage}.h5", "mems", 4)
        for stage, kind in KINDS.items()
    }


@pytest.fixture
def select_method(window: MainWindow) -> Callable[[str], MethodPanel]:
    """Choose a method on the page."""

    def choose(stage: str) -> MethodPanel:
        window.show_page("offline_page")
        window.offline_page.methods.select(stage)
        panel = window.offline_page.panel
        assert panel is not None
        assert panel.stage == stage
        assert panel.isVisible()
        return panel

    return choose


def solved(panel: MethodPanel, path: Path, qtbot: QtBot) -> None:
    """Type the path of a recording and press Enter."""
    panel.source.log_edit.setText(str(path))
    qtbot.keyClick(panel.source.log_edit, Qt.Key.Key_Return)
    qtbot.waitUntil(lambda: not panel.busy, timeout=WAIT)
    assert panel.solution is not None, panel.notice.text_label.text()


def cells(panel: MethodPanel) -> dict[str, dict[str, str]]:
    """Return the cells of the parameter table by parameter and heading."""
    model = panel.views.table.model()
    headings = [str(model.headerData(k, Qt.Orientation.Horizontal)) for k in range(model.columnCount())]
    rows = {}
    for row in range(model.rowCount()):
        name = str(model.headerData(row, Qt.Orientation.Vertical))
        rows[name] = {h: str(model.index(row, k).data()).strip() for k, h in enumerate(headings)}
    return rows


@pytest.mark.long
def test_multi_position_recording_is_solved_plotted_applied_and_exported(
    select_method: Callable[[str], MethodPanel], recordings: dict[str, Path], qtbot: QtBot, tmp_path: Path
) -> None:
    panel = select_method("multi_position")
    assert not panel.views.tabs.isTabEnabled(1)
    solved(panel, recordings["multi_position"], qtbot)
    positions, applied = panel.views.positions, panel.views.applied
    assert positions is not None
    assert positions.isVisible()
    assert len(panel.solution.plot_data.up) > 30  # type: ignore[union-attr]
    before, after = re.findall(r"[\d.]+", positions.angle_figure.number.text())
    assert float(after) < 0.2 * float(before)
    rows = cells(panel)
    assert len(rows) == 21
    for name, row in rows.items():
        assert abs(float(row["error in σ"].replace("−", "-"))) < 5.0, name
    assert applied is not None
    qtbot.waitUntil(lambda: applied.applied is not None, timeout=WAIT)
    assert applied.applied is not None
    assert applied.applied.length_rms[1] < 0.5 * applied.applied.length_rms[0]
    assert applied.applied.rate_rms[1] < 0.5 * applied.applied.rate_rms[0]
    other = tmp_path / "other.h5"
    shutil.copy(recordings["cross_calibration"], other)
    applied.apply(other)
    qtbot.waitUntil(lambda: applied.applied is not None and applied.applied.path == other, timeout=WAIT)
    applied.apply(tmp_path / "nothing.h5")
    qtbot.waitUntil(lambda: "No such file" in panel.notice.text_label.text(), timeout=WAIT)
    qtbot.mouseClick(panel.export_button, Qt.MouseButton.LeftButton)
    dialog = panel.findChild(QFileDialog)
    assert dialog is not None
    target = tmp_path / "answer.json"
    dialog.fileSelected.emit(str(target))
    dialog.close()
    qtbot.waitUntil(lambda: target.exists() and not panel.busy, timeout=WAIT)
    assert json.loads(target.read_text("utf-8"))["stages"] == ["multi_position"]


@pytest.mark.long
def test_output_of_the_connected_unit_is_shown_before_and_after_correction(
    select_method: Callable[[str], MethodPanel],
    recordings: dict[str, Path],
    qtbot: QtBot,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    panel = select_method("multi_position")
    solved(panel, recordings["multi_position"], qtbot)
    view = panel.views.applied
    assert view is not None
    panel.views.tabs.setCurrentIndex(2)
    button, said = view.unit_button, panel.findChild(QLabel, "applied_unit_label")

    qtbot.waitUntil(lambda: not view.watch.busy, timeout=WAIT)
    qtbot.mouseClick(button, Qt.MouseButton.LeftButton)
    assert not button.isEnabled()
    assert not view.choose_button.isEnabled()
    view.watch.cancel()
    assert view.watch.busy, "a job that reads the unit cannot be cancelled"
    qtbot.waitUntil(lambda: not view.watch.busy, timeout=WAIT)
    assert not panel.notice.isVisible(), panel.notice.text_label.text()
    assert button.isEnabled()
    now = view.applied
    assert now is not None
    assert now.path is None
    assert now.serial == "BENCH-mems-4"
    assert now.time[-1] > 9.0
    assert now.length_rms[1] < 0.6 * now.length_rms[0]
    assert abs(now.rate_rms[1] - now.earth) < 0.2 * now.earth < now.rate_rms[0]
    before, after = re.findall(r"[\d.]+", view.force_figure.number.text())
    assert float(after) < 0.6 * float(before)
    assert "BENCH-mems-4, 10 s" in view.name_label.text()
    assert said.text() == ""
    # data received for one solution are not shown with the next one
    qtbot.mouseClick(button, Qt.MouseButton.LeftButton)
    assert panel.solution is not None
    view.show_solution(replace(panel.solution))
    qtbot.waitUntil(lambda: view.applied is not None, timeout=WAIT)
    assert view.applied is not None
    assert view.applied.path == recordings["multi_position"]
    # a unit that corrects itself is not corrected twice, and another unit not at all
    view.watch.done.emit(replace(now, corrected=True))
    assert "not applied a second time" in said.text()
    assert "→" not in view.force_figure.number.text()
    view.watch.done.emit(OtherUnit("SN-000007"))
    assert "is SN-000007, but the result is for BENCH-mems-4" in said.text()
    assert not view.force_figure.isVisible()
    link = panel.app.engine_link
    with monkeypatch.context() as going_on:
        going_on.setattr(type(link), "running", property(lambda _: True))
        going_on.setattr(link, "request", RunRequest("SN-000042"))
        link.running_changed.emit(True)
        assert not button.isEnabled()
        assert "STOP" in button.toolTip()


@pytest.mark.long
def test_gimbal_recording_shows_both_solutions_in_both_languages(
    select_method: Callable[[str], MethodPanel], qtbot: QtBot, site_folder: SiteFolder
) -> None:
    panel = select_method("gimbal")
    qtbot.mouseClick(panel.bench.make_button, Qt.MouseButton.LeftButton)
    assert panel.busy
    qtbot.waitUntil(lambda: panel.solution is not None and not panel.busy, timeout=WAIT)
    assert panel.path == site_folder.home / "recordings" / "gimbal-mems-1.h5"
    assert panel.path.exists()
    rows = cells(panel)
    assert len(rows) == 6
    for row in rows.values():
        assert abs(float(row["in σ"].replace("−", "-"))) < 5.0
    view = panel.views.gimbal
    assert view is not None
    assert [badge.text()[:6] for badge in view.badges] == ["Axis x", "Axis y", "Axis z"]
    # all texts change with the language and theme while the solution is shown
    language.use("zh_CN")
    theme.apply("dark")
    try:
        page = panel.window().offline_page  # type: ignore[attr-defined]
        qtbot.waitUntil(lambda: CHINESE.search(panel.views.tabs.tabText(0)) is not None)
        said = [label.text() for label in page.findChildren(QLabel) if label.isVisible()]
        tabs = panel.views.tabs
        said += [tabs.tabText(k) for k in range(tabs.count())]
        said += [b.text() for b in page.findChildren(QPushButton) if b.isVisible()]
        english = [text for text in said if re.search(r"[A-Za-z]{4,}", text) and "BENCH" not in text]
        assert [text for text in english if not CHINESE.search(text)] == []
    finally:
        theme.apply("light")
        language.use("en")


@pytest.mark.long
def test_out_of_tolerance_secondary_passes_the_check_after_calibration(
    select_method: Callable[[str], MethodPanel], recordings: dict[str, Path], qtbot: QtBot
) -> None:
    panel = select_method("cross_calibration")
    solved(panel, recordings["cross_calibration"], qtbot)
    view, residuals = panel.views.check, panel.views.residuals
    assert view is not None
    assert residuals is not None
    assert [bar.verdict for bar in view.bars.bars] == ["out of tolerance"] * 2 + ["within"] * 2
    tabs, head = panel.views.tabs, panel.views._head
    tabs.setCurrentIndex(tabs.count() - 1)
    assert not head.isVisible(), "the verdict on the recording does not concern the live data"
    tabs.setCurrentIndex(1)
    assert head.isVisible()
    assert "Checked by command" in view.schedule_label.text()
    assert "nothing is stored" in panel.findChild(QLabel, "pair_stored_label").text()
    before, after = re.findall(r"[\d.]+", residuals.figures[0].number.text())
    assert float(after) < 0.1 * float(before)
    assert len(cells(panel)) == 28

    def check() -> None:
        qtbot.mouseClick(view.check_button, Qt.MouseButton.LeftButton)
        qtbot.waitUntil(lambda: not panel.busy, timeout=WAIT)

    check()
    assert [bar.verdict.partition(":")[0] for bar in view.bars.bars] == [
        "calibrated",
        "calibrated",
        "within",
        "within",
    ]
    assert view.timeline.progress is not None
    happened = [h.kind for h in view.timeline.progress.events]
    assert happened == ["triggered", "checked", "calibrating", "calibrated"]
    assert len(load_pair(pair_folder(), "BENCH-mems-4A", "BENCH-mems-4B").values) == 28
    assert "28 values" in panel.findChild(QLabel, "pair_stored_label").text()
    check()
    assert {bar.verdict for bar in view.bars.bars} == {"within"}
    # solved again, the recording is checked with the calibration that is stored now
    first = panel.solution
    qtbot.mouseClick(panel.solve_button, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: panel.solution is not first and not panel.busy, timeout=WAIT)
    assert {bar.verdict for bar in view.bars.bars} == {"within"}
    view.show_progress(PairProgress(60.0, 30.0, "calibrating", 0.5, ()))
    panel.checker.failed.emit(InputError("cli.no_rest"))
    assert view.timeline.progress is None


@pytest.mark.long
def test_failed_solution_is_reported_and_a_running_solution_cancelled(
    select_method: Callable[[str], MethodPanel], recordings: dict[str, Path], qtbot: QtBot
) -> None:
    panel = select_method("cross_calibration")
    panel.open(recordings["multi_position"])
    qtbot.waitUntil(lambda: not panel.busy, timeout=WAIT)
    assert panel.solution is None
    assert "Add [imu2]" in panel.notice.text_label.text()
    assert panel.notice.isVisible()
    language.use("zh_CN")
    qtbot.waitUntil(lambda: "第二个 IMU" in panel.notice.text_label.text())
    language.use("en")
    panel = select_method("multi_position")
    panel.open(recordings["multi_position"])
    assert not panel.source.isEnabled()
    panel.solver.cancel()
    assert not panel.busy
    assert panel.solution is None
    assert panel.solve_button.isEnabled()


@pytest.mark.long
def test_log_path_is_locked_while_the_current_view_is_busy(
    window: MainWindow, select_method: Callable[[str], MethodPanel], recordings: dict[str, Path], qtbot: QtBot
) -> None:
    panel, page = select_method("multi_position"), window.offline_page
    panel.open(recordings["multi_position"])
    page.reader.busy_changed.emit()
    assert not page.source.isEnabled()
    page.source.path_selected.emit(recordings["gimbal"])
    assert "when this job has ended" in panel.notice.text_label.text()
    page.methods.select("gimbal")
    assert page.source.isEnabled()
    page.methods.select("multi_position")
    assert not page.source.isEnabled()
    window.show_page("operator_page")
    qtbot.waitUntil(lambda: not panel.busy, timeout=WAIT)
    assert panel.path == recordings["multi_position"]
    assert page.source.isEnabled()


@pytest.mark.usefixtures("engineer_page")
@pytest.mark.long
def test_guide_me_live_requires_a_manual_rig_and_opens_the_operator_page(
    select_method: Callable[[str], MethodPanel], window: MainWindow, operator: Operator, qtbot: QtBot
) -> None:
    panel = select_method("multi_position")
    assert not panel.live_button.isEnabled()
    assert "virtual_hand" in panel.live_button.toolTip()
    window.app.set_station(library.find("stations", "virtual_hand"))
    qtbot.waitUntil(panel.live_button.isEnabled)
    # the current product is calibrated on a table, so that the engineer cannot select its stages here
    assert "station's rig" in window.findChild(QPushButton, "engineer_start_button").toolTip()
    qtbot.mouseClick(panel.live_button, Qt.MouseButton.LeftButton)
    assert window.page_tabs.currentWidget().objectName() == "operator_page"
    assert window.findChild(QComboBox, "product_combo").currentText() == "MEMS grade C, by hand"


def frozen(block: SampleBlock) -> SampleBlock:
    counts = block.counts.copy()
    counts[2000:3000, 1] = counts[2000, 1]
    return replace(block, counts=counts)


def in_g(block: SampleBlock) -> SampleBlock:
    return replace(block, counts=block.counts / [1, 1, 1, 9.81, 9.81, 9.81])


def in_degrees(block: SampleBlock) -> SampleBlock:
    return replace(block, counts=block.counts * [57.3, 57.3, 57.3, 1, 1, 1])


def swapped(block: SampleBlock) -> SampleBlock:
    return replace(block, counts=block.counts[:, [1, 0, 2, 3, 4, 5]])


def never_at_rest(block: SampleBlock) -> SampleBlock:
    shaken = block.counts.copy()
    shaken[:, :3] += 3e3 * np.sin(0.9 * np.arange(len(block)))[:, None]
    return replace(block, counts=shaken)


def never_moved(block: SampleBlock) -> SampleBlock:
    return block.part(0, 1800 if block.seq[0] == 0 else 0)


@pytest.mark.parametrize("spoil", [frozen, in_g, in_degrees, swapped, never_at_rest, never_moved])
def test_faults_of_a_recording_are_explained_in_both_languages(
    spoil: Callable[[SampleBlock], SampleBlock], recordings: dict[str, Path], qapp: QApplication
) -> None:
    log = open_log(recordings["multi_position"])
    multi_position = method("multi_position")
    schedule = multi_position.schedule()
    solver = multi_position.solver(context_from_meta(log.meta), prior_from_meta(log.meta), schedule)
    for block in log.blocks():
        solver.feed(spoil(block))
    with pytest.raises(InputError) as error:
        solver.finish()
    translated = error.value.render("zh_CN").sentences
    assert len(CHINESE.findall(translated)) >= 6, translated
    assert not re.search(r"[a-z]{3,} [a-z]{3,}", translated), translated


def check(kind: CheckKind, subject: str, value: float, limit: float, unit: str, **at: object) -> dict[str, object]:
    passed = value <= limit
    more = {"margin": limit - value, "near_miss": passed and value > 0.8 * limit, "at": at}
    return check_row(kind, subject, value, limit, passed=passed, unit=unit, **more)


def test_checks_are_shown_as_sentences_and_values_near_limits_are_marked(qtbot: QtBot) -> None:
    table = ChecksTable()
    qtbot.addWidget(table)
    rows = [
        check("gravity_at_rest", "", 0.0095, 0.01, "m/s²", stage="multi_position", rest=3),
        check("motion_angle", "", 0.009, 0.006, "rad"),
        check("excitation", "", 0.1, 0.3, "1", parameter="gyro_bias_x"),
        check("previous", "accel_scale", 1e-4, 3e-4, "1"),
    ]
    table.show_checks([Check.from_json(row) for row in rows])
    model = table.parameters
    verdict = model.columnCount() - 1
    shown = [[str(model.index(r, k).data()) for k in range(verdict + 1)] for r in range(4)]
    assert [row[verdict] for row in shown] == ["failed", "near-miss", "passed", "passed"]
    states = [model.index(r, verdict).data(Qt.ItemDataRole.UserRole) for r in range(4)]
    assert states == ["bad", "caution", "good", "good"]
    assert shown[1][:2] == ["At every rest the specific force has the magnitude of gravity", "rest 4"]
    assert check_text(Check.from_json(check("previous", "accel_scale", 1e-4, 3e-4, "1"))).value == "100"


def test_operator_page_verdict_shows_the_product_checks() -> None:
    checks = [
        check("gravity_at_rest", "", 0.0095, 0.01, "m/s²"),
        check("motion_angle", "", 0.009, 0.006, "rad"),
        check("consistency", "multi_position", 1.0, 1.3, "1"),
    ]
    rows = advice.figures(result_with(checks=checks))
    assert [(row.name, row.passed, row.near) for row in rows] == [
        ("angle between rests", False, False),
        ("force at rest", True, True),
    ]
    many = [check("previous", "gyro_bias", 0.1 * k, 9.0, "1") for k in range(20)]
    rows = advice.figures(result_with(checks=[*many, *checks]))
    assert [row.near for row in rows].count(True) == 1
    assert len(rows) == 7
    assert "Between rests the unit turns by the angle of the reference (1856 ″, allowed ≤ 1238 ″)" in advice.reason(
        "failed", result_with(checks=checks)
    )
    assert advice.reason("passed", result_with(checks=checks[:1])).endswith(
        "Close to the limit: force at rest, at 95 % of it."
    )
    assert advice.brief_reason("passed", result_with(checks=checks[:1])) == "At 95 % of its limit: force at rest"
    named = [check("sigma_below", "gyro_bias_x", 0.99, 1.0, "rad/s"), *checks[:1]]
    close = "At 99 % of its limit: gyro bias x and 1 more"
    assert advice.brief_reason("passed", result_with(checks=named)) == close


@pytest.mark.long
def test_calibrations_by_triggers_are_shown_on_the_timeline(
    select_method: Callable[[str], MethodPanel], recordings: dict[str, Path], tmp_path: Path, qtbot: QtBot
) -> None:
    path = tmp_path / "triggered.csv"
    export_csv(recordings["cross_calibration"], path)
    content = path.with_suffix(".toml").read_text("utf-8")
    section = "[schedule.cross_calibration]\n"
    assert section in content
    path.with_suffix(".toml").write_text(content.replace(section, f'{section}trigger = "start_up"\n'), "utf-8")
    panel = select_method("cross_calibration")
    solved(panel, path, qtbot)
    view = panel.views.check
    assert view is not None
    assert view.timeline.progress is not None
    assert [h.kind for h in view.timeline.progress.events][-1] == "calibrated"
    assert "Checked at start-up" in view.schedule_label.text()
    assert view.bars.bars[0].verdict.startswith("calibrated: now")
    assert "nothing is stored" in panel.findChild(QLabel, "pair_stored_label").text()


@pytest.mark.long
def test_live_watch_uses_the_selected_product(
    window: MainWindow, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[RunRequest] = []

    class Asked(PairProcess):
        def __init__(self, request: RunRequest) -> None:
            asked.append(request)
            self.ended = False

        def poll(self) -> list[PairStatus | CalstationError]:
            return []

        def close(self) -> None: ...

    monkeypatch.setattr(pair_live, "PairProcess", Asked)
    product = library.find("products", "tactical_b")
    window.app.set_product(product)
    window.app.set_station(library.find("stations", "virtual_pair"))
    view = pair_live.PairLiveView(window.app)
    qtbot.addWidget(view)
    qtbot.mouseClick(view.start_button, Qt.MouseButton.LeftButton)
    assert [(request.station, request.product) for request in asked] == [(window.app.station_path, product)]
    for code, ready, watching in (("en", "NOT READY", "LIVE"), ("zh_CN", "未就绪", "实时监测")):
        language.use(code)
        window.show_page("offline_page")
        texts = [label.text() for label in window.findChildren(QLabel) if label.isVisible()]
        assert watching in texts
        assert ready not in texts
    window.app.set_station(library.find("stations", "virtual_bench"))
    assert view.badge.text() == "virtual pair：正在打开端口"
    language.use("en")
    assert view.badge.text() == "virtual pair: opening the ports"
    window.app.set_station(library.find("stations", "virtual_pair"))
    assert view.badge.text() == "opening the ports"
    view.close_watch()
    assert window.app.run.display_state == "not_ready"
    for code, words in (("en", "READY TO WATCH"), ("zh_CN", "可以监测")):
        language.use(code)
        assert run_badge(window.app.run) == ("none", words)
    language.use("en")
    window.app.set_station(library.find("stations", "virtual_bench"))
    assert not needs_no_run(window.app.run)


@pytest.mark.parametrize(
    ("code", "texts"),
    [
        (
            "en",
            (
                "IMU 2: accelerometer calibrated, gyro not: primary out of tolerance",
                "IMU 2: gyro, accelerometer calibrated",
            ),
        ),
        ("zh_CN", ("IMU 2 的加表已标定，陀螺未标定：主 IMU 超差", "IMU 2 的陀螺、加表已标定")),
    ],
)
def test_a_calibration_of_a_pair_names_its_sensors(code: language.Language, texts: tuple[str, str]) -> None:
    language.use(code)
    for (sensors, skipped), text in zip(((["accel"], ["gyro"]), (["gyro", "accel"], [])), texts, strict=True):
        event = WatchEvent("calibrated", 1.0, 2, {"sensors": sensors, "skipped": skipped})
        assert event_sentence(event) == text
    language.use("en")


@pytest.mark.parametrize(
    ("code", "state"), [("en", "not watching; the last data are shown"), ("zh_CN", "未监测；显示的是最后的数据")]
)
def test_nothing_waits_or_is_valid_after_the_end_of_a_watch(
    window: MainWindow, qtbot: QtBot, code: str, state: str
) -> None:
    language.use(code)
    view = pair_live.PairLiveView(window.app)
    qtbot.addWidget(view)
    schedule = method("cross_calibration").schedule().model_dump()
    progress, trace = PairProgress(20.0, 60.0, "calibrating", 0.48, ()), CorrectedTrace(None, 0, np.zeros(0), {}, {})
    view.status = PairStatus(schedule, progress, {}, {}, {}, (), (), frozenset(), trace)
    view._refresh()
    assert view.badge.text() == state
    assert view.source_label.isHidden()
    assert view.timeline.progress == replace(progress, duration=20.0)
    language.use("en")


@pytest.mark.parametrize(("code", "words"), [("en", "calibrated over temperature"), ("zh_CN", "在温度范围内标定")])
def test_imu_pair_of_a_product_over_temperature_is_refused_at_the_start(
    window: MainWindow, qtbot: QtBot, code: str, words: str
) -> None:
    language.use(code)
    view = pair_live.PairLiveView(window.app)
    qtbot.addWidget(view)
    window.app.set_station(library.find("stations", "virtual_pair"))
    window.app.set_product(library.find("products", "nav_a_thermal"))
    assert not view.start_button.isEnabled()
    assert words in view.start_button.toolTip()
    qtbot.mouseClick(view.start_button, Qt.MouseButton.LeftButton)
    assert not view.watching
    window.app.set_product(library.find("products", "nav_a"))
    assert view.start_button.isEnabled()
    language.use("en")


@pytest.mark.long
def test_live_imu_pair_is_monitored_and_checked_on_a_button_press(
    select_method: Callable[[str], MethodPanel], window: MainWindow, qtbot: QtBot, tmp_path: Path
) -> None:
    live = select_method("cross_calibration").views.live
    assert live is not None
    assert not live.start_button.isEnabled()
    assert "virtual_pair" in live.start_button.toolTip()
    shipped = library.find("stations", "virtual_pair").read_text()
    path = tmp_path / "pair.toml"
    path.write_text(shipped.replace("speed = 1.0", "speed = 0.0").replace('"period"', '"command"'))
    window.app.set_station(path)
    qtbot.waitUntil(live.start_button.isEnabled)
    tabs = window.offline_page.panel.views.tabs  # type: ignore[union-attr]
    tabs.setCurrentIndex(tabs.count() - 1)
    qtbot.mouseClick(live.start_button, Qt.MouseButton.LeftButton)
    assert live.watching
    qtbot.waitUntil(lambda: live.status is not None, timeout=WAIT)
    assert {bar.verdict for bar in live.bars.bars} == {"no rest for a check"}
    qtbot.mouseClick(live.check_button, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: bool(live.status and live.status.static), timeout=WAIT)
    qtbot.waitUntil(lambda: live.bars.bars[0].verdict.startswith("calibrated"), timeout=WAIT)
    assert "drift" in window.findChild(QLabel, "watch_clocks_label").text()
    files = list(pair_folder().glob("*.toml"))
    assert len(files) == 1
    qtbot.mouseClick(live.start_button, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: not live.watching, timeout=WAIT)
    assert window.findChild(QLabel, "watch_failure_label").text() == ""
    language.use("zh_CN")
    qtbot.waitUntil(lambda: CHINESE.search(live.badge.accessibleName() or live.start_button.text()) is not None)
