"""Values in a certificate are rounded to two significant digits of their uncertainty."""

import math
from datetime import UTC, datetime, timedelta

import pytest

from calstation.messages import Language
from calstation.physics import DEGREE_PER_HOUR, DISPLAY
from calstation.reports.content import performed
from calstation.reports.numbers import compared, interval, limit_text, rounded, short
from calstation.reports.schedule import schedule_words
from calstation.results import SCHEMA, Result


@pytest.mark.parametrize(
    ("value", "uncertainty", "text"),
    [
        (100.02147, 0.00079, "100.02147"),  # JCGM 100:2008, 7.2.2
        (1.7449, 0.0204, "1.745"),
        (-806.3961, 0.8571, "−806.40"),
        (0.0996, 0.0996, "0.10"),  # 0.0996 is 0.10 to two digits
        (12345.6, 1234.0, "12300"),
        (-0.0004, 0.13, "0.00"),
        (3.0, 0.0, "3"),
        (math.nan, 0.1, "–"),
        (None, 0.1, "–"),
    ],
)
def test_value_is_rounded_to_the_second_digit_of_its_uncertainty(
    value: float | None, uncertainty: float, text: str
) -> None:
    assert rounded(value, uncertainty) == text


def test_values_have_more_digits_if_the_rounded_value_contradicts_the_decision() -> None:
    limit = (-0.5, 0.5)
    assert compared("−0.50", 1.0, -0.504, limit) == "−0.504"
    assert compared("−0.50", 1.0, -0.496, limit) == "−0.50"
    assert compared("7.8", 1.0, 3.914, 3.9, 2.0) == "7.83", "the uncertainty exceeds the permitted one"
    assert compared("–", 1.0, math.nan, limit) == "–"
    assert compared("1 × 10⁻⁷", 1.0, 1e-7, 1.0) == "1 × 10⁻⁷"


def test_limits_are_printed_as_they_were_entered_unless_that_contradicts_the_decision() -> None:
    assert interval(-0.5, 0.5, 1.0, 0.2) == "±0.5"
    assert interval(-1.0, 2.0, 1.0, 0.0) == "−1 … 2"
    assert interval(-1.5e-5, 1.5e-5, DEGREE_PER_HOUR, 0.0) == "±3.1"  # 3.09397 °/h
    assert interval(-1.5e-5, 1.5e-5, DEGREE_PER_HOUR, -3.096 * DEGREE_PER_HOUR) == "±3.094", "the value is outside"
    assert interval(-0.0052, 0.0052, DEGREE_PER_HOUR, 0.0) == "±1073"
    assert interval(-0.0052, 0.0052, DEGREE_PER_HOUR, 1072.8 * DEGREE_PER_HOUR) == "±1072.577"
    assert limit_text(math.inf, 1.0, 0.0) == "–"
    assert short(648000.4) == "648000"
    assert short(1e-6) == "1 × 10⁻⁶"
    assert short(math.inf) == "–"


@pytest.mark.parametrize(("ended", "hours"), [("2026-11-01T08:20:00+00:00", 1 / 3), (None, 2.0)])
def test_calibration_ends_at_the_time_of_the_computer_or_else_after_its_device_time(
    ended: str | None, hours: float
) -> None:
    run = {"started_utc": "2026-11-01T08:00:00+00:00", "ended_utc": ended, "duration_s": 7200.0}
    rest = {"stages": [], "outcome": "passed", "parameters": {}, "log": {"file": "log.h5"}}
    begin = datetime(2026, 11, 1, 8, tzinfo=UTC)
    result = Result.from_json({"schema": SCHEMA, "unit": {"serial": "SN-1"}, **rest, **run})
    assert performed(result) == (begin, begin + timedelta(hours=hours))


@pytest.mark.parametrize(
    ("language", "words"),
    [
        ("en", "Target sigma: accel bias x 80 µg, gyro bias 3 °/h"),
        ("zh_CN", "目标标准差: 加表零偏 x 80 µg, 陀螺零偏 3 °/h"),
    ],
)
def test_target_sigmas_have_units_for_parameters_and_groups(language: Language, words: str) -> None:
    targets = {"accel_bias_x": 80.0 * DISPLAY["accel_bias"][1], "gyro_bias": 3.0 * DEGREE_PER_HOUR}
    assert words in schedule_words("excitation", {"targets": targets}, language)


@pytest.mark.parametrize(
    ("stage", "planned", "made", "english", "chinese"),
    [
        ("designed", 22, 12, "Moves 12 (planned: at most 22)", "转动次数 12（计划最多 22）"),
        ("designed", 22, 22, "Moves 22", "转动次数 22"),
        ("designed", 22, None, "Moves 22", "转动次数 22"),
        ("excitation", 0, 3, "Rounds 3", "轮数 3"),
    ],
)
def test_number_of_moves_that_were_made_is_stated(
    stage: str, planned: int, made: int | None, english: str, chinese: str
) -> None:
    assert list(schedule_words(stage, {"rounds": planned}, "en", made)) == [english]
    assert list(schedule_words(stage, {"rounds": planned}, "zh_CN", made)) == [chinese]
