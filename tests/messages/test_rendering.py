"""Messages are rendered as sentences in both languages, with values, terms and nested messages."""

import errno
import os
import pickle
import re
import sys
import time
from collections.abc import Iterator

import pytest

from calstation.errors import CalstationError, DeviceFaultError
from calstation.messages import (
    Language,
    Text,
    catalogue,
    local_time,
    os_reason,
    plain_number,
    render,
    sentence,
    step_text,
    term,
    values_from_json,
    values_to_json,
)
from calstation.schema import EntryError


def test_every_message_family_loads() -> None:
    assert "source" in catalogue.families()
    for name in catalogue.families():
        assert catalogue.family(name)


def test_an_error_has_code_values_and_sentence() -> None:
    error = DeviceFaultError("program.internal", detail="ZeroDivisionError")
    assert (error.code, error.values, error.exit_code) == (
        "program.internal",
        {"detail": "ZeroDivisionError"},
        3,
    )
    assert str(error).startswith("Program: Internal error: ZeroDivisionError. Start the run again.")
    assert error.render("zh_CN").source == "程序"


def test_an_error_survives_a_process_boundary() -> None:
    error = pickle.loads(pickle.dumps(DeviceFaultError("program.internal", detail="x")))
    assert isinstance(error, DeviceFaultError)
    assert (error.code, error.values) == ("program.internal", {"detail": "x"})


def test_nested_messages_are_rendered_and_survive_json() -> None:
    reason = os_reason(OSError(errno.ENOSPC, "No space left on device"))
    assert reason == Text("os.disk_full")
    values = {"detail": reason, "path": ["a", "b"]}
    assert values_from_json(values_to_json(values)) == values
    assert render("program.internal", values).text == "Internal error: the disk is full."
    assert render("program.internal", values, "zh_CN").text == "程序内部错误：磁盘已满。"


def test_full_stop_separates_a_final_reason_from_the_remedy() -> None:
    missing = CalstationError("signing.unreadable", file="lab.p12", reason=Text("os.not_found"))
    assert "cannot be read: no such file or folder. " in str(missing)
    chinese = missing.render("zh_CN").line
    assert "文件或文件夹不存在。" in chinese
    assert "。 " not in chinese
    assert str(CalstationError("database.no_url")).count(". ") == 1
    assert ". " not in render("database.refused", {"database": "x", "reason": "y"}).text


def test_reason_missing_from_the_catalogue_keeps_the_system_message() -> None:
    assert render("program.internal", {"detail": os_reason(OSError(9999, "odd"))}).text == "Internal error: odd."


def test_every_system_error_has_a_reason_in_chinese() -> None:
    reasons = [os_reason(OSError(number, os.strerror(number))) for number in errno.errorcode]
    reasons += [os_reason(OSError("of a library"))]
    for reason in reasons:
        assert not re.search("[A-Za-z]", sentence(reason, "zh_CN"))
        assert sentence(reason).isascii()


def test_parameter_has_a_display_name_in_the_window_and_an_identifier_elsewhere() -> None:
    moves = [Text.of("cause.move", parameter=name, sigmas=size) for name, size in (("gyro_bias_x", -7.0), ("a_b", 4.0))]
    values = {"parameter": "gyro_scale_z", "during": "rate", "size": 1.0, "sigma": 0.1, "unit": "ppm", "moves": moves}
    assert render("cause.drift", values).text.startswith("gyro_scale_z drifted during")
    assert "This shifts gyro_bias_x by -7 σ, a_b by +4 σ." in render("cause.drift", values).text
    assert "This shifts gyro bias x by −7 σ" in render("cause.drift", values, window=True).text
    assert "陀螺刻度系数 z 在速率" in render("cause.drift", values, "zh_CN", window=True).text


@pytest.mark.parametrize(
    ("probability", "english", "chinese"),
    [
        (5.5e-196, "less than 0.01 %", "不到 0.01 %"),
        (0.0, "less than 0.01 %", "不到 0.01 %"),
        (0.159, "16 %", "16 %"),
        (1.0, "more than 99.99 %", "超过 99.99 %"),
    ],
)
def test_tiny_probability_is_shown_as_a_bound(probability: float, english: str, chinese: str) -> None:
    values = {"probability": probability}
    assert render("engineer.conformity_accepted", values).text.endswith(f"with a probability of {english}.")
    assert render("engineer.conformity_accepted", values, "zh_CN").text.endswith(f"概率为 {chinese}。")
    values = {"other": "rate", "group": "gyro_bias", "stage": "excitation", **values}
    assert f"probability {english}." in render("cause.stages_disagree", values).text


def test_terms_are_translated_and_unknown_ones_are_readable() -> None:
    assert term("source", "table", "zh_CN") == "转台"
    assert term("source", "some_thing") == "some thing"


def test_missing_value_raises_a_key_error() -> None:
    with pytest.raises(KeyError):
        render("program.internal", {})


@pytest.mark.parametrize("kind", [CalstationError, EntryError])
@pytest.mark.parametrize("code", ["", "the table does not answer", "table.never_written"])
def test_error_requires_a_code_of_the_catalogue(kind: type[CalstationError] | type[EntryError], code: str) -> None:
    with pytest.raises(KeyError):
        kind(code)


def test_only_some_faults_are_resettable() -> None:
    assert not CalstationError("program.internal", detail="x").resettable


@pytest.fixture
def in_china(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Set the time zone of this computer to China."""
    if sys.platform == "win32":
        pytest.skip("the time zone of a process cannot be set")
    else:
        monkeypatch.setenv("TZ", "Asia/Shanghai")
        time.tzset()
        yield
        monkeypatch.undo()
        time.tzset()


def test_utc_is_named_without_an_offset(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "UTC")
    time.tzset()
    assert local_time("2026-11-22T23:30:05+00:00", zone=True) == "2026-11-22 23:30:05 UTC"
    monkeypatch.undo()
    time.tzset()


@pytest.mark.usefixtures("in_china")
def test_time_is_shown_in_the_time_zone_of_the_computer() -> None:
    started = "2026-11-22T23:30:05+00:00"
    assert local_time(started) == "2026-11-23 07:30"
    assert local_time(started, zone=True) == "2026-11-23 07:30:05 UTC+08:00"
    assert local_time("yesterday") == "yesterday"
    written = Text.of("registers.written_at", time=started)
    assert sentence(written, "en", window=True) == "registers written 2026-11-23 07:30:05 UTC+08:00"
    assert sentence(written, "zh_CN", window=True) == "寄存器写入于 2026-11-23 07:30:05 UTC+08:00"
    values = {"serial": "SN-1", "number": 2, "stage": "rate", "when": started, "kept": "", "product": ""}
    resume = render("question.resume", values)
    assert resume.remedy.startswith("Started 2026-11-23 07:30:05 UTC+08:00. ")
    transfer = DeviceFaultError("transfer.interrupted", serial="SN-1", utc=started, holds="new")
    assert "(2026-11-23 07:30:05 UTC+08:00)" in str(transfer)


@pytest.mark.parametrize(("language", "text"), [("en", "Turning −x up"), ("zh_CN", "−x 轴朝上")])
def test_directions_of_axes_have_minus_signs(language: Language, text: str) -> None:
    step = step_text("move", ("face_up", "-x"))
    assert render(step.code, step.values, language).text == text


@pytest.mark.parametrize(("count", "text"), [(0, "0 runs"), (1, "1 run"), (2, "2 runs")])
def test_nouns_after_numbers_are_in_the_singular_after_one(count: int, text: str) -> None:
    assert sentence(Text.of("history.run_count", count=count)) == text
    assert sentence(Text.of("history.run_count", count=count), "zh_CN") == f"共 {count} 次"


@pytest.mark.parametrize(("stop_bits", "text"), [(1.0, "1 stop bit"), (1.5, "1.5 stop bits"), (2.0, "2 stop bits")])
def test_nouns_after_decimal_numbers_are_in_the_singular_after_one(stop_bits: float, text: str) -> None:
    values = {"port": "COM3", "baud": 9600, "parity": "N", "stop_bits": stop_bits, "words": ""}
    assert f", {text}." in sentence(Text.of("finding.bad_settings", **values))


def test_counts_that_may_be_one_have_a_noun_that_agrees() -> None:
    never_one = {"chart.gravity_changed", "recording.contradictory"}
    nouns = "bytes|cells|cycles|elements|frames|lines|motions|packets|parameters|pauses|results|rows|samples|units"
    always_plural = re.compile(rf"\{{(?!limit|least|sensor)\w+(?::\.0f)?\}} (?:(?:flash|damaged|whole) )?(?:{nouns})\b")
    for name in catalogue.families():
        for entry in catalogue.family(name).values():
            for text in (entry.text, entry.remedy, entry.window, *entry.operator[:1]):
                assert entry.code in never_one or not always_plural.search(text), entry.code  # {count:# noun} agrees


def test_nouns_that_end_with_s_or_y_have_their_own_plural() -> None:
    assert sentence(Text.of("logs.passed_near", count=1)) == "Passed, 1 near-miss"
    assert sentence(Text.of("logs.passed_near", count=2)) == "Passed, 2 near-misses"
    assert "into only 1 category." in sentence(Text.of("gauge.few_categories", count=1))
    assert "into only 0 categories" in sentence(Text.of("gauge.few_categories", count=0))


@pytest.mark.parametrize(
    ("value", "form", "text"),
    [
        (999.7, ".3g", "1000"),
        (1730.4, ".3g", "1730"),
        (1730.4, "+.2g", "+1730"),
        (0.01234, ".3g", "0.0123"),
        (2e7, ".2g", "2e+07"),
    ],
)
def test_large_numbers_have_no_exponent(value: float, form: str, text: str) -> None:
    assert plain_number(value, form) == text


@pytest.mark.parametrize(
    ("language", "order"), [("en", ("try again", "To go on")), ("zh_CN", ("重试", "要继续，请按"))]
)
def test_advice_on_unverified_registers_names_the_button_after_what_to_do_first(
    language: Language, order: tuple[str, str]
) -> None:
    cause = Text.of("imu.answer_not_framed", port="COM3", seconds=5.0)
    remedy = render("imu.holds_new", {"cause": cause, "serial": "S"}, language, window=True, operator=True).remedy
    first, second = (remedy.index(words) for words in order)
    assert first < second
    assert "Then press" not in remedy
    assert "然后按" not in remedy


@pytest.mark.parametrize(("language", "plain"), [("en", "The unit does not respond"), ("zh_CN", "产品在 5 秒内无应答")])
def test_operators_read_neither_ports_nor_file_names(language: Language, plain: str) -> None:
    values = {"port": "socket://127.0.0.1:42099", "seconds": 5.0, "device": "imu", "reason": "", "number": 3}
    values |= {"log": "SN-1.h5", "path": "SN-1.h5", "section": "imu", "address": 1, "last": 2, "unit": 1, "line": "x"}
    values |= {"found": "x", "expected": "y", "choice": "COM3"}
    for entry in (entry for name in catalogue.families() for entry in catalogue.family(name).values()):
        if entry.operator:
            text = render(entry.code, values, language, window=True, operator=True).text
            assert not {"socket", "h5", "{"} & set(re.split(r"\W", text)), entry.code
    silent = Text.of("imu.holds_new", cause=Text("imu.silent", values))
    assert render(silent.code, silent.values, language, window=True, operator=True).text.startswith(plain)
    assert "42099" in render(silent.code, silent.values, language, window=True).text, "an engineer reads the port"
