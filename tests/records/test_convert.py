"""Import and export lose nothing: not a bit of a sample, a stage or the configuration."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from records_samples import assert_same, csv_rows, write_csv_log

from calstation.errors import InputError
from calstation.estimation.samples import SampleBlock, snap_angles
from calstation.records.convert import export_csv, import_csv
from calstation.records.log import open_log
from calstation.records.meta import LogMeta
from calstation.records.raw_log import RawLogWriter


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
    assert import_csv(tmp_path / name, copy).sha256 == digest
    for path in (source, tmp_path / name, copy):
        log = open_log(path)
        assert log.meta == meta
        assert_same(list(log.blocks()), blocks)


@settings(deadline=None, max_examples=300)
@given(st.floats(-1e3, 1e3))
def test_angles_on_the_grid_survive_degrees(angle: float) -> None:
    snapped = snap_angles(np.array([angle]))
    text = repr(float(np.rad2deg(snapped)[0]))
    assert snap_angles(np.deg2rad(np.array([float(text)])))[0] == snapped[0]


def test_a_csv_that_cannot_be_used_leaves_no_log_behind(tmp_path: Path) -> None:
    rows = csv_rows(3000)
    rows[2500] = rows[2500].replace("98000", "nan")
    with pytest.raises(InputError, match="line 2502"):
        import_csv(write_csv_log(tmp_path, rows), tmp_path / "log.h5")
    assert not (tmp_path / "log.h5").exists()
    with pytest.raises(InputError, match=r"ends in \.h5"):
        import_csv(tmp_path / "log.csv", tmp_path / "log.raw")


def test_an_export_neither_overwrites_its_source_nor_leaves_half_a_file(tmp_path: Path) -> None:
    path = write_csv_log(tmp_path, csv_rows(3))
    with pytest.raises(InputError, match="is the log itself"):
        export_csv(path, path)
    with pytest.raises(InputError, match=r"ends in \.csv"):
        export_csv(path, tmp_path / "x.txt")
    path.write_text(path.read_text().replace("98000", "nan"))
    with pytest.raises(InputError):
        export_csv(path, tmp_path / "other.csv")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["log.csv", "log.toml"]
    with pytest.raises(InputError, match="cannot be written"):
        export_csv(path, tmp_path / "absent" / "other.csv")
