"""The runs of a folder are exported as CSV with one row per run, or as a list of their results."""

import csv
import json
import shutil
from pathlib import Path

import pytest

from calstation.errors import ConfigurationError, InputError
from calstation.records import LogMeta, RawLogWriter, RunFilter, partial_path
from calstation.results import History, export_runs, load_result
from tests.check_rows import check_row
from tests.helpers import Progress, write_log_of
from tests.records.records_samples import META, make_block
from tests.results.test_history import write


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder of two runs with three parameters, and a third run without a result."""
    made = tmp_path / "runs"
    made.mkdir()
    check = check_row("within", "gyro_bias_x", 0.3, [-0.2, 0.2], passed=False, unit="rad/s")
    write(made, "a", "SN-1", "failed", 1, values={"gyro_bias_y": 5.0, "gyro_bias_x": 0.1 + 0.2}, checks=[check])
    flags = {"partial": True, "simulated": True}
    write(made, "b", "SN=2, x", "passed", 2, values={"accel_bias_z": 1e-9}, **flags, batch="B-7", slot="A1")
    run = {"stages": ["rate"], "software": "0.1", "started_utc": "2026-11-03T08:00:00+00:00"}
    writer = RawLogWriter(tmp_path / "x.h5", LogMeta.model_validate({**META, "run": run}))
    writer.append(make_block("rate", 0, 10))
    writer.flush()
    shutil.copyfile(tmp_path / "x.h5", made / "c.h5")
    writer.close("stopped")
    History(made).refresh()
    return made


def test_parquet_has_the_rows_of_the_csv(folder: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    write(folder, "d", "0042", "passed", 3, values={"gyro_bias_x": 0.25})
    History(folder).refresh()
    rows = parquet.read_table(export_runs(Progress(), folder, RunFilter(), tmp_path / "runs.parquet")).to_pylist()
    with export_runs(Progress(), folder, RunFilter(), tmp_path / "runs.csv").open(
        encoding="utf-8", newline=""
    ) as stream:
        expected = list(csv.DictReader(stream))
    assert [row["serial"] for row in rows] == [row["serial"] for row in expected]
    assert "0042" in [row["serial"] for row in rows]
    for row, text in zip(rows, expected, strict=True):
        value = text["gyro_bias_x [rad/s]"]
        assert row["gyro_bias_x [rad/s]"] == (float(value) if value else None)


def test_parquet_has_texts_as_they_are(folder: Path, tmp_path: Path) -> None:
    """Unlike a cell of a CSV file, no spreadsheet takes them for formulas."""
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    write(folder, "d", "=SN-1", "passed", 4, operator='-x, "q"\n2')
    History(folder).refresh()
    target = export_runs(Progress(), folder, RunFilter(), tmp_path / "o'neil's runs.parquet")
    row = next(row for row in parquet.read_table(target).to_pylist() if row["serial"] == "=SN-1")
    assert (row["operator"], row["attempt"], row["batch"]) == ('-x, "q"\n2', 1, None)


def test_altered_run_is_exported_from_its_log_or_left_out(folder: Path, tmp_path: Path) -> None:
    for name, day in (("d", 4), ("e", 5)):
        write_log_of(write(folder, name, f"SN-{name}", "failed", day))
        History(folder).refresh()
        write(folder, name, f"SN-{name}", "passed", day)
    (folder / "e.h5").unlink()
    History(folder).refresh()
    assert [run.badge for run in History(folder).runs()][:2] == ["altered", "altered"]
    exported = json.loads(export_runs(Progress(), folder, RunFilter(), tmp_path / "runs.json").read_bytes())
    assert [(each["unit"]["serial"], each["outcome"]) for each in exported] == [
        *(("SN-d", "failed"), ("SN=2, x", "passed"), ("SN-1", "failed")),
    ]


def test_csv_row_has_the_values_and_sigmas_of_its_run(folder: Path, tmp_path: Path) -> None:
    progress = Progress()
    target = export_runs(progress, folder, RunFilter(), tmp_path / "runs.csv")
    with target.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["verdict"] for row in rows] == ["incomplete", "partial", "failed"]
    incomplete, partial, failed = rows
    assert list(failed)[-6:] == [
        *("gyro_bias_x [rad/s]", "gyro_bias_x_sigma [rad/s]", "gyro_bias_y [rad/s]", "gyro_bias_y_sigma [rad/s]"),
        *("accel_bias_z [m/s²]", "accel_bias_z_sigma [m/s²]"),
    ]
    assert float(failed["gyro_bias_x [rad/s]"]) == 0.1 + 0.2
    assert failed["failed_checks"] == "gyro_bias_x within"
    assert (failed["serial"], failed["started_utc"]) == ("SN-1", "2026-11-01T08:00:00+00:00")
    assert (failed["product"], failed["station"], failed["operator"]) == ("Navigation grade A", "bench 1", "li")
    assert (failed["batch"], failed["slot"], partial["batch"], partial["slot"]) == ("", "", "B-7", "A1")
    flags = ("partial", "simulated", "released", "result_changed", "log_missing")
    assert ["".join(row[name] for name in flags) for row in (partial, failed)] == ["11001", "00001"]
    assert (partial["serial"], partial["accel_bias_z_sigma [m/s²]"], partial["gyro_bias_x [rad/s]"]) == (
        "SN=2, x",
        "1.0",
        "",
    )
    assert set(list(incomplete.values())[-6:]) == {""}
    assert progress.fractions == sorted(progress.fractions)


def test_results_are_exported_as_a_list(folder: Path, tmp_path: Path) -> None:
    target = export_runs(Progress(), folder, RunFilter(), tmp_path / "runs.json")
    expected = [load_result(folder / f"{name}.json").to_json() for name in ("b", "a")]
    assert json.loads(target.read_text("utf-8")) == expected
    export_runs(Progress(), folder, RunFilter(search="nothing"), target)
    assert json.loads(target.read_text("utf-8")) == []


def test_only_runs_that_meet_the_conditions_are_exported(folder: Path, tmp_path: Path) -> None:
    for wanted in (RunFilter(verdict="failed"), RunFilter(names=("a",)), RunFilter(before="2026-11-02T00:00:00")):
        target = export_runs(Progress(), folder, wanted, tmp_path / "runs.json")
        assert [each["unit"]["serial"] for each in json.loads(target.read_text("utf-8"))] == ["SN-1"]


def test_a_failed_export_leaves_no_file(folder: Path, tmp_path: Path) -> None:
    (folder / "a.json").write_text("{", "utf-8")
    target = tmp_path / "runs.json"
    with pytest.raises(InputError, match=r"a\.json: The file is not JSON"):
        export_runs(Progress(), folder, RunFilter(), target)
    assert not target.exists()
    assert not partial_path(target).exists()
    with pytest.raises(ConfigurationError, match="cannot be written"):
        export_runs(Progress(), folder, RunFilter(), tmp_path / "missing" / "runs.csv")
