"""Texts appear in the terminal as they are, with their brackets."""

import io
from pathlib import Path

import calstation.cli
from calstation.cli.show import new_table, plain_console, result_table
from calstation.judgement import Check
from calstation.results import Result

REMEDY = "Set sample_rate_hz = 200 in [imu], or correct [columns] of /data/[bold]log.csv."


def test_brackets_are_printed() -> None:
    out = io.StringIO()
    table = new_table("", "cli.column_parameter")
    table.add_row("[prior]")
    for item in (REMEDY, table):
        plain_console(file=out, width=120).print(item)
    assert REMEDY in out.getvalue()
    assert "[prior]" in out.getvalue()


def test_every_command_prints_to_such_a_console() -> None:
    files = Path(calstation.cli.__file__).parent.rglob("*.py")
    own = {path.name for path in files if "= Console(" in (text := path.read_text("utf-8")) or "(Console(" in text}
    assert not own


def test_sample_rate_is_shown_in_ppm() -> None:
    out = io.StringIO()
    check = Check.compare("sample_clock", 1.339e-5, 9.579e-5, "1")
    unit = {"schema": "calstation.result/1", "unit": {"serial": "SN-1"}, "stages": [], "outcome": "passed"}
    result = Result.from_json({**unit, "parameters": {}, "log": {"file": "log.h5"}, "checks": [check.to_json()]})
    result_table(plain_console(file=out, width=120), result)
    assert "13.39 ppm" in out.getvalue()
    assert "95.79 ppm" in out.getvalue()


def test_a_sigma_that_exceeds_its_limit_is_shown_larger() -> None:
    out = io.StringIO()
    check = Check.compare("sigma_below", 1.9034e-5, 1.9e-5, "rad/s", subject="gyro_bias_x")
    rows = {"gyro_bias_x": {"value": 1e-6, "sigma": 1.9034e-5, "unit": "rad/s", "stage": "rate"}}
    unit = {"schema": "calstation.result/1", "unit": {"serial": "SN-1"}, "stages": ["rate"], "outcome": "failed"}
    result = Result.from_json({**unit, "parameters": rows, "log": {"file": "log.h5"}, "checks": [check.to_json()]})
    result_table(plain_console(file=out, width=120), result)
    (line,) = (line.split() for line in out.getvalue().splitlines() if line.split()[:1] == ["gyro_bias_x"])
    assert line[2:5] == ["3.93", "°/h", "3.9"]
