"""CSV files as people have them: encodings, line ends, headers, clocks, damaged and repeated rows."""

from pathlib import Path

import numpy as np
import pytest
from records_samples import joined

from calstation.errors import InputError
from calstation.records import Log, open_log
from tests.helpers import raises_code

NAMES = ("gx", "gy", "gz", "ax", "ay", "az")
UNITS = ("deg/s", "deg/s", "deg/s", "g", "g", "g")
COLUMNS = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
TIME = 'time_s = { from = "t" }\n'
COUNT = 300


def cells(seed: int = 0) -> list[str]:
    """Return the cells of the sensors of 300 samples at 50 Hz."""
    values = np.random.default_rng(seed).normal([0, 0, 0, 0, 0, 1], 0.02, (COUNT, 6))
    return [",".join(f"{v:.5f}" for v in row) for row in values]


def opened(folder: Path, text: str | bytes, columns: str | None = None) -> Log:
    """Open the text of a recording; without `columns` the columns have the names `NAMES`."""
    path = folder / "rec.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    mapped = zip(COLUMNS, NAMES, UNITS, strict=True)
    entries = "".join(f'{name} = {{ from = "{cell}", unit = "{unit}" }}\n' for name, cell, unit in mapped)
    path.with_suffix(".toml").write_text(
        "[site]\nlatitude_deg = 34.25\nlongitude_deg = 108.9\nheight_m = 400.0\n"
        '[imu]\nserial = "H7"\nsample_rate_hz = 50.0\ngyro_arw = 4.4e-5\naccel_vrw = 5.9e-4\n'
        f"[columns]\n{entries + TIME if columns is None else columns}"
    )
    return open_log(path)


def timed(times: list[str], header: str = "t", rows: list[str] | None = None) -> str:
    lines = [f"{time},{row}" for time, row in zip(times, rows or cells(), strict=True)]
    return "\n".join([f"{header},{','.join(NAMES)}", *lines]) + "\n"


def seconds(start: float = 0.0) -> np.ndarray:
    return start + 0.02 * np.arange(1, COUNT + 1)


def plain() -> str:
    return timed([f"{t:.2f}" for t in seconds()])


def read(log: Log) -> dict[str, np.ndarray]:
    return joined(list(log.blocks()))


@pytest.mark.parametrize(
    "changed",
    [
        lambda text: text.replace("\n", "\r").encode(),
        lambda text: text.replace("\n", "\r\n").encode("utf-16"),
        lambda text: text.encode("utf-16-le"),
        lambda text: text.encode("utf-16-be"),
        lambda text: text.encode("utf-8-sig"),
        lambda text: text.replace(".", ";").replace(",", "\t").replace(";", ",").encode(),
        lambda text: ("# logger 3\n" + text.replace("\n", ",\n")).encode(),
        lambda text: text.replace("\n1.", "\n\n# pause\n1.", 1).encode(),
    ],
    ids=["CR", "UTF-16", "UTF-16-LE", "UTF-16-BE", "mark", "tabs and commas", "trailing commas", "blank lines"],
)
def test_encodings_line_ends_and_comments_do_not_change_the_samples(tmp_path: Path, changed) -> None:
    expected = read(opened(tmp_path, plain()))
    log = opened(tmp_path, changed(plain()))
    for name, column in read(log).items():
        np.testing.assert_array_equal(column, expected[name])
    assert not log.damaged_rows


@pytest.mark.parametrize("form", ["{} [{}]", "{}({})", "{}_[{}]"])
def test_units_are_read_from_the_header(tmp_path: Path, form: str) -> None:
    expected = read(opened(tmp_path, plain()))
    spelled = dict(zip(NAMES, ("°/s", "dps", "deg/sec", "g", "G", "gn"), strict=True))
    header = ",".join([form.format("t", "ms"), *(form.format(n, u) for n, u in spelled.items())])
    times = [f"{1e3 * t:.0f}" for t in seconds()]
    text = timed(times).split("\n", 1)[1]
    mapped = "".join(f'{name} = {{ from = "{cell}" }}\n' for name, cell in zip(COLUMNS, NAMES, strict=True)) + TIME
    np.testing.assert_array_equal(read(opened(tmp_path, f"{header}\n{text}", mapped))["counts"], expected["counts"])
    names = ",".join([form.format("time_s", "ms"), *(form.format(n, u) for n, u in zip(COLUMNS, UNITS, strict=True))])
    found = read(opened(tmp_path, f"{names}\n{text}", ""))
    np.testing.assert_array_equal(found["counts"], expected["counts"])
    np.testing.assert_allclose(found["time"], seconds(), rtol=1e-12)
    with raises_code(InputError, "csv.header_unit"):
        opened(tmp_path, f"{names.replace('deg/s', 'furlong')}\n{text}", "")


@pytest.mark.parametrize("counter", [False, True])
def test_samples_without_time_are_counted(tmp_path: Path, counter: bool) -> None:
    kept = [k for k in range(COUNT) if k != 200]
    rows = [f"{k % 256},{row}" if counter else row for k, row in enumerate(cells())]
    rows = [rows[k] for k in kept] if counter else [*rows[:200], "1,2", *rows[201:]]
    header = ",".join((*["n"] * counter, *NAMES))
    mapped = "".join(f'{n} = {{ from = "{c}", unit = "{u}" }}\n' for n, c, u in zip(COLUMNS, NAMES, UNITS, strict=True))
    log = opened(tmp_path, "\n".join([header, *rows]), mapped + 'seq = { from = "n" }\n' * counter)
    found = read(log)
    np.testing.assert_array_equal(found["seq"], kept)
    np.testing.assert_allclose(found["time"], 0.02 * (np.array(kept) + 1))
    assert log.times.counted
    assert log.facts().damaged == (0 if counter else 1)


def test_time_column_that_is_not_mapped_is_named(tmp_path: Path) -> None:
    mapped = "".join(f'{name} = {{ from = "{cell}" }}\n' for name, cell in zip(COLUMNS, NAMES, strict=True))
    with raises_code(InputError, "csv.column_misspelt") as caught:
        opened(tmp_path, plain(), mapped)
    assert caught.value.values["near"] == "t"


@pytest.mark.parametrize(
    ("start", "unit", "modulus"),
    [(4294964296, "us", 2**32), (4294964296, "ms", 2**32), (604797.0, "s", 604800), (86397.0, "s", 86400)],
)
def test_wrap_of_the_clock_is_no_interruption(tmp_path: Path, start: float, unit: str, modulus: int) -> None:
    size = {"us": 1e-6, "ms": 1e-3, "s": 1.0}[unit]
    start = start if unit == "s" else modulus - 3.0 / size
    raw = [(start + t / size) % modulus for t in seconds()]
    times = [f"{t:.2f}" if unit == "s" else f"{t:.0f}" for t in raw]
    entry = "".join(f'{n} = {{ from = "{c}", unit = "{u}" }}\n' for n, c, u in zip(COLUMNS, NAMES, UNITS, strict=True))
    log = opened(tmp_path, timed(times), f'{entry}time_s = {{ from = "t", unit = "{unit}" }}\n')
    found = read(log)
    np.testing.assert_array_equal(found["seq"], np.arange(COUNT))
    np.testing.assert_allclose(np.diff(found["time"]), 0.02, atol=1e-8)
    assert (log.times.wraps, log.times.steps_back) == (1, 0)


@pytest.mark.parametrize("counter", [False, True])
@pytest.mark.parametrize("step", [-0.5, -3600.0])
def test_clock_that_is_set_back_is_counted(tmp_path: Path, counter: bool, step: float) -> None:
    times = [f"{t + (step if k >= 150 else 0.0):.2f}" for k, t in enumerate(seconds(1.7e9))]
    rows = [f"{k},{row}" if counter else row for k, row in enumerate(cells())]
    text = timed(times, rows=rows)
    text = text.replace("t,gx", "t,n,gx") if counter else text
    columns = "".join(
        f'{n} = {{ from = "{c}", unit = "{u}" }}\n' for n, c, u in zip(COLUMNS, NAMES, UNITS, strict=True)
    )
    log = opened(tmp_path, text, columns + TIME + 'seq = { from = "n" }\n' * counter)
    found = read(log)
    gap = 0 if counter else 1
    np.testing.assert_array_equal(found["seq"], np.arange(COUNT) + gap * (np.arange(COUNT) >= 150))
    np.testing.assert_allclose(np.diff(found["time"])[149], 0.02 * (1 + gap), atol=1e-6)
    assert (log.times.steps_back, log.times.jumps, log.times.wraps) == (1, 0, 0)
    assert log.facts().gaps == gap


def test_rows_out_of_order_are_refused(tmp_path: Path) -> None:
    lines = plain().split("\n")
    lines[100], lines[101] = lines[101], lines[100]
    with raises_code(InputError, "csv.sequence") as caught:
        read(opened(tmp_path, "\n".join(lines)))
    assert caught.value.values["line"] == 102
    assert "falls from 2.02 to 2 s and returns" in str(caught.value)


@pytest.mark.parametrize("form", ["iso", "blank", "hms"])
def test_time_of_day_is_read(tmp_path: Path, form: str) -> None:
    def text(t: float) -> str:
        clock = f"{(23 + int(t // 60) // 60) % 24:02d}:{int(t // 60) % 60:02d}:{t % 60.0:06.3f}"
        day = 27 + (t >= 3600.0)
        return {"iso": f"2024-10-{day}T{clock}Z", "blank": f"2024-10-{day} {clock}", "hms": clock}[form]

    log = opened(tmp_path, timed([text(t) for t in seconds(3597.0)]))
    found = read(log)
    np.testing.assert_allclose(np.diff(found["time"]), 0.02, atol=1e-6)
    np.testing.assert_array_equal(found["seq"], np.arange(COUNT))
    assert log.times.wraps == (form == "hms")
    with raises_code(InputError, "csv.cell_not_time"):
        read(opened(tmp_path, timed([f"27/10/24 {text(t)}" for t in seconds()])))


def test_damaged_rows_of_a_killed_and_restarted_logger_are_lost(tmp_path: Path) -> None:
    lines = plain().split("\n")
    lines[50] = lines[50].replace(",", ",nan,", 1).rsplit(",", 1)[0]
    lines[120] = lines[0]
    text = "\n".join(lines).rstrip("\n")[:-50]
    log = opened(tmp_path, text)
    found = read(log)
    assert (log.facts().samples, log.facts().gaps, log.facts().damaged) == (COUNT - 3, 2, 2)
    assert [part.missing for part in log.damaged_rows] == ["49…49", "299…"]
    assert found["seq"][-1] == COUNT - 2


def test_repeated_rows_without_counter_are_left_out(tmp_path: Path) -> None:
    lines = plain().split("\n")
    for k in range(COUNT - 20, 0, -50):
        lines.insert(k, lines[k])
    log = opened(tmp_path, "\n".join(lines))
    np.testing.assert_allclose(np.diff(read(log)["time"]), 0.02, atol=1e-9)
    assert log.times.repeated == 6
    assert [text.code for text in log.times.irregularities] == ["recording.time_repeated"]
    with raises_code(InputError, "csv.repeated"):
        read(opened(tmp_path, plain() + plain().split("\n", 1)[1]))


def test_coarse_time_stamps_are_no_repetition(tmp_path: Path) -> None:
    log = opened(tmp_path, timed([f"{t:.1f}" for t in np.ceil(seconds() * 5) / 5]))
    assert len(read(log)["seq"]) == COUNT
    assert log.times.repeated == 0
    assert log.times.jitter > 0.01


def test_means_of_positions_are_refused(tmp_path: Path) -> None:
    directions = np.random.default_rng(1).normal(size=(24, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    rows = [f"0,0,0,{x:.5f},{y:.5f},{z:.5f}" for x, y, z in directions]
    text = "\n".join([f"t,{','.join(NAMES)}", *(f"{k},{row}" for k, row in enumerate(rows))])
    with raises_code(InputError, "csv.means"):
        read(opened(tmp_path, text))
