"""A folder with one CSV file for each position is one log."""

from pathlib import Path

import numpy as np
import pytest
from foreign_samples import TOML
from records_samples import joined

from calstation.errors import InputError
from calstation.records import open_log, write_log
from calstation.records.csv_logs.csv_folder import csv_files
from calstation.results import inspect_log
from tests.helpers import raises_code

RATE, SECONDS = 50.0, 8
FACES = [
    (0, 0, 1),
    (0, 0, -1),
    (0, 1, 0),
    (0, -1, 0),
    (1, 0, 0),
    (-1, 0, 0),
    (0.6, 0.8, 0),
    (0, 0.6, 0.8),
    (0.8, 0, 0.6),
    (0.5, 0.7, 0.51),
]
COLUMNS = "[columns]\n" + "".join(
    f'{sensor}_{axis} = {{ from = "{sensor[0]}{axis}", unit = "{unit}" }}\n'
    for sensor, unit in (("gyro", "deg/s"), ("accel", "g"))
    for axis in "xyz"
)


def write_faces(folder: Path, starts: list[float], lines: int = round(RATE * SECONDS)) -> None:
    """Write a file for each position, whose times begin at `starts`, s; the names count from 1."""
    folder.mkdir()
    random = np.random.default_rng(5)
    for k, start in enumerate(starts):
        values = random.normal([0.1, 0, 0, *FACES[k]], 0.002, (lines, 6))
        rows = [f"{start + n / RATE:.3f},{','.join(f'{v:.5f}' for v in row)}" for n, row in enumerate(values, 1)]
        (folder / f"face {k + 1}.csv").write_text("\n".join(["time_s,gx,gy,gz,ax,ay,az", *rows]))
    folder.with_suffix(".toml").write_text(TOML + COLUMNS)


def test_files_of_faces_are_one_log(tmp_path: Path) -> None:
    write_faces(folder := tmp_path / "faces", [0.0] * 10)
    log = open_log(folder)
    found = joined(list(log.blocks()))
    np.testing.assert_array_equal(np.unique(found["step"]), np.arange(10))
    assert (log.facts().samples, log.facts().gaps) == (4000, 9)
    np.testing.assert_allclose(np.diff(found["time"]), np.diff(found["seq"]) / RATE, atol=1e-9)
    np.testing.assert_allclose(np.unique(np.round(np.diff(found["time"]), 9)), [0.02, 1.0], atol=1e-9)
    assert found["counts"][400 * 9, 4] * log.meta.imu.accel_lsb == pytest.approx(0.7 * 9.80665, abs=0.1), (
        "face 10 is last"
    )
    write_log(tmp_path / "x.h5", log.meta, log.blocks())
    assert open_log(tmp_path / "x.h5").facts().sha256 == log.facts().sha256


@pytest.mark.long
def test_one_file_for_each_face_is_solved(tmp_path: Path) -> None:
    write_faces(folder := tmp_path / "faces", [0.0] * 10)
    assert inspect_log(open_log(folder)).methods["multi_position"] is None


def test_times_that_continue_are_kept(tmp_path: Path) -> None:
    write_faces(folder := tmp_path / "faces", [100.0, 108.0, 130.0])
    found = joined(list(open_log(folder).blocks()))
    np.testing.assert_allclose(found["time"][[0, 399, 400, 800]], [100.02, 108.0, 108.02, 130.02])
    np.testing.assert_array_equal(found["seq"][[0, 399, 400, 799, 800]], [0, 399, 400, 799, 1500])


def test_damage_is_counted_and_named(tmp_path: Path) -> None:
    write_faces(folder := tmp_path / "faces", [0.0, 0.0])
    path = folder / "face 2.csv"
    lines = path.read_text().split("\n")
    lines[11] = "0.22,1"
    path.write_text("\n".join(lines))
    log = open_log(folder)
    assert (log.facts().damaged, log.facts().gaps) == (1, 2)
    assert [part.missing for part in log.damaged_rows] == ["459…459"]
    path.write_text("time_s,gx,gy,gz,ax,ay\n")
    with raises_code(InputError, "csv.no_such_column") as caught:
        open_log(folder)
    assert caught.value.values["file"] == path
    (empty := tmp_path / "empty").mkdir()
    with raises_code(InputError, "csv.empty_folder"):
        open_log(empty)


def test_files_are_in_the_order_of_their_names_with_numbers_by_value(tmp_path: Path) -> None:
    for name in ("up 10", "up 2", "down 1", "up 02b"):
        (tmp_path / f"{name}.csv").write_text("")
    assert [file.stem for file in csv_files(tmp_path)] == ["down 1", "up 2", "up 02b", "up 10"]
