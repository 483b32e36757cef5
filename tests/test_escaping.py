"""One text that would act on every kind of output, if it were not escaped, passes through all of them."""

import csv
import io
import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from calstation.cli.errors import print_error
from calstation.cli.show import emit_json, new_table, plain_console, result_table
from calstation.config.trail import TrailLine, export_trail
from calstation.errors import ConfigurationError, InputError
from calstation.escaping import for_csv, for_file_name, for_terminal, for_zpl
from calstation.records import AuditEvent
from calstation.records.meta import pair_path
from calstation.reports.label import label_fields
from calstation.reports.pdf import compile_template
from calstation.results import Result
from calstation.results.handover import CSV_NAME, _append

WICKED = (
    "=cmd|' /C calc'!A1 [/red][bold]:smile: <b>x</b><img src='file:///etc/passwd'> \x1b[2J\x1b]0;x\x07 \u202egpj.exe"
    ' ^XA~JR #eval("1") \\ $serial {serial} %s ../../etc/passwd\x00 "\',;\nPASS: SN-1\r\u2028\ud83d'
)
RESULT: dict[str, Any] = {
    "schema": "calstation.result/1",
    "unit": {"serial": WICKED},
    "stages": ["rate"],
    "outcome": "passed",
    "parameters": {"gyro_bias_x": {"value": -1e-6, "sigma": 1e-7, "unit": "rad/s", "stage": "rate"}},
    **dict.fromkeys(("product", "station", "operator"), WICKED),
    "started_utc": "2026-11-23T06:30:00+00:00",
    "log": {"file": WICKED},
    "configuration": {},
}
FORBIDDEN = {*map(chr, range(32)), "\x7f", "\u202e", "\u2028", "\ud83d"} - {"\n"}


@pytest.fixture
def result() -> Result:
    return Result.from_json(RESULT)


def test_messages_are_one_line_without_control_characters() -> None:
    for name in ({"en"}, {"zh_CN"}):
        for window in (False, True):
            error = InputError("result.not_a_result", file=WICKED, schema=WICKED)
            text = error.render(*name, window=window).line  # type: ignore[arg-type]
            assert not FORBIDDEN.intersection(text)
            assert "\n" not in text


def test_a_long_value_is_cut_in_messages() -> None:
    assert len(str(ConfigurationError("entry.not_found", file="a" * 10_000))) < 1000
    assert len(str(InputError("csv.no_such_column", file="a", name="b", source="c", remedy=["d" * 9] * 9999))) < 2000


def test_terminal_shows_brackets_and_escapes_control_characters(result: Result, capsys: pytest.CaptureFixture) -> None:
    out = io.StringIO()
    console = plain_console(file=out, width=500)
    table = new_table(WICKED, "cli.column_serial")
    table.add_row(WICKED)
    console.print(table)
    console.print(WICKED)
    result_table(console, result)
    assert out.getvalue().count("[/red][bold]:smile:") == 4
    print_error(WICKED)
    text = out.getvalue() + capsys.readouterr().err
    assert not FORBIDDEN.intersection(text)
    assert r"\x1b[2J" in text


def test_standard_output_as_json_is_ascii(result: Result, capsys: pytest.CaptureFixture) -> None:
    emit_json(result.to_json(), "-")
    text = capsys.readouterr().out
    assert text.isascii()
    assert json.loads(text)["unit"]["serial"] == WICKED


def test_no_cell_of_a_csv_is_a_formula(tmp_path: Path, result: Result) -> None:
    result = Result.from_json(json.loads(json.dumps(RESULT).replace("\\ud83d", "")))  # files are UTF-8
    _append(tmp_path, "run", result)
    text = WICKED[:-1]
    event = AuditEvent(utc="", event=text, by=text, confirmed_by="@x", why="-x", values={}, previous="", digest="")
    export_trail(lambda *_: None, [TrailLine(1, "proved", event)], tmp_path / "trail.csv")
    for name in (CSV_NAME, "trail.csv"):
        rows = list(csv.reader((tmp_path / name).read_text("utf-8-sig").splitlines()))
        assert any("cmd|" in cell for row in rows for cell in row)
        assert not any(cell.startswith(("=", "+", "-", "@")) for row in rows for cell in row)


def test_numbers_in_a_csv_are_unchanged() -> None:
    row = ["-1.5", -2.5, "+3", "1e-6", None, "SN-1", "nan"]
    assert for_csv([row]) == "-1.5,-2.5,+3,1e-6,,SN-1,nan\n"
    assert for_csv([["@a", "-b", "=1+1", "\t=1"]]) == "'@a,'-b,'=1+1,'\t=1\n"


def test_label_printer_receives_no_command(result: Result) -> None:
    for text in map(for_zpl, label_fields(result).values()):
        assert not FORBIDDEN.intersection(text)
        assert not {"^", "~", "\n"}.intersection(text)


def test_typst_shows_the_text_and_evaluates_nothing(tmp_path: Path) -> None:
    (tmp_path / "label.typ").write_text('#set text(font: "Noto Sans SC")\n#sys.inputs.serial', "utf-8")
    text = '#eval("1") \\ $x$ *b* [/red] #read("/etc/passwd") @x <y>'
    content = compile_template(tmp_path / "label.typ", {"serial": text}, datetime.now(UTC), tmp_path)
    assert content.startswith(b"%PDF")


def test_a_file_name_stays_in_its_folder(tmp_path: Path) -> None:
    for text in (WICKED, "..", "/etc/passwd", "a" * 10_000, "CON\\x"):
        assert pair_path(tmp_path, text, text).parent == tmp_path
        assert len(pair_path(tmp_path, text, text).name) < 255
        assert not {"/", "\\", "\x00"}.intersection(for_file_name(text))


def test_escapes_are_readable() -> None:
    assert for_terminal("a\x1b[1m\u202e\n测") == "a\\x1b[1m\\u202e\n测"
