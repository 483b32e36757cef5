"""CSV files of other programs: columns, units, separators, header lines, and arrival times."""

import gzip
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from records_samples import joined

from calstation.errors import InputError
from calstation.records import export_csv, open_log
from calstation.records.arrival import TIMES, sample_times
from calstation.records.columns import min_step
from calstation.records.temporary_rows import TemporaryRows
from tests.helpers import convert_log, raises_code

G = 9.80665
SITE = "[site]\nlatitude_deg = 48.0\nlongitude_deg = 11.0\nheight_m = 500.0\n"
IMU = '[imu]\nserial = "F1"\nsample_rate_hz = 100.0\ngyro_arw = 1e-4\naccel_vrw = 1e-3\n'
COLUMNS = {
    "time_s": '{ from = "t [ms]", unit = "ms" }',
    **{f"gyro_{a}": f'{{ from = "Gyr{a.upper()}", unit = "deg/s" }}' for a in "xyz"},
    **{f"accel_{a}": f'{{ from = "Acc{a.upper()}", unit = "mg" }}' for a in "xyz"},
}
NAMES = ["t [ms]", "AccX", "AccY", "AccZ", "GyrX", "GyrY", "GyrZ", "note"]


def foreign(
    folder: Path, text: str, columns: dict[str, str] | None = None, imu: str = IMU, name: str = "a.csv"
) -> Path:
    """Write a file of another program with its TOML file."""
    path = folder / name
    path.write_text(text, encoding="utf-8")
    entries = "".join(f"{key} = {value}\n" for key, value in (COLUMNS if columns is None else columns).items())
    (folder / "a.toml").write_text(f"{SITE}{imu}[columns]\n{entries}", encoding="utf-8")
    return path


def sample_rows(count: int = 300) -> np.ndarray:
    """Return rows with time in ms, accelerometers in mg and gyros in °/s."""
    random = np.random.default_rng(1)
    values = np.round(random.normal(0.0, 100.0, (count, 6)), 2)
    return np.column_stack([1e6 + 10.0 * np.arange(count), values])


def text_of(rows: np.ndarray, separator: str = ",", mark: str = ".", names: list[str] = NAMES) -> str:
    lines = [separator.join([*(f"{v:.2f}".replace(".", mark) for v in row), "x"]) for row in rows]
    return "\n".join([separator.join(names), *lines]) + "\n"


def rates_and_forces(path: Path) -> np.ndarray:
    log = open_log(path)
    columns = joined(list(log.blocks()))
    return np.asarray(columns["counts"] * np.repeat([log.meta.imu.gyro_lsb, log.meta.imu.accel_lsb], 3))


@pytest.mark.parametrize(
    ("separator", "mark"), [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), (" ", "."), ("   ", ",")]
)
def test_separators_decimal_marks_units_and_leading_lines_are_configurable(
    tmp_path: Path, separator: str, mark: str
) -> None:
    rows = sample_rows()
    names = [n.replace(" ", "") for n in NAMES] if separator.isspace() else NAMES
    columns = {**COLUMNS, "time_s": f'{{ from = "{names[0]}", unit = "ms" }}'}
    text = "# Logger 7; firmware 2,1\nrecorded by GyrX inc.\n\n" + text_of(rows, separator, mark, names)
    path = foreign(tmp_path, text, columns)
    found = joined(list(open_log(path).blocks()))
    expected = np.hstack([np.deg2rad(rows[:, 4:]), rows[:, 1:4] * 1e-3 * G])
    np.testing.assert_allclose(rates_and_forces(path), expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(found["time"], rows[:, 0] / 1000.0, rtol=1e-12)
    np.testing.assert_array_equal(found["seq"], np.arange(300))
    assert set(found["stage"]) == {""}
    assert set(found["step"]) == {0}


@pytest.mark.parametrize(
    ("sensor", "unit", "factor"),
    [
        *[("gyro", u, f) for u, f in (("rad/s", 1.0), ("mrad/s", 1e-3), ("dps", np.pi / 180), ("°/s", np.pi / 180))],
        *[("gyro", u, f * np.pi / 180) for u, f in (("mdeg/s", 1e-3), ("deg/h", 1 / 3600), ("°/h", 1 / 3600))],
        *[("accel", u, f) for u, f in (("m/s2", 1.0), ("m/s^2", 1.0), ("m/s²", 1.0), ("g", G), ("ug", G * 1e-6))],
    ],
)
@pytest.mark.parametrize("output", ["rate", "increment"])
def test_values_with_units_become_counts_of_the_configured_size(
    tmp_path: Path, sensor: str, unit: str, factor: float, output: str
) -> None:
    imu = f'{IMU}output = "{output}"\ngyro_lsb = 1e-5\naccel_lsb = 1e-4\n'
    columns = COLUMNS | {f"{sensor}_y": f'{{ from = "{sensor[:3].title()}Y", unit = "{unit}" }}'}
    columns["accel_z"] = '{ from = "AccZ", unit = "counts" }'
    rows = sample_rows(20)
    counts = joined(list(open_log(foreign(tmp_path, text_of(rows), columns, imu)).blocks()))["counts"]
    per_sample = 0.01 if output == "increment" else 1.0
    column, place, size = (5, 1, 1e-5) if sensor == "gyro" else (2, 4, 1e-4)
    np.testing.assert_allclose(counts[:, place], rows[:, column] * factor * per_sample / size, rtol=1e-12)
    np.testing.assert_array_equal(counts[:, 5], rows[:, 3])


def test_increments_may_be_in_angle_units(tmp_path: Path) -> None:
    columns = COLUMNS | {f"gyro_{a}": f'{{ from = "Gyr{a.upper()}", unit = "arcsec" }}' for a in "xyz"}
    columns |= {f"accel_{a}": f'{{ from = "Acc{a.upper()}", unit = "m/s" }}' for a in "xyz"}
    path = foreign(tmp_path, text_of(sample_rows(20)), columns)
    log = open_log(path)
    assert log.meta.imu.output == "increment"
    expected = np.deg2rad(sample_rows(20)[:, 4:] / 3600.0)
    np.testing.assert_allclose(rates_and_forces(path)[:, :3], expected, rtol=1e-12)


def test_count_size_defaults_to_the_smallest_step(tmp_path: Path) -> None:
    imu = open_log(foreign(tmp_path, text_of(sample_rows()))).meta.imu
    assert imu.output == "rate"
    assert imu.gyro_lsb == pytest.approx(np.deg2rad(0.01), rel=1e-5)
    assert imu.accel_lsb == pytest.approx(1e-5 * G, rel=1e-5)


def test_a_file_without_a_header_row_is_read_by_column_numbers(tmp_path: Path) -> None:
    rows = sample_rows(50)
    text = "% t ax ay az gx gy gz\n" + "\n".join("   " + "   ".join(f"{v:.7e}" for v in row) for row in rows) + "\n"
    names = ["time_s", *(f"accel_{a}" for a in "xyz"), *(f"gyro_{a}" for a in "xyz")]
    columns = {n: f"{{ from = {k} }}" for k, n in enumerate(names, 1)} | {"time_s": '{ from = 1, unit = "ms" }'}
    imu = f'{IMU}output = "rate"\ngyro_lsb = 1.0\naccel_lsb = 1.0\n'
    found = rates_and_forces(foreign(tmp_path, text, columns, imu, "a.txt"))
    np.testing.assert_allclose(found, rows[:, [4, 5, 6, 1, 2, 3]], rtol=1e-7)


def test_a_row_of_units_after_the_header_is_skipped(tmp_path: Path) -> None:
    header, _, rest = text_of(sample_rows(20)).partition("\n")
    columns = {name: re.sub(", unit.*?}", " }", entry) for name, entry in COLUMNS.items()}
    path = foreign(tmp_path, f"{header}\n[ms],[mg],[mg],[mg],[°/s],[°/s],[°/s],\n{rest}", columns)
    assert open_log(path).facts().samples == 20
    expected = np.hstack([np.deg2rad(sample_rows(20)[:, 4:]), sample_rows(20)[:, 1:4] * 1e-3 * G])
    np.testing.assert_allclose(rates_and_forces(path), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "code", "message"),
    [
        ({"gyro_x": '{ from = "gyrx" }'}, "csv.no_such_column", "columns.gyro_x is read. Did you mean 'GyrX'?"),
        ({"gyro_x": "{ from = 12 }"}, "csv.no_such_column", "There is no column '12'"),
        ({"gyro_x": '{ from = "GyrX", unit = "deg/sec" }'}, "entry.in_file", "unit 'deg/sec' is unknown. Did you mean"),
        ({"gyro_x": '{ from = "GyrX", unit = "furlong" }'}, "entry.in_file", "Choose from: rad/s, mrad/s"),
        ({"gyr_x": '{ from = "GyrX" }'}, "entry.in_file", "columns.gyr_x: 'gyr_x' is unknown. Did you mean 'gyro_x'?"),
        (
            {"step": '{ from = "note", unit = "s" }'},
            "entry.in_file",
            "columns.step.unit: The unit 's' is unknown.",
        ),
        ({"step": '{ value = "3" }'}, "entry.in_file", "step needs one entry: from"),
        ({"time_s": '{ form = "t [ms]" }'}, "entry.in_file", "columns.time_s.form: The entry is unknown."),
    ],
)
def test_invalid_column_map_is_reported_in_one_sentence(
    tmp_path: Path, change: dict[str, str], code: str, message: str
) -> None:
    with pytest.raises(InputError) as caught:
        open_log(foreign(tmp_path, text_of(sample_rows(20)), COLUMNS | change))
    assert caught.value.code.startswith(code)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_stage_can_be_configured_for_the_whole_recording(tmp_path: Path) -> None:
    path = foreign(tmp_path, text_of(sample_rows()), COLUMNS | {"stage": '{ value = "six_position" }'})
    facts = convert_log(path, tmp_path / "a.h5")
    assert facts.sha256 == open_log(path).facts().sha256
    assert {b.stage for b in open_log(tmp_path / "a.h5").blocks()} == {"six_position"}
    export_csv(tmp_path / "a.h5", tmp_path / "b.csv")
    assert convert_log(tmp_path / "b.csv", tmp_path / "b.h5").sha256 == facts.sha256


def test_recording_without_gyros_keeps_its_values(tmp_path: Path) -> None:
    columns = {name: entry for name, entry in COLUMNS.items() if not name.startswith("gyro")}
    imu = IMU.replace("gyro_arw = 1e-4\n", "")
    path = foreign(tmp_path, text_of(sample_rows()), columns, imu)
    convert_log(path, tmp_path / "a.h5")
    log = open_log(tmp_path / "a.h5")
    counts = joined(list(log.blocks()))["counts"]
    assert np.isnan(counts[:, :3]).all()
    np.testing.assert_allclose(counts[:, 3:] * log.meta.imu.accel_lsb, sample_rows()[:, 1:4] * 1e-3 * G, rtol=1e-12)
    export_csv(tmp_path / "a.h5", tmp_path / "b.csv")
    assert "gyro" not in (tmp_path / "b.csv").read_text()
    assert convert_log(tmp_path / "b.csv", tmp_path / "b.h5").sha256 == log.facts().sha256


# Times of arrival ------------------------------------------------------------------------------------------------


def clock(count: int, rate: float, lost: dict[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return counter and clock, s, of samples with losses before some rows."""
    steps = np.ones(count, np.int64)
    for row, missing in lost.items():
        steps[row] += missing
    seq = np.cumsum(steps) - 1
    return seq, 5.0 + seq / rate


def in_bursts(time: np.ndarray, seconds: float) -> np.ndarray:
    """Return the arrival times of samples that are forwarded in bursts."""
    return np.asarray(np.ceil(time / seconds) * seconds)


def delayed(time: np.ndarray, seconds: float) -> np.ndarray:
    random = np.random.default_rng(2)
    return np.asarray(np.maximum.accumulate(time + random.exponential(seconds, len(time))))


def derived(time: np.ndarray, nominal: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Return counter, clock and jitter that are derived from times."""
    with TemporaryRows(TIMES) as times:
        rows = np.zeros(len(time), TIMES)
        rows["time"], rows["row"] = time, np.arange(len(time))
        times.append(rows)
        found = sample_times(times, nominal)
    with found.clock as clock:
        rows = clock.read(0, len(clock))
    return rows["seq"], rows["time"], found.jitter


@pytest.mark.parametrize("part", [100, 2**16])
@pytest.mark.parametrize(
    "late",
    [lambda t: in_bursts(t, 0.05), lambda t: delayed(t, 0.004), lambda t: delayed(t, 0.02)],
    ids=["bursts", "late", "very late"],
)
@pytest.mark.parametrize("lost", [{}, {1500: 20, 2400: 300}], ids=["whole", "gaps"])
def test_jitter_changes_neither_the_rate_nor_the_gaps(
    late: Callable[[np.ndarray], np.ndarray], lost: dict[int, int], part: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(TemporaryRows, "part_rows", part)
    seq, time = clock(4000, 200.0 * (1.0 + 3e-4), lost)
    arrived = late(time)
    counted, fitted, jitter = derived(arrived, 1.0 / 200.0)
    assert np.abs(counted - seq)[[0, 1000, 2000, -1]].max() <= 3, "how many are lost is known to a few samples"
    assert np.count_nonzero(np.diff(counted) != 1) == len(lost)
    assert jitter == pytest.approx(np.std(arrived - time), rel=0.2)
    rate = 1.0 / np.polyfit(counted, fitted, 1)[0]
    assert rate == pytest.approx(200.0 * (1.0 + 3e-4), rel=2e-3 if lost else 2e-4)


def test_sample_clock_is_kept_unchanged_and_its_gaps_are_counted() -> None:
    seq, time = clock(3000, 204.8 * (1.0 - 2e-3), {10: 1, 11: 1, 700: 40})
    counted, kept, jitter = derived(time, 1.0 / 204.8)
    np.testing.assert_array_equal(counted, seq)
    np.testing.assert_array_equal(kept, time)
    assert jitter == 0.0


def csv_of(folder: Path, seq: np.ndarray | None, time: np.ndarray, rate: float) -> Path:
    cells = [f"{t:.6f},1,-2,3,4,5,98" for t in time]
    if seq is not None:
        cells = [f"{s},{cell}" for s, cell in zip(seq.tolist(), cells, strict=True)]
    header = "time_s,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z"
    imu = IMU.replace("100.0", str(rate)) + 'output = "rate"\ngyro_lsb = 1e-5\naccel_lsb = 0.1\n'
    return foreign(folder, "\n".join([header if seq is None else f"seq,{header}", *cells]) + "\n", {}, imu)


@pytest.mark.parametrize("counted", [True, False])
def test_arrival_times_are_read_with_and_without_a_counter(tmp_path: Path, counted: bool) -> None:
    seq, time = clock(9000, 200.0, {4981: 20})
    log = open_log(csv_of(tmp_path, seq % 256 if counted else None, in_bursts(time, 0.1), 200.0))
    found = joined(list(log.blocks()))
    np.testing.assert_array_equal(found["seq"], seq)
    np.testing.assert_allclose(np.diff(found["time"]), np.diff(seq) / 200.0, rtol=1e-4)
    assert log.times.jitter == pytest.approx(0.1 / np.sqrt(12.0), rel=0.05)
    assert log.facts().gaps == 1


def test_times_that_contradict_the_sample_rate_are_refused(tmp_path: Path) -> None:
    for counted in (True, False):
        seq, time = clock(1000, 100.0, {})
        with raises_code(InputError, "csv.wrong_rate") as caught:
            list(open_log(csv_of(tmp_path, seq if counted else None, in_bursts(time, 0.05), 200.0)).blocks())
        assert caught.value.values["found"] == pytest.approx(100.0, rel=0.01)


def test_compressed_text_file_is_read_with_its_toml(tmp_path: Path) -> None:
    path = foreign(tmp_path, text_of(sample_rows(20), "\t"), name="a.tsv")
    (tmp_path / "a.tsv.gz").write_bytes(gzip.compress(path.read_bytes()))
    assert open_log(tmp_path / "a.tsv.gz").facts().samples == 20


def test_size_of_a_count_lets_the_largest_value_be_counted() -> None:
    """Otherwise, a log is written whose counts are refused when it is read."""
    assert min_step([np.array([0.0, 1e-300, np.nan, np.inf]), np.array([9.8, -9.8])]) == 9.8 * 2.0**-53
    assert min_step([np.array([0.25, 0.5, 9.75])]) == 0.25
    assert min_step([np.full(3, 9.8)]) == 0.0
