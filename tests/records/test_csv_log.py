"""CSV logs are read in any column order with exact values; every problem gives one clear error."""

import gzip
from pathlib import Path

import numpy as np
import pytest
from records_samples import CSV_HEADER, csv_rows, joined, write_csv_log

from calstation.errors import InputError
from calstation.records import open_log
from calstation.records.csv_logs import csv_text
from tests.helpers import raises_code

PRACTICE = Path(__file__).parents[3] / "shared" / "data" / "practice"


def test_columns_may_be_in_any_order_and_include_optional_columns(tmp_path: Path) -> None:
    header = "valid,step,stage,temp_c,inner_deg,outer_deg,accel_z,accel_y,accel_x,gyro_z,gyro_y,gyro_x,time_s,seq"
    rows = ["1,4,rate,25.5,90,,6,5,4,3,2,1,0.01,0", "0,4,,,,45,6,5,4,3,2,1.5,0.02,1"]
    columns = joined(list(open_log(write_csv_log(tmp_path, rows, header)).blocks()))
    np.testing.assert_array_equal(columns["counts"], [[1, 2, 3, 4, 5, 6], [1.5, 2, 3, 4, 5, 6]])
    np.testing.assert_allclose(columns["angles"], np.deg2rad([[np.nan, 90], [45, np.nan]]), atol=1e-12)
    assert columns["stage"].tolist() == ["rate", ""]
    assert columns["step"].tolist() == [4, 4]
    assert columns["valid"].tolist() == [True, False]
    assert columns["temperature"][0] == 25.5
    assert np.isnan(columns["temperature"][1])


def test_line_ends_quotes_and_a_byte_order_mark_do_not_matter(tmp_path: Path) -> None:
    path = write_csv_log(tmp_path, csv_rows(5))
    plain = joined(list(open_log(path).blocks()))
    text = path.read_text().replace("rate", '"rate"').replace("\n", "\r\n").removesuffix("\r\n")
    path.write_bytes(b"\xef\xbb\xbf" + text.encode())
    for name, column in joined(list(open_log(path).blocks())).items():
        np.testing.assert_array_equal(column, plain[name])


@pytest.mark.parametrize(
    ("old", "new", "code", "sentence"),
    [
        (",98000,", ",nan,", "csv.cell_nan", "accel_z is NaN."),
        (",98000,", ",,", "csv.cell_empty", "accel_z is empty."),
        (",98000,", ",9x,", "csv.cell_not_number", "accel_z = '9x' is not a number."),
        (",98000,", ",inf,", "csv.cell_infinite", "accel_z is infinite."),
        (",98000,", ",", "csv.wrong_width", "The row has 11 cells, the header 12."),
        ("3,0.0400", "3.5,0.0400", "csv.cell_not_whole", "seq = 3.5 is not a whole number."),
        ("3,0.0400", "2,0.0400", "csv.sequence", "seq 2 is repeated"),
        ("3,0.0400", "1,0.0400", "csv.sequence", "seq falls from 2 to 1"),
        ("3,0.0400", "3,0.0100", "csv.sequence", "time_s falls from 0.03 to 0.01 s"),
        ("rate,0", "rate,0.5", "csv.cell_not_whole", "step = 0.5 is not a whole number."),
        (",0.5,", ",abc,", "csv.cell_not_number", "outer_deg = 'abc' is not a number."),
    ],
)
def test_damaged_row_is_lost_and_reported_if_there_are_many(
    tmp_path: Path, old: str, new: str, code: str, sentence: str
) -> None:
    rows = csv_rows(10)
    assert old in rows[3]
    rows[3] = rows[3].replace(old, new)
    path = write_csv_log(tmp_path, rows)
    if code != "csv.sequence":
        log = open_log(path)
        assert joined(list(log.blocks()))["seq"].tolist() == [0, 1, 2, 4, 5, 6, 7, 8, 9]
        assert [(d.row, d.count, d.after, d.before) for d in log.damaged_rows] == [(3, 1, 2, 4)]
        path = write_csv_log(tmp_path, [rows[3]] * 10)
        sentence = f"{path}, line 2: {sentence}"
    else:
        sentence = f"{path}, line 5: {sentence}"
    with raises_code(InputError, code) as caught:
        list(open_log(path).blocks())
    assert str(caught.value).startswith(sentence)
    assert "\n" not in str(caught.value)


def test_damaged_rows_late_in_a_long_file_are_lost(tmp_path: Path) -> None:
    rows = csv_rows(9000)
    rows[8000] = rows[8000].replace(",98000,", ",nan,")
    rows[8999] = rows[8999][:12]
    log = open_log(write_csv_log(tmp_path, rows))
    assert (log.facts().samples, log.facts().gaps, log.facts().damaged) == (8998, 1, 2)
    assert [part.missing for part in log.damaged_rows] == ["8000…8000", "8999…"]


@pytest.mark.parametrize("cell", ["", " ", "nan", "inf"])
def test_only_rows_marked_invalid_may_contain_nan(tmp_path: Path, cell: str) -> None:
    rows = [f"{row},{int(k != 3)}" for k, row in enumerate(csv_rows(6))]
    rows[3] = rows[3].replace(",98000,", f",{cell},")
    columns = joined(list(open_log(write_csv_log(tmp_path, rows, f"{CSV_HEADER},valid")).blocks()))
    assert columns["valid"].tolist() == [True] * 3 + [False] + [True] * 2
    assert np.isfinite(columns["counts"]).all(axis=1).tolist() == columns["valid"].tolist()
    rows[4] = rows[4].replace(",98000,", f",{cell},")
    log = open_log(write_csv_log(tmp_path, rows, f"{CSV_HEADER},valid"))
    assert joined(list(log.blocks()))["seq"].tolist() == [0, 1, 2, 3, 5]
    assert log.facts().damaged == 1


@pytest.mark.parametrize("row", ['"a\r"b,1', '1,"2\r\r3",x\ry', '1,"2'])
def test_a_malformed_quoted_line_is_a_damaged_row(tmp_path: Path, row: str) -> None:
    log = open_log(write_csv_log(tmp_path, [*csv_rows(60), row]))
    assert joined(list(log.blocks()))["seq"].tolist() == list(range(60))
    assert log.facts().damaged > 0


@pytest.mark.parametrize("column", CSV_HEADER.split(","))
def test_missing_column_is_reported(tmp_path: Path, column: str) -> None:
    header = CSV_HEADER.replace(column, "other")
    with pytest.raises(InputError) as caught:
        list(open_log(write_csv_log(tmp_path, csv_rows(3), header)).blocks())
    assert caught.value.code in ("csv.column_missing", "csv.column_misspelt")
    assert caught.value.values["column"] == column


def test_misspelled_column_is_reported(tmp_path: Path) -> None:
    header = CSV_HEADER.replace("time_s", "times")
    with raises_code(InputError, "csv.column_misspelt") as caught:
        list(open_log(write_csv_log(tmp_path, csv_rows(3), header)).blocks())
    assert caught.value.values["near"] == "times"


def test_manual_recording_needs_no_table_columns(tmp_path: Path) -> None:
    header = "seq,time_s,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z,stage,step"
    rows = [row.replace(",0.5,,rate,0", ",,0") for row in csv_rows(5)]
    columns = joined(list(open_log(write_csv_log(tmp_path, rows, header)).blocks()))
    assert np.all(np.isnan(columns["angles"]))
    assert columns["stage"].tolist() == [""] * 5


def test_swapped_rows_repeated_logs_and_empty_logs_are_reported(tmp_path: Path) -> None:
    rows = csv_rows(600)
    with raises_code(InputError, "csv.sequence"):
        list(open_log(write_csv_log(tmp_path, [*rows[:5], rows[6], rows[5], *rows[7:]])).blocks())
    with raises_code(InputError, "csv.repeated") as caught:
        list(open_log(write_csv_log(tmp_path, rows + rows)).blocks())
    assert caught.value.values["line"] == 602
    with raises_code(InputError, "csv.no_samples"):
        list(open_log(write_csv_log(tmp_path, [])).blocks())
    (tmp_path / "log.csv").write_text("")
    with raises_code(InputError, "csv.empty"):
        list(open_log(tmp_path / "log.csv").blocks())


def test_sample_rate_that_contradicts_the_timestamps_is_reported(tmp_path: Path) -> None:
    path = write_csv_log(tmp_path, csv_rows(50), rate=200.0)
    with raises_code(InputError, "csv.wrong_rate") as caught:
        list(open_log(path).blocks())
    assert "time_s runs at 100 Hz, but imu.sample_rate_hz = 200." in str(caught.value)


def test_files_that_are_not_logs_are_reported(tmp_path: Path) -> None:
    path = write_csv_log(tmp_path, csv_rows(2000))
    packed = tmp_path / "log.csv.gz"
    packed.write_bytes(gzip.compress(path.read_bytes())[:-200])
    with raises_code(InputError, "csv.damaged_gzip"):
        list(open_log(packed).blocks())
    path.write_bytes(path.read_bytes() + b"\xff\xfe\n")
    with raises_code(InputError, "csv.not_utf8"):
        list(open_log(path).blocks())
    with raises_code(InputError, "log.not_found"):
        open_log(tmp_path / "absent.csv")
    with raises_code(InputError, "log.not_a_log"):
        open_log(tmp_path / "log.txt")
    (tmp_path / "log.toml").unlink()
    with pytest.raises(InputError, match=r"log.toml: (n|N)o such file"):
        open_log(path)


def test_range_of_unwrapped_counts_is_selected(tmp_path: Path) -> None:
    rows = csv_rows(400)
    wrapped = [f"{i % 256},{row.split(',', 1)[1]}" for i, row in enumerate(rows)]
    log = open_log(write_csv_log(tmp_path, wrapped))
    seq = joined(list(log.blocks(250, 260)))["seq"]
    assert seq.tolist() == list(range(250, 261))
    assert (log.facts().first_seq, log.facts().last_seq) == (0, 399)
    with raises_code(InputError, "log.empty_range") as caught:
        list(log.blocks(500, 600))
    assert "The log contains no sample from 500 to 600, only from 0 to 399." in str(caught.value)
    with raises_code(InputError, "log.empty_range") as caught:
        list(log.blocks(500))
    assert "from 500 to the end" in str(caught.value)


@pytest.mark.parametrize("modulo", [False, True])
def test_angles_do_not_depend_on_the_chunks_in_which_a_file_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, modulo: bool
) -> None:
    """The table turns by 300° between two polls, and leaves the range of a turn later."""
    seconds = np.arange(1, 401) / 100.0
    turned = np.interp(seconds, [0.62, 1.2, 2.0, 3.0], [0.0, 300.0, 300.0, 700.0])
    angles = turned % 360.0 if modulo else turned
    rows = [
        f"{row.rsplit(',', 4)[0]},{angles[k] if k % (5 if modulo else 60) == 0 else ''},,rate,0"
        for k, row in enumerate(csv_rows(400))
    ]
    path = write_csv_log(tmp_path, rows)
    for chunk in (1 << 17, 4000, 600, 150):
        monkeypatch.setattr(csv_text, "_CHUNK", chunk)
        outer = np.rad2deg(joined(list(open_log(path).blocks()))["angles"][:, 0])
        polled = np.isfinite(outer)
        np.testing.assert_allclose(outer[polled], turned[polled], atol=1e-9)


@pytest.mark.skipif(not PRACTICE.is_dir(), reason="the practice logs are not beside the project")
@pytest.mark.parametrize("name", ["nav_full", pytest.param("mems_full", marks=pytest.mark.long)])
def test_practice_logs_are_read_completely(name: str) -> None:
    log = open_log(PRACTICE / f"{name}.csv.gz")
    count = sum(len(block) for block in log.blocks())
    assert count == 205_200
    assert log.facts().gaps == 0
