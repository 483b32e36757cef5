"""The link test of a text unit names the incorrect entry of [frame] and shows a received line."""

import sys
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from calstation.connection import check_imu_link
from calstation.connection.imu_test import diagnose_text
from calstation.devices.codecs import check_function
from calstation.devices.profiles import FrameSection
from calstation.messages import Finding
from tests.connection.fake_links import english_texts, order, silent, terminal
from tests.helpers import ignore_progress

NAMES = ["counter", "gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"]
FRAME: dict[str, Any] = {
    "format": "text",
    "sync": "$IMU",
    "crc": {"kind": "xor8", "start": 1},
    "fields": [{"name": name, "type": "u32" if name == "counter" else "i32"} for name in NAMES],
}


def line(counter: int = 7, begins: str = "$IMU,", separator: str = ",", numbers: str = "1,2,3,4,5,6") -> bytes:
    """Return a line of the unit with its correct checksum."""
    body = f"{begins}{counter}{separator}{numbers.replace(',', separator)}"
    return f"{body}*{check_function('xor8')(body[1:].encode()):02X}\r\n".encode()


def finding_for(heard: bytes, **changes: Any) -> Finding | None:
    """Return the finding for these bytes with a changed profile."""
    return diagnose_text(FrameSection.model_validate({**FRAME, **changes}), heard)


def fields(*columns: int) -> dict[str, Any]:
    return {"fields": [{**f, "at": at} for f, at in zip(FRAME["fields"], columns, strict=True)]}


def test_valid_sample_lines_pass() -> None:
    assert finding_for(3 * line()) is None
    assert finding_for(2 * line() + b"$IMU,x") is None


@pytest.mark.parametrize(
    ("tail", "end", "found"), [("0D 0A", b"\n", "0A"), ("0D 0A", b"\r", "0D"), ("0A", b"\r\n", "0D 0A")]
)
def test_another_line_end_is_reported(tail: str, end: bytes, found: str) -> None:
    finding = finding_for(3 * line().replace(b"\r\n", end), tail=tail)
    assert finding is not None
    assert (finding.id, finding.values["found"]) == ("line_tail", found)
    assert str(finding.values["line"]).startswith("$IMU,7,1,2")
    assert finding_for(3 * line().replace(b"\r\n", end), tail=end.hex()) is None


@pytest.mark.parametrize(
    ("changes", "expected", "values"),
    [
        ({"sync": "$GPS"}, "line_sync", {"sync": "$GPS"}),
        ({"sync": "$IMU,"}, "line_separator", {"sync": "$IMU,"}),
        ({"separator": ";"}, "line_separator", {"separator": ";"}),
        ({"mark": "#"}, "line_mark", {"mark": "#"}),
        ({"crc": {"kind": "xor8", "start": 0}}, "line_check", {"start": 0, "kind": "xor8"}),
        ({"crc": {"kind": "sum8", "start": 1}}, "line_check", {"kind": "sum8"}),
        (fields(0, 1, 2, 3, 4, 5, 7), "line_short", {"column": 7, "field": "accel_z", "count": 7}),
    ],
)
def test_a_wrong_profile_is_reported(changes: dict[str, Any], expected: str, values: dict[str, Any]) -> None:
    found = finding_for(3 * line(), **changes)
    assert found is not None
    assert found.id == expected
    assert values.items() <= found.values.items()
    assert str(found.values["line"]).startswith("$IMU,7,1,2")
    text, mend = english_texts(found)
    assert "$IMU,7,1,2" in text
    assert mend


def test_wrong_checksum_setting_is_reported_with_both_values() -> None:
    found = finding_for(3 * line(), crc={"kind": "xor8", "start": 0})
    assert found is not None
    right = line().strip().rpartition(b"*")[2].decode()
    assert found.values["told"] == right
    assert int(str(found.values["right"]), 16) == int(right, 16) ^ ord("$")


def test_a_non_numeric_column_is_reported() -> None:
    found = finding_for(3 * line(numbers="1,2,3,4,up,6"))
    assert found is not None
    assert (found.id, found.values["column"], found.values["field"]) == ("line_column", 5, "accel_y")
    assert found.values["text"] == "up"


def test_noise_and_partial_lines_give_no_finding() -> None:
    assert finding_for(bytes(range(0x80, 0xFF)) * 4 + b"\r\n" + bytes(range(0x80, 0xFF)) + b"\r\n") is None
    assert finding_for(line()[:-4]) is None
    assert finding_for(b"") is None


def test_long_line_is_truncated() -> None:
    found = finding_for(3 * (b"#" + b"1,2,3," * 100 + b"\r\n"))
    assert found is not None
    assert len(str(found.values["line"])) <= 123


@pytest.fixture
def product(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A product whose IMU sends text and takes no commands; its profile expects a seventh number."""
    profile = {
        "name": "text",
        "model": "text",
        "protocol": "stream",
        "link": {"baud": 115200},
        "stream": {
            "sample_rate_hz": 100.0,
            "output": "rate",
            "gyro_lsb": 1e-6,
            "accel_lsb": 1e-3,
            "order": "before_registers",
        },
        "frame": {**FRAME, **fields(0, 1, 2, 3, 4, 5, 7)},
        "noise": {"gyro_arw": 1e-5, "accel_vrw": 1e-4},
    }
    for name, content in (
        ("imus/text.toml", profile),
        ("products/text.toml", {"name": "p", "imu": "text", "serial_pattern": ".*"}),
    ):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_text(tomli_w.dumps(content), encoding="utf-8")
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path))
    return tmp_path / "products" / "text.toml"


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals on Windows")
@pytest.mark.parametrize(
    ("begins", "expected"), [("$IMU,", "line_short"), ("$ACC,", "line_sync"), ("$IMU;", "line_separator")]
)
def test_link_test_of_a_text_unit_names_the_incorrect_entry(product: Path, begins: str, expected: str) -> None:
    with terminal(silent, lambda: line(begins=begins)) as port:
        report = check_imu_link(ignore_progress, order(product, imu={"port": port}))
    assert [f.id for f in report.findings if f.state == "error"] == [expected]
