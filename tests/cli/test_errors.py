"""Every user error gives the documented exit code and one clear message, never a traceback."""

import os
import re
import stat
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from calstation import __version__
from calstation.cli.app import run_app
from calstation.config import this_computer
from calstation.config.library import shipped_folder
from tests.cli.conftest import HEADER, META, Done, six_position_rows, write_log

Run = Callable[..., Done]
NO_SERIAL = "# [imu.serial] # only where this line is not set as the IMU's profile says\n"
#: Of the example: the line that stands in place of a section, and the section's head.
OWN_SERIAL = "[imu.serial]\n"


def check(done: Done, code: int, *words: str) -> None:
    """Assert the exit code and one or two lines of error output that contain these words."""
    assert done.code == code, done.err
    output = [line for line in done.err.splitlines() if line.startswith("calstation: ")]
    assert len(output) == 1, done.err
    assert "Traceback" not in done.err
    for word in words:
        assert word in done.err
    assert done.out == ""


# ---- logs


def test_missing_log_is_reported(calstation: Run, tmp_path: Path) -> None:
    check(calstation("resolve", tmp_path / "none.csv"), 2, "none.csv", "No such file")


def test_csv_log_without_its_toml_is_reported(calstation: Run, tmp_path: Path) -> None:
    log = write_log(tmp_path, six_position_rows())
    log.with_suffix(".toml").unlink()
    check(calstation("resolve", log), 2, "log.toml")


def test_missing_column_is_reported(calstation: Run, tmp_path: Path) -> None:
    rows = [re.sub(r",[^,]*$", "", row) for row in six_position_rows()]
    header = HEADER.removesuffix(",step")
    check(calstation("resolve", write_log(tmp_path, rows, header)), 2, "log.csv", "column 'step'")


def test_nan_in_a_cell_is_reported(calstation: Run, tmp_path: Path) -> None:
    rows = six_position_rows()
    cells = [row.split(",") for row in rows]
    rows[10:] = [",".join([*row[:4], "nan", *row[5:]]) for row in cells[10:]]  # a few would be left out
    check(calstation("resolve", write_log(tmp_path, rows)), 2, "line 12", "NaN")


def test_too_short_log_is_reported(calstation: Run, tmp_path: Path) -> None:
    log = write_log(tmp_path, six_position_rows()[:150])
    check(calstation("resolve", log), 2, "log.csv", "Stage Six positions:")


def test_repeated_rows_are_reported(calstation: Run, tmp_path: Path) -> None:
    rows = six_position_rows()
    check(calstation("resolve", write_log(tmp_path, [*rows[:50], *rows[40:]])), 2, "line 52")


def test_reordered_rows_are_reported(calstation: Run, tmp_path: Path) -> None:
    rows = six_position_rows()
    rows[20], rows[21] = rows[21], rows[20]
    check(calstation("resolve", write_log(tmp_path, rows)), 2, "line 2")


def test_latitude_out_of_range_is_reported(calstation: Run, tmp_path: Path) -> None:
    meta = META.replace("34.25", "134.25")
    log = write_log(tmp_path, six_position_rows(), meta=meta)
    check(calstation("resolve", log), 2, "log.toml", "site.latitude_deg")


def test_unknown_stage_is_reported(calstation: Run, tmp_path: Path) -> None:
    log = write_log(tmp_path, six_position_rows())
    check(calstation("resolve", log, "--stages", "six_positions"), 2, "'six_positions'", "Choose from")
    check(calstation("run", "--stages", "six_positions"), 2, "'six_positions'", "Choose from")


def test_stage_that_is_not_in_the_log_is_reported(calstation: Run, tmp_path: Path) -> None:
    log = write_log(tmp_path, six_position_rows())
    check(
        calstation("resolve", log, "--stages", "rate"),
        2,
        "stage Rate, but Six positions",
        "--stages six_position",
    )


def test_empty_or_repeated_stages_are_reported(calstation: Run, tmp_path: Path) -> None:
    log = write_log(tmp_path, six_position_rows())
    check(calstation("resolve", log, "--stages", ","), 2, "--stages")
    check(calstation("resolve", log, "--stages", "rate,rate"), 2, "twice")


def test_range_outside_the_log_is_reported(calstation: Run, tmp_path: Path) -> None:
    log = write_log(tmp_path, six_position_rows())
    check(calstation("resolve", log, "--from", 10**6), 2, "The log contains")
    check(calstation("resolve", log, "--from", 20, "--to", 10), 2, "--from")
    rows = len(six_position_rows())
    check(calstation("resolve", log, "--to", rows), 2, f"contains sequence numbers 0 to {rows - 1}, not {rows}.")
    check(calstation("resolve", log, "--from", -1), 2, f"contains sequence numbers 0 to {rows - 1}, not -1.")
    check(calstation("resolve", log, "--from", 0, "--to", 100), 2, "Stage Six positions:")


def test_file_that_is_not_a_log_is_reported(calstation: Run, tmp_path: Path) -> None:
    for name, content in (("a.h5", b"not hdf5"), ("a.txt", b""), ("a.csv.gz", b"no gzip")):
        path = tmp_path / name
        path.write_bytes(content)
        (tmp_path / "a.toml").write_text(META, encoding="utf-8")
        check(calstation("resolve", path), 2, name)


def test_import_to_an_unknown_file_extension_is_refused(calstation: Run, tmp_path: Path) -> None:
    log = write_log(tmp_path, six_position_rows())
    check(calstation("import", log, "-o", tmp_path / "log.dat"), 2, "log.dat")


# ---- options


@pytest.mark.parametrize(
    "arguments",
    [
        ["frobnicate"],
        ["resolve"],
        ["resolve", "a.csv", "--frobnicate"],
        ["resolve", "a.csv", "--from", "x"],
        ["run", "--speed", "fast"],
        ["run", "--seed", "1.5"],
        ["export", "a.h5"],
    ],
    ids=" ".join,
)
def test_wrong_usage_is_reported(calstation: Run, arguments: list[str]) -> None:
    check(calstation(*arguments), 2)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("resolve a.csv --from abc", "--from abc: must be a whole number. See calstation resolve --help."),
        ("resolve a.csv --to=1.5", "--to 1.5: must be a whole number"),
        ("run --seed x", "--seed x: must be a whole number. See calstation run --help."),
        ("run --speed fast", "--speed fast: must be a number"),
        ("run --speed", "Option '--speed' requires an argument. See calstation run --help."),
        ("soak --runs 0", "--runs 0: must be at least 1. See calstation soak --help."),
        ("export a.h5", "export needs -o FILE. See calstation export --help."),
        ("import a.csv", "import needs -o LOG. See "),
        ("registers finish", "registers finish needs SERIAL. See calstation registers finish --help."),
    ],
)
def test_wrong_usage_message_comes_from_the_catalogue(calstation: Run, line: str, said: str) -> None:
    check(calstation(*line.split()), 2, f"calstation: {said}")


def test_error_is_one_line_without_a_blank_line_before_it(calstation: Run, tmp_path: Path) -> None:
    assert calstation("resolve", tmp_path / "none.csv").err.startswith("calstation: ")


def test_invalid_toml_file_is_reported_with_a_remedy(calstation: Run, tmp_path: Path) -> None:
    (tmp_path / "README.md").write_text("no TOML", encoding="utf-8")
    check(calstation("run", "--station", tmp_path / "README.md"), 2, "or give a TOML file")


def test_version_is_shown(calstation: Run) -> None:
    done = calstation("--version")
    assert (done.code, done.out) == (0, f"calstation {__version__}\n")


# ---- stations, products, profiles


#: A change of the example station: its gravity was surveyed.
SURVEYED = ("height_m = 400.0", "height_m = 400.0\ngravity_mps2 = 9.79612")


def edited(tmp_path: Path, kind: str, name: str, *changes: tuple[str, str]) -> Path:
    """A copy of a shipped file with changes."""
    text = (shipped_folder() / kind / f"{name}.toml").read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    folder = tmp_path / "home" / kind
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A temporary site folder."""
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "home"))
    return tmp_path / "home"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("latitude_deg = 34.25", "latitude_deg = 91.0"), ("site.latitude_deg", "at most 90")),
        (("latitude_deg = 34.25\n", ""), ("site.latitude_deg", "missing")),
        (("latitude_deg", "lattitude_deg"), ("lattitude_deg",)),
        (("speed = 0.0", "speed = -1.0"), ("bench", "speed")),
        (('profile = "bench"', 'profile = "none"'), ("“none”", "Choose from: acutronic_acl")),
        (("[site]", "[site"), ("Not valid TOML",)),
        (("[bench]", "[unused]"), ("unused",)),
    ],
    ids=lambda v: v[0][:25],
)
def test_invalid_station_file_is_reported(
    calstation: Run, tmp_path: Path, change: tuple[str, str], words: tuple[str, ...]
) -> None:
    station = edited(tmp_path, "stations", "virtual_bench", change)
    check(calstation("run", "--station", station), 2, *words)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ((NO_SERIAL, f"{OWN_SERIAL}baud = 0"), ("imu.serial.baud", "at least 50")),
        ((NO_SERIAL, f'{OWN_SERIAL}parity = "X"'), ("imu.serial.parity",)),
        ((NO_SERIAL, f"{OWN_SERIAL}stop_bits = 3"), ("imu.serial.stop_bits",)),
        (("timeout_s = 1.0", "timeout_s = 0.0"), ("imu.timeout_s",)),
        (('port = "/dev/ttyUSB0"', "# no port"), ("imu.port", "missing")),
    ],
    ids=lambda v: v[0][:25],
)
def test_invalid_serial_settings_are_reported(
    calstation: Run, tmp_path: Path, change: tuple[str, str], words: tuple[str, ...]
) -> None:
    station = edited(tmp_path, "stations", "example_hardware", change)
    check(calstation("run", "--station", station, "--serial", "SN-1", "--yes"), 2, *words)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (('"six_position"', '"six_positions"'), ("six_positions",)),
        (("turns = 2", "turns = 0"), ("schedule.rate", "turns")),
        (("turns = 2", "tunrs = 2"), ("schedule.rate", "tunrs")),
        (("[limits.gyro_bias]", "[limits.gyro_byas]"), ("gyro_byas",)),
        (("within = 1.5e-05", "within = -1.0"), ("within",)),
        (('imu = "bench_nav"', 'imu = "none"'), ("IMU profile", "Choose from")),
        (("serial_pattern = '[A-Za-z]+", "serial_pattern = '("), ("serial_pattern",)),
    ],
    ids=lambda v: v[0][:25],
)
def test_invalid_product_file_is_reported(
    calstation: Run, tmp_path: Path, change: tuple[str, str], words: tuple[str, ...]
) -> None:
    product = edited(tmp_path, "products", "nav_a", change)
    check(calstation("run", "--product", product), 2, *words)


def test_target_for_an_unknown_parameter_is_reported(calstation: Run, tmp_path: Path) -> None:
    change = ("[schedule.excitation]\n", "[schedule.excitation]\ntargets = { gyro_bais = 1e-8 }\n")
    product = edited(tmp_path, "products", "nav_a", change)
    words = ("schedule.excitation.targets.gyro_bais", "not a parameter")
    check(calstation("run", "--product", product), 2, *words)


def test_profile_with_overlapping_registers_is_reported(calstation: Run, tmp_path: Path, home: Path) -> None:
    edited(tmp_path, "imus", "bench_nav", ("address = 3\n", "address = 2\n"))
    check(calstation("run"), 2, "bench_nav.toml", "overlap", "egisters 2")


def test_serial_number_that_does_not_match_the_pattern_is_reported(calstation: Run) -> None:
    check(calstation("run", "--serial", "SN 1!"), 2, "“SN 1!”", "--serial")


def test_run_on_hardware_requires_a_serial_number_and_refuses_bench_options(calstation: Run, tmp_path: Path) -> None:
    station = edited(tmp_path, "stations", "example_hardware")
    check(calstation("run", "--station", station), 2, "--serial is missing")
    done = calstation("run", "--station", station, "--serial", "SN-1", "--speed", 2)
    check(done, 2, "--speed", "virtual bench")


def test_limit_tighter_than_the_gravity_uncertainty_is_refused(calstation: Run, tmp_path: Path) -> None:
    station = edited(tmp_path, "stations", "example_hardware")
    done = calstation("run", "--station", station, "--serial", "SN-1")
    check(done, 2, "site.gravity_mps2", "known to 51 ppm only", "Survey gravity")


def test_gyros_that_cannot_resolve_earth_rate_require_a_confirmed_site(calstation: Run, tmp_path: Path) -> None:
    station = edited(tmp_path, "stations", "example_hardware", SURVEYED)
    product = shipped_folder() / "products" / "mems_c.toml"
    done = calstation("run", "--station", station, "--product", product, "--serial", "SN-1")
    check(done, 2, "site.confirmed_on", "not been confirmed", this_computer())


def test_unwritable_folder_is_reported(calstation: Run, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    check(calstation("run", "--out", tmp_path / "file" / "runs"), 2, "--out")
    log = write_log(tmp_path, six_position_rows())
    done = calstation("resolve", log, "--json", tmp_path / "none" / "a.json")
    assert done.code == 2
    assert "a.json: cannot be written" in done.err
    check(calstation("import", log, "-o", tmp_path / "none" / "a.h5"), 2, "a.h5")
    check(calstation("export", log, "-o", tmp_path / "none" / "a.csv"), 2, "a.csv")


@pytest.mark.skipif(sys.platform == "win32", reason="folder modes are POSIX")
def test_folder_without_write_permission_is_reported(calstation: Run, tmp_path: Path) -> None:
    locked = tmp_path / "locked"
    locked.mkdir()
    locked.chmod(stat.S_IRUSR | stat.S_IXUSR)
    try:
        (locked / "probe").touch()
    except OSError:
        check(calstation("run", "--out", locked), 2, "--out", "cannot be written")
    finally:
        locked.chmod(stat.S_IRWXU)


# ---- devices


def test_refused_connection_is_reported(calstation: Run, tmp_path: Path) -> None:
    station = edited(
        tmp_path, "stations", "example_hardware", SURVEYED, ("tcp://192.168.1.10:502", "tcp://127.0.0.1:9")
    )
    run = ("run", "--station", station, "--serial", "SN-1", "--yes", "--out", tmp_path / "runs")
    done = calstation(*run, "--json", "-")
    assert done.code == 3
    assert "tcp://127.0.0.1:9" in done.err
    assert done.json["outcome"] == "fault"
    assert done.json["passed"] is False


def test_declining_the_motion_prompt_ends_the_command(
    calstation: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    station = edited(tmp_path, "stations", "example_hardware", SURVEYED)
    run = ("run", "--station", station, "--serial", "SN-1")
    check(calstation(*run), 2, "no one has confirmed that everyone is clear", "--yes")
    monkeypatch.setattr("typer.confirm", lambda *a, **k: False)
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    check(calstation(*run), 4, "nothing has moved")


def test_wrong_baud_rate_is_reported(calstation: Run, tmp_path: Path, home: Path) -> None:
    edited(tmp_path, "imus", "bench_nav", ('sync = "55 AA"', 'sync = "5A A1"'))
    done = calstation("run", "--out", tmp_path / "runs")
    assert done.code == 3
    assert "Check baud, parity" in done.err


# ---- study


def test_invalid_study_options_are_reported(calstation: Run) -> None:
    check(calstation("study", "--grade", "toy"), 2, "'toy'", "nav")
    check(calstation("study", "--seeds", 0), 2, "--seeds")


def test_internal_error_shows_no_traceback(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def broken(*_: object, **__: object) -> int:
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr("calstation.cli.commands.resolve.solve", broken)
    assert run_app(["resolve", "x.h5"]) == 3
    output = capsys.readouterr().err
    assert output == "calstation: internal error: ZeroDivisionError: division by zero (--debug shows where)\n"
    assert run_app(["--debug", "resolve", "x.h5"]) == 3
    assert "Traceback" in capsys.readouterr().err


def test_console_without_unicode_shows_question_marks() -> None:
    code = "from calstation.cli.process import prepare; prepare(); print('\\u2264 sigma')"
    command = [sys.executable, "-c", code]
    narrow = {**os.environ, "PYTHONIOENCODING": "cp1252"}
    assert subprocess.run(command, env=narrow, capture_output=True, check=True).stdout.strip() == b"? sigma"


@pytest.mark.parametrize("command", ["resolve x.h5", "run", "study"])
def test_unwritable_result_file_is_refused_immediately(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_app([*command.split(), "--json", str(tmp_path / "none" / "a.json")]) == 2
    assert "a.json: cannot be written" in capsys.readouterr().err
