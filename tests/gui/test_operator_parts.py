"""Translations, advice, plots and labels of the operator page, without a window."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PySide6.QtWidgets import QApplication, QLabel
from pytestqt.qtbot import QtBot

from calstation.estimation import Diagnosis
from calstation.gui.logs.comparison import Comparison
from calstation.gui.operator import FiguresTable, advice
from calstation.gui.operator.live.convergence import Convergence
from calstation.gui.operator.live.table_panel import TablePanel
from calstation.gui.operator.live.traces import Traces
from calstation.gui.operator.starting import suggested_serial
from calstation.gui.state import UnitStatus
from calstation.gui.text import check_text, language, say
from calstation.gui.widgets import NumberAxis, spread, theme
from calstation.judgement import Check
from calstation.messages import Language
from calstation.results import Resolved
from calstation.runs import RunSummary
from calstation.sequencer import Message, TableMoved, Trace
from tests.check_rows import check_row
from tests.gui.conftest import result_with
from tests.gui.plot_mouse import double_click, pixel, turn_wheel


def test_advice_states_the_worst_failure_and_counts_the_others() -> None:
    checks = [
        check_row("within", "gyro_bias_x", 2e-5, [-1.5e-5, 1.5e-5], passed=False),
        check_row("within", "gyro_scale_x", 2e-3, [-1e-3, 1e-3], passed=False),
        check_row("sigma_below", "gyro_scale_x", 1e-6, 4e-6, passed=True),
        check_row("consistency", "rate", 1.3, 1.2, passed=False),
    ]
    result = result_with(checks=checks, advice="reseat")
    reason = advice.reason("failed", result)
    assert reason == "Gyro scale factor x is 2000 ppm; allowed: ±1000 ppm. (Other failed checks: 2.)"
    assert advice.next_action("failed", result).startswith("Reseat the unit")
    assert advice.next_action("failed", result_with(advice="set_aside")).startswith("Set the unit aside")


@pytest.mark.parametrize(
    ("code", "reason", "action", "brief"),
    [
        (
            "en",
            "Without a current calibration of the unit, Azimuth flips alone cannot meet the limits: "
            "a full calibration is needed. The sigma of accel bias z is 1020 µg; required: ≤ 102 µg.",
            "Run a full calibration",
            "Run a full calibration",
        ),
        (
            "zh_CN",
            "这台产品没有现行标定，只做方位翻转达不到限差要求：需要完整标定。"
            "加表零偏 z 的标准差为 1020 µg，要求 ≤ 102 µg。",
            "请进行完整标定",
            "做完整标定",
        ),
    ],
)
def test_partial_run_without_a_current_calibration_asks_for_a_full_one(
    code: Language, reason: str, action: str, brief: str
) -> None:
    language.use(code)
    failed = check_row("sigma_below", "accel_bias_z", 1e-2, 1e-3, passed=False)
    flips = {"partial": True, "stages": ["azimuth_flip"], "checks": [failed], "advice": "full_calibration"}
    result = result_with(**flips)
    assert advice.reason("failed", result).replace("\u00a0", " ") == reason
    assert advice.next_action("failed", result).startswith(action)
    assert advice.brief_action("failed", result) == brief
    assert advice.repeats(result)
    calibration = {"log": "a.h5", "started_utc": "2026-01-01T00:00:00+00:00"}
    with_calibration = advice.reason("failed", result_with(**flips, calibration=calibration))
    assert with_calibration.replace("\u00a0", " ") in reason
    assert with_calibration.replace("\u00a0", " ") != reason
    language.use("en")


@pytest.mark.parametrize(
    ("code", "reason", "action", "remedy"),
    [
        ("en", "The IMU outputs 200.1", "Set the unit aside for the engineer", "Correct sample_rate_hz, or the clock"),
        ("zh_CN", "IMU 每秒输出 200.1", "把产品放到一边，交给工程师", "请改正 sample_rate_hz 或时钟"),
    ],
)
def test_fault_of_the_clock_is_for_an_engineer_who_reads_its_remedy(
    code: Language, reason: str, action: str, remedy: str
) -> None:
    language.use(code)
    values = {"reference": "station", "ppm": 500.0, "ppm_sigma": 1.0, "rate": 200.1}
    diagnosis = Diagnosis("sample_clock", 5e-4, 1e-6, values=values)
    row = Check("sample_clock", "rate", 5e-4, 1e-4, "1", passed=False, diagnosis=diagnosis).to_json()
    result = result_with(checks=[row], advice="ask_engineer")
    assert reason in advice.reason("failed", result)
    assert advice.next_action("failed", result).startswith(action)
    assert advice.next_action("failed", result, engineer=True).startswith(remedy)
    assert not advice.repeats(result)
    language.use("en")


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        ("en", "The data did not determine gyro bias z, accel bias x."),
        ("zh_CN", "数据不足以确定陀螺零偏 z、加表零偏 x。"),
    ],
)
def test_parameters_that_are_not_determined_are_listed_as_the_language_does(code: Language, reason: str) -> None:
    language.use(code)
    failed = check_row("unobservable", "", 2, 0, passed=False)
    result = result_with(unobservable=["gyro_bias_z", "accel_bias_x"], checks=[failed])
    assert advice.reason("failed", result).replace("\u00a0", " ") == reason
    language.use("en")


@pytest.mark.parametrize(
    ("code", "reason", "headings", "sentence"),
    [
        (
            "en",
            "Gyro scale factor x is 950 ppm, outside the acceptance limit ±900 ppm. "
            "The acceptance limit is the limit ±1000 ppm less a guard band of 2 σ = 100 ppm.",
            ("outside its acceptance limit", "acceptance limit", "limit of the product less a guard band of 2 σ"),
            "Gyro scale factor x within its acceptance limit",
        ),
        (
            "zh_CN",
            "陀螺刻度系数 x 为 950 ppm，超出接受限 ±900 ppm。接受限为限差 ±1000 ppm 扣除保护带 2 σ = 100 ppm。",
            ("超出接受限", "接受限", "接受限：产品限差扣除 2 σ 的保护带。"),
            "陀螺刻度系数 x在接受限内",
        ),
    ],
)
def test_value_in_the_guard_band_is_compared_with_acceptance_limits(
    qtbot: QtBot, code: Language, reason: str, headings: tuple[str, ...], sentence: str
) -> None:
    language.use(code)
    row = {"unit": "1", "stage": "rate", "sigma": 5e-5}
    refused = {**check_row("within", "gyro_scale_x", 9.5e-4, [-1e-3, 1e-3], passed=False), "acceptance": [-9e-4, 9e-4]}
    result = result_with(parameters={"gyro_scale_x": {"value": 9.5e-4, **row}}, checks=[refused])
    assert advice.reason("failed", result).replace("\u00a0", " ") == reason
    (figure,) = advice.figures(result)
    assert (figure.passed, figure.limit) == (False, "±900")
    table = FiguresTable()
    qtbot.addWidget(table)
    table.show_result(result)
    shown = [each.text() for each in table.findChildren(QLabel)]
    assert all(any(heading in text for text in shown) for heading in headings)
    text = check_text(result.checks[0])
    assert (text.sentence, text.limit) == (sentence, "±900")
    near = Check.compare("within", 8.5e-4, (-1e-3, 1e-3), "1", subject="gyro_scale_x", acceptance=(-9e-4, 9e-4))
    near_text = advice.reason("passed", result_with(checks=[near.to_json()]))
    assert ("acceptance limit" if code == "en" else "已达接受限的 94 %") in near_text
    language.use("en")


@pytest.mark.parametrize(("code", "name"), [("en", "gyro bias, gyro scale factor x"), ("zh_CN", "陀螺零偏")])
def test_limits_that_no_stage_judged_are_named_beside_pass(code: Language, name: str) -> None:
    """Neither the reason nor the brief one of a tile says that every value is within its limits."""
    language.use(code)
    unjudged = result_with(not_compared=[*(f"gyro_bias_{axis}" for axis in "xyz"), "gyro_scale_x"])
    assert not unjudged.partial
    for text in (advice.reason("passed", unjudged), advice.brief_reason("passed", unjudged)):
        assert name.split(", ")[0] in text
    every = advice.reason("passed", result_with())
    assert every not in advice.reason("passed", unjudged)
    language.use("en")


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        (
            "en",
            "Only Azimuth flips: every judged value is within its limits. "
            "Not judged although they have a limit: gyro bias.",
        ),
        ("zh_CN", "只做了方位翻转：已判定的值均在限差之内。有限差但未判定：陀螺零偏。"),
    ],
)
def test_partial_run_names_the_solved_values_that_were_not_judged(code: Language, reason: str) -> None:
    """Values of stages that were not run are not named."""
    language.use(code)
    names = [f"gyro_bias_{axis}" for axis in "xyz"]
    row = {"value": 0.0, "sigma": 1e-6, "unit": "rad/s", "stage": "azimuth_flip"}
    partial = {"partial": True, "stages": ["azimuth_flip"], "parameters": dict.fromkeys(names, row)}
    result = result_with(**partial, not_compared=[*names, "gyro_scale_x"])
    assert result.unjudged == ["gyro_bias"]
    assert advice.reason("partial", result).replace("\u00a0", " ") == reason
    judged = result_with(**partial, not_compared=["gyro_scale_x"])
    assert judged.unjudged == []
    assert advice.reason("partial", judged) == say("advice.partial", stages=["azimuth_flip"])
    language.use("en")


def test_value_nearest_to_its_limit_is_shown_per_group() -> None:
    row = {"unit": "1", "stage": "rate", "sigma": 1e-6}
    result = result_with(
        parameters={"gyro_scale_x": {"value": 1e-4, **row}, "gyro_scale_y": {"value": -9e-4, **row}},
        checks=[
            check_row("within", "gyro_scale_x", 1e-4, [-1e-3, 1e-3], passed=True),
            check_row("within", "gyro_scale_y", -9e-4, [-1e-3, 1e-3], passed=True),
        ],
    )
    (figure,) = advice.figures(result)
    assert (figure.name, figure.value, figure.limit, figure.unit) == (
        "gyro scale factor y",
        "−900.0",
        "±1000",
        "ppm",
    )


def test_failing_values_are_listed_first_and_individually() -> None:
    row = {"unit": "1", "stage": "rate", "sigma": 1e-6}
    values = {"gyro_scale_x": 1e-4, "gyro_scale_y": 2e-3, "gyro_scale_z": -4e-3, "accel_scale_x": 5e-4}
    result = result_with(
        parameters={name: {"value": value, **row} for name, value in values.items()},
        checks=[
            check_row("within", name, value, [-1e-3, 1e-3], passed=abs(value) <= 1e-3) for name, value in values.items()
        ],
    )
    shown = [(figure.name, figure.passed) for figure in advice.figures(result)]
    assert shown == [
        ("gyro scale factor z", False),
        ("gyro scale factor y", False),
        ("gyro scale factor x", True),
        ("accel scale factor x", True),
    ]


def test_stage_of_a_failing_value_is_found_for_every_type_of_check() -> None:
    row = {"unit": "1", "sigma": 1e-6, "value": 1.0}
    stages = ["rate", "six_position", "excitation", "azimuth_flip"]
    parameters = {"gyro_scale_x": {**row, "stage": "rate"}, "accel_scale_x": {**row, "stage": "excitation"}}

    def failed(*checks: dict[str, Any], **more: Any) -> set[str]:
        return result_with(stages=stages, parameters=parameters, checks=list(checks), **more).failed_stages

    assert failed(check_row("within", "gyro_scale_x", 1.0, 0.1, passed=True), unobservable=["gyro_scale_x"]) == set()
    assert failed(check_row("sigma_below", "gyro_scale_x", 1.0, 0.1, passed=False)) == {"rate"}
    assert failed(check_row("consistency", "six_position", 9.0, 1.2, passed=False)) == {"six_position"}
    assert failed(
        check_row("gravity_at_rest", "", 1.0, 0.1, passed=False) | {"at": {"stage": "azimuth_flip", "rest": 2}}
    ) == {"azimuth_flip"}
    assert failed(
        check_row("previous", "accel_scale", 1.0, 0.1, passed=False) | {"at": {"parameter": "accel_scale_x"}}
    ) == {"excitation"}
    lost = check_row("unobservable", "", 1.0, 0.0, passed=False)
    assert failed(lost, unobservable=["accel_scale_x"]) == {"excitation"}


def test_traces_keep_the_latest_rows_in_order(qtbot: QtBot) -> None:
    traces = Traces()
    qtbot.addWidget(traces)
    for start in range(0, 20_000, 500):
        times = tuple(float(time) for time in range(start, start + 500))
        traces.add(Trace(times, (0.0,) * (6 * len(times))))
        newest = np.arange(start + 500 - len(traces.rows), start + 500)
        assert np.array_equal(traces.rows[:, 0], newest)
    assert len(traces.rows) == 16_384
    traces.start()
    assert len(traces.rows) == 0


def test_empty_traces_have_no_numbers(qtbot: QtBot) -> None:
    traces = Traces()
    qtbot.addWidget(traces)
    traces.show()
    axes = [plot.plot.getAxis("left") for plot in (traces._gyro, traces._accel)]
    assert not any(axis.style["showValues"] for axis in axes)
    traces.add(Trace((0.0, 1.0), (0.5,) * 12))
    traces.start()
    assert not any(axis.style["showValues"] for axis in axes)
    traces.add(Trace((0.0, 1.0), (0.5,) * 12))
    traces._draw()
    assert all(axis.style["showValues"] for axis in axes)


@pytest.mark.parametrize(
    ("name", "unread", "no_data"),
    [("en", "no new reading", "no new data"), ("zh_CN", "没有新读数", "没有新数据")],
)
def test_old_readings_are_not_shown_as_live(qtbot: QtBot, name: str, unread: str, no_data: str) -> None:
    table, traces = TablePanel(), Traces()
    axis = traces._accel.plot.getAxis("bottom")
    try:
        language.use(name)
        for widget in (table, traces):
            qtbot.addWidget(widget)
            widget.show()
            widget._current.setInterval(20)
        moving = TableMoved(0.0, 0.0, 0.0, 0.0, moving=True)
        traces.start()
        for _ in range(2):
            table.show_motion(moving)
            traces.add(Trace((0.0, 1.0), (0.5,) * 12))
            assert unread not in table.badge.text()
            assert no_data not in axis.labelText
            qtbot.waitUntil(lambda: unread in table.badge.text() and no_data in axis.labelText)
        table.show_motion(replace(moving, moving=False))
        qtbot.wait(40)
        assert unread not in table.badge.text()
    finally:
        language.use("en")


@pytest.mark.parametrize(("low", "high"), [(-11.0, 11.0), (-105.0, 105.0), (-1.0, 10.5)])
@pytest.mark.parametrize("height", [36.0, 60.0, 200.0])
def test_labels_of_a_short_vertical_axis_do_not_overlap(
    qapp: QApplication, low: float, high: float, height: float
) -> None:
    (spacing, labelled), *_ = NumberAxis("left").tickValues(low, high, height)
    assert spacing * height / (high - low) >= theme.BODY
    assert len(labelled) >= 2


def test_zoomed_trace_stays_while_data_arrive_until_a_double_click(qtbot: QtBot) -> None:
    traces = Traces()
    qtbot.addWidget(traces)
    traces.resize(700, 500)
    traces.show()
    qtbot.waitExposed(traces)
    traces.start()
    traces.add(Trace((0.0, 30.0), (0.0,) * 12))
    traces.stop()
    plot = traces._gyro.plot
    box, whole = plot.getViewBox(), np.array(plot.getViewBox().viewRange())
    for undo in (lambda: double_click(plot, pixel(plot, box, 0.5, 0.5)), traces.hold_button.click):
        turn_wheel(plot, pixel(plot, box, 0.5, 0.5))
        zoomed = np.array(box.viewRange())
        assert np.ptp(zoomed[0]) < 0.9 * np.ptp(whole[0])
        assert traces.hold_button.isChecked()
        traces.add(Trace((traces.rows[-1, 0] + 1.0,), (0.0,) * 6))
        traces.stop()
        np.testing.assert_array_equal(box.viewRange(), zoomed)
        undo()
        assert not traces.hold_button.isChecked()
        np.testing.assert_allclose(box.viewRange(), whole)
    assert len(traces.rows) == 4


def test_line_labels_do_not_overlap_inside_the_plot() -> None:
    positions = spread([10.0, 11.0, 12.0, 90.0, 99.0], 18.0, 9.0, 100.0)
    assert all(b - a >= 18.0 - 1e-9 for a, b in pairwise(positions))
    assert positions[0] >= 9.0
    assert positions[-1] <= 100.0
    assert spread([50.0], 18.0, 9.0, 100.0) == [50.0]


def bench(**settings: object) -> RunSummary:
    serials = r"SN-\d{6}", "SN-000123"
    return RunSummary("s", "p", settings, "t", (1, 0, 0), (0, 0, 1), *serials, (), None, {}, (0.0, 0.0))


def test_suggested_serial_number_is_the_first_that_has_not_passed() -> None:
    assert suggested_serial(bench(), lambda serial: serial < "SN-000003") == "SN-000003"
    assert suggested_serial(bench(serial="X-1"), lambda serial: False) == "X-1"


def test_convergence_plot_marks_reached_targets_and_thins_its_lines(qtbot: QtBot) -> None:
    plot = Convergence()
    qtbot.addWidget(plot)
    plot.start({"gyro_bias": 1e-7})
    for k in range(20_000):
        plot.add(float(k), {"gyro_bias": 1e-4 / (k + 1), "accel_bias": 1.0})
        if k == 900:
            assert not plot.lines["gyro_bias"].reached
    assert plot.lines["gyro_bias"].reached
    assert "accel_bias" not in plot.lines
    assert len(plot.lines["gyro_bias"].times) <= 2001
    plot.draw()
    for code, name, end in (("en", "gyro bias σ ", "°/h, within limit"), ("zh_CN", "陀螺零偏标准差 ", "，已在限差内")):
        language.use(code)
        (text,) = [label.text for label in plot._labels._labels if not label.bold]
        assert text.startswith(name)  # not the bias itself
        assert text.endswith(end)
    language.use("en")


@pytest.mark.parametrize(
    ("code", "own", "texts"),
    [
        ("en", set(), ("multiple of its limit", "limit", "within limit")),
        ("en", {"gyro_bias"}, ("multiple of its target", "target", "target reached")),
        ("en", {"accel_bias"}, ("multiple of its target or limit", "target or limit", "within limit")),
        ("zh_CN", set(), ("标准差与限差之比", "限差", "已在限差内")),
        ("zh_CN", {"gyro_bias"}, ("标准差与目标值之比", "目标", "已达目标")),
        ("zh_CN", {"accel_bias"}, ("标准差与目标值或限差之比", "目标或限差", "已在限差内")),
    ],
)
def test_convergence_plot_calls_only_targets_of_stages_targets(
    qtbot: QtBot, code: str, own: set[str], texts: tuple[str, str, str]
) -> None:
    language.use(code)
    plot = Convergence()
    qtbot.addWidget(plot)
    plot.start(dict.fromkeys({"gyro_bias"} | own, 1e-7), own=own)
    plot.add(1.0, {"gyro_bias": 5e-8})
    plot.draw()
    line, sigma = sorted(plot._labels._labels, key=lambda shown: not shown.bold)
    assert any(shown.text().endswith(texts[0]) for shown in plot.findChildren(QLabel))
    assert line.text == texts[1]
    assert sigma.text.endswith(texts[2])
    language.use("en")


def test_alarm_of_a_control_chart_is_a_remark_of_the_unit() -> None:
    unit, values = UnitStatus("SN-000042"), {"quantities": ["orthogonality"]}
    unit.handle_event(Message("table_moved", values))
    assert unit.remarks == [("table_moved", values)]


@pytest.mark.parametrize(
    ("code", "names", "tip"),
    [
        (
            "en",
            "Failed checks: accel scale factor x, gyro bias x, gyro scale factor x and 1 more",
            "Gyro bias x within its limit: 4.125 °/h, allowed ±3.1 °/h",
        ),
        (
            "zh_CN",
            "未通过的检查：加表刻度系数 x、陀螺零偏 x、陀螺刻度系数 x，另有 1 项",
            "陀螺零偏 x在限差内：4.125 °/h，限差 ±3.1 °/h",
        ),
    ],
)
def test_failed_checks_of_an_offline_result_are_named(qtbot: QtBot, code: Language, names: str, tip: str) -> None:
    language.use(code)
    limits = {"gyro_bias_x": (2e-5, 1.5e-5), "gyro_scale_x": (1.2e-3, 1e-3), "gyro_scale_y": (1.1e-3, 1e-3)}
    limits["accel_scale_x"] = (2e-3, 1e-3)
    checks = [check_row("within", name, value, [-end, end], passed=False) for name, (value, end) in limits.items()]
    result = result_with(outcome="resolved", passed=False, checks=checks)
    comparison = Comparison()
    qtbot.addWidget(comparison)
    comparison._log_index = SimpleNamespace(facts=result.log, outcome=None, meta=SimpleNamespace(run=None))
    comparison.show_solved(Resolved(result, ()))
    assert names in comparison.note_label.text().replace("\u00a0", " ")
    shown = [line.replace("\u00a0", " ") for line in comparison.offline_badge.toolTip().splitlines()]
    assert len(shown) == 4
    assert tip in shown[1]
    language.use("en")
