"""Import and export preserve samples, stages and configuration exactly."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from records_samples import CSV_HEADER, META, assert_same, csv_rows, make_block, write_csv_log

from calstation.errors import InputError
from calstation.estimation.common import SampleBlock, snap_angles
from calstation.records import LogMeta, RawLogWriter, export_csv, open_log
from calstation.records.columns import further_channels
from tests.helpers import convert_log, raises_code


def write_log(path: Path, meta: LogMeta, blocks: list[SampleBlock]) -> str:
    writer = RawLogWriter(path, meta)
    for block in blocks:
        writer.append(block)
    return writer.close("passed").sha256


@pytest.mark.parametrize("name", ["out.csv", "out.csv.gz"])
def test_export_and_import_give_the_same_log(
    tmp_path: Path, meta: LogMeta, blocks: list[SampleBlock], name: str
) -> None:
    source = tmp_path / "run.h5"
    digest = write_log(source, meta, blocks)
    assert export_csv(source, tmp_path / name).sha256 == digest
    copy = tmp_path / "copy.h5"
    assert convert_log(tmp_path / name, copy).sha256 == digest
    for path in (source, tmp_path / name, copy):
        log = open_log(path)
        assert log.meta == meta
        assert_same(list(log.blocks()), blocks)


def test_part_of_a_log_can_be_exported(tmp_path: Path, meta: LogMeta, blocks: list[SampleBlock]) -> None:
    source, target = tmp_path / "run.h5", tmp_path / "part.csv"
    write_log(source, meta, blocks)
    first, last = int(blocks[0].seq[3]), int(blocks[-1].seq[-2])
    export_csv(source, target, first_seq=first, last_seq=last)
    part = open_log(target)
    assert (part.facts().first_seq, part.facts().last_seq) == (first, last)
    assert_same(list(part.blocks()), list(open_log(source).blocks(first, last)))


def test_additional_imus_joint_angles_and_station_times_are_preserved(tmp_path: Path) -> None:
    imu = {key: value for key, value in META["imu"].items() if key != "serial"}
    further = {
        **imu,
        "gyro_lsb": 1e-6,
        "stored": {"values": {"secondary_gyro_bias_x": 0.1 + 0.2}, "gyro_static": 1e-3},
    }
    meta = LogMeta.model_validate({**META, "imu2": {"serial": "B", **further}, "imu3": {"serial": "C", **imu}})
    random = np.random.default_rng(1)
    blocks = []
    for k, plain in enumerate([make_block("", 0, 30), make_block("cross_calibration", 30, 500)]):
        others = random.integers(-(2**20), 2**20, (len(plain), 2, 6)).astype(np.float64)
        others[random.random(len(plain)) < 0.2, 1] = np.nan
        joints = snap_angles(random.uniform(-3, 3, (len(plain), 3)))
        joints[k::2] = np.nan
        station = 1e5 + plain.seq[:, None] / 100.0 + 0.1 * random.random((len(plain), 1))
        station[: len(plain) - 1 : 1 + k] = np.nan
        chamber = np.where(random.random((len(plain), 1)) < 0.1, -40.0 + random.random((len(plain), 1)), np.nan)
        blocks.append(replace(plain, others=others, joints=joints, station=station, chamber=chamber))
    writer = RawLogWriter(tmp_path / "run.h5", meta, joints=True, station=True, chamber=True)
    for block in blocks:
        writer.append(block)
    digest = writer.close("passed").sha256
    assert export_csv(tmp_path / "run.h5", tmp_path / "out.csv").sha256 == digest
    assert convert_log(tmp_path / "out.csv", tmp_path / "copy.h5").sha256 == digest
    assert "gyro3_x" in (tmp_path / "out.csv").read_text().split("\n")[0]
    for name in ("run.h5", "out.csv", "copy.h5"):
        log = open_log(tmp_path / name)
        assert log.meta == meta
        back = list(log.blocks())
        assert_same(back, blocks)
        for column in ("others", "joints", "station", "chamber"):
            assert np.array_equal(
                np.concatenate([getattr(b, column) for b in back]),
                np.concatenate([getattr(b, column) for b in blocks]),
                equal_nan=True,
            )
    blocks[1].others[17, 0, 3] += 1
    other = RawLogWriter(tmp_path / "other.h5", meta, joints=True, station=True, chamber=True)
    for block in blocks:
        other.append(block.part(0, 11))
        other.append(block.part(11, len(block)))
    assert other.close("passed").sha256 != digest


def test_columns_of_additional_imus_require_their_configuration(tmp_path: Path) -> None:
    header = CSV_HEADER + "," + ",".join(further_channels(2))
    path = write_csv_log(tmp_path, [row + ",1,2,3,4,5,6" for row in csv_rows(3)], header)
    with raises_code(InputError, "csv.imu_not_configured"):
        list(open_log(path).blocks())
    toml = path.with_suffix(".toml")
    imu = toml.read_text().split("[imu]")[1].split("[table]")[0]
    toml.write_text(toml.read_text() + f"\n[imu2]\n{imu}")
    assert next(iter(open_log(path).blocks())).others[0, 0].tolist() == [1, 2, 3, 4, 5, 6]
    path = write_csv_log(tmp_path, csv_rows(3))
    toml.write_text(toml.read_text() + f"\n[imu2]\n{imu}")
    with raises_code(InputError, "csv.imu_column_missing"):
        list(open_log(path).blocks())
    toml.write_text(toml.read_text().replace("[imu2]", "[imu3]"))
    with pytest.raises(InputError, match="Number further IMUs from 2 on"):
        open_log(path)


@given(st.floats(-1e3, 1e3))
def test_angles_on_the_grid_survive_conversion_to_degrees(angle: float) -> None:
    snapped = snap_angles(np.array([angle]))
    text = repr(float(np.rad2deg(snapped)[0]))
    assert snap_angles(np.deg2rad(np.array([float(text)])))[0] == snapped[0]


def test_invalid_csv_leaves_no_log(tmp_path: Path) -> None:
    rows = csv_rows(3000)
    rows[2500] = rows[2500].replace("2500,", "2499,")
    with raises_code(InputError, "csv.sequence") as caught:
        convert_log(write_csv_log(tmp_path, rows), tmp_path / "log.h5")
    assert caught.value.values["line"] == 2502
    assert not (tmp_path / "log.h5").exists()
    with raises_code(InputError, "csv.import_name"):
        convert_log(tmp_path / "log.csv", tmp_path / "log.raw")


def test_export_neither_overwrites_its_source_nor_leaves_a_partial_file(tmp_path: Path) -> None:
    path = write_csv_log(tmp_path, csv_rows(3))
    with raises_code(InputError, "csv.export_onto_itself"):
        export_csv(path, path)
    with raises_code(InputError, "csv.export_name"):
        export_csv(path, tmp_path / "x.txt")
    path.write_text(path.read_text().replace("98000", "nan"))
    with pytest.raises(InputError):
        export_csv(path, tmp_path / "other.csv")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["log.csv", "log.toml"]
    with raises_code(InputError, "csv.not_written"):
        export_csv(path, tmp_path / "absent" / "other.csv")


def test_column_with_decimals_has_no_quantisation_unless_configured(tmp_path: Path) -> None:
    rows = [row.split(",") for row in csv_rows(400)]
    for row in rows:
        row[5:8] = [f"{float(value) + 0.25}" for value in row[5:8]]
    path = write_csv_log(tmp_path, [",".join(row) for row in rows])
    imu = open_log(path).meta.imu
    assert (imu.gyro_quantisation, imu.accel_quantisation) == (None, 0.0)
    text = path.with_suffix(".toml").read_text()
    path.with_suffix(".toml").write_text(text.replace("[imu]\n", "[imu]\naccel_quantisation = 1e-3\n"))
    assert open_log(path).meta.imu.accel_quantisation == 1e-3


def test_blocks_without_station_times_can_precede_blocks_with_them(tmp_path: Path) -> None:
    meta = LogMeta.model_validate(META)
    writer = RawLogWriter(tmp_path / "run.h5", meta, station=True)
    blocks = [make_block("rate", 0, 50), make_block("rate", 50, 50)]
    writer.append(blocks[0])
    writer.append(replace(blocks[1], station=np.arange(50.0)[:, None]))
    digest = writer.close("passed").sha256
    log = open_log(tmp_path / "run.h5")
    assert log.facts().sha256 == digest
    station = np.concatenate([block.station for block in log.blocks()])[:, 0]
    assert np.isnan(station[:50]).all()
    assert np.array_equal(station[50:], np.arange(50.0))
