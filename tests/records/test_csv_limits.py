"""A CSV with excessive lines, columns, names or numbers is refused early, by line and column."""

import gzip
import time
from pathlib import Path

import pytest
from records_samples import CSV_HEADER, write_csv_log

from calstation.errors import InputError
from calstation.records import open_log

ROWS = [f"{k},{k / 100},1,-2,3,4,5,98000,,,rate,0" for k in range(1, 9)]


def refusal(path: Path) -> InputError:
    with pytest.raises(InputError) as caught:
        list(open_log(path).blocks())
    assert len(str(caught.value)) < 400
    return caught.value


def row(**cells: str) -> str:
    """Return the ninth row with other cells."""
    names = CSV_HEADER.split(",")
    values = dict(zip(names, ROWS[-1].split(","), strict=True)) | {"seq": "9", "time_s": "0.09"} | cells
    return ",".join(values[name] for name in names)


@pytest.mark.parametrize(
    ("cells", "code"),
    [
        ({"gyro_x": "1e300"}, "csv.cell_too_large"),
        ({"time_s": "1e300"}, "csv.cell_too_large"),
        ({"gyro_z": "1e9"}, "csv.cell_implausible"),
        ({"accel_x": "1e10"}, "csv.cell_implausible"),
        ({"seq": "9" * 17}, "csv.cell_too_large"),
        ({"seq": "-1e19"}, "csv.cell_too_large"),
        ({"step": "9" * 20}, "csv.cell_too_large"),
        ({"stage": "s" * 65}, "csv.stage_too_long"),
        ({"stage": "测" * 22}, "csv.stage_too_long"),
        ({"stage": "s" * 30_000}, "csv.stage_too_long"),
    ],
)
def test_excessive_cells_are_refused_by_line_and_column(tmp_path: Path, cells: dict[str, str], code: str) -> None:
    error = refusal(write_csv_log(tmp_path, [*ROWS, row(**cells)]))
    assert error.code == code
    assert (error.values["line"], error.values["column"]) == (10, next(iter(cells)))


def test_a_number_of_any_length_damages_its_row(tmp_path: Path) -> None:
    endless = row(seq="9" * 5000)
    assert open_log(write_csv_log(tmp_path, [*ROWS, endless])).facts().damaged == 1
    error = refusal(write_csv_log(tmp_path, [*ROWS, endless, endless, endless]))
    assert (error.code, error.values["line"], error.values["column"]) == ("csv.cell_infinite", 10, "seq")


@pytest.mark.parametrize("time_s", [f"{'9' * 5000}:00:00", f"{'9' * 400}:00", "0001-01-01T00:00+23:59"])
def test_a_time_of_any_length_damages_its_row(tmp_path: Path, time_s: str) -> None:
    assert open_log(write_csv_log(tmp_path, [*ROWS, row(time_s=time_s)])).facts().damaged == 1
    clocks = [each.replace(",", ",00:00:0", 1) for each in ROWS]
    damaged = open_log(write_csv_log(tmp_path, [*clocks, row(time_s=f"{'9' * 5000}:00:00")])).facts()
    assert (damaged.samples, damaged.damaged) == (len(ROWS), 1)


@pytest.mark.parametrize("cell", ["_" * 60_000, "(" * 60_000, "(_" * 30_000 + "]"])
def test_a_long_header_cell_is_read_at_once(tmp_path: Path, cell: str) -> None:
    path = write_csv_log(tmp_path, [f"{each},1" for each in ROWS], f"{CSV_HEADER},{cell}")
    started = time.monotonic()
    assert open_log(path).facts().samples == len(ROWS)
    assert time.monotonic() - started < 1.0


def test_many_columns_are_refused(tmp_path: Path) -> None:
    header = CSV_HEADER + ",x" * 1000
    assert refusal(write_csv_log(tmp_path, ROWS, header)).code == "csv.too_many_columns"


@pytest.mark.parametrize("suffix", ["", ".gz"])
def test_an_endless_line_is_refused_at_once(tmp_path: Path, suffix: str) -> None:
    plain = write_csv_log(tmp_path, ROWS)
    content = plain.read_bytes() + b"7" * 50_000_000
    path = tmp_path / f"log.csv{suffix}"
    path.write_bytes(gzip.compress(content, 1) if suffix else content)
    started = time.monotonic()
    error = refusal(path)
    assert time.monotonic() - started < 1.0
    assert (error.code, error.values["line"]) == ("csv.line_too_long", 10)


def test_lines_may_end_with_a_carriage_return_only(tmp_path: Path) -> None:
    path = write_csv_log(tmp_path, ROWS)
    path.write_bytes(path.read_bytes().replace(b"\n", b"\r"))
    assert open_log(path).facts().samples == len(ROWS)
