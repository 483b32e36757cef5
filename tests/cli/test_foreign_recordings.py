"""Recordings of other programs and devices are imported, checked and solved from the terminal."""

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calstation.physics import group_matrix, group_vector, parameter_vector
from tests.cli.conftest import META, Done, six_position_rows, write_log
from tests.devices.novatel import novatel_line
from tests.procedures import real_recordings as real

Run = Callable[..., Done]
CAPTURES = real.REAL / "serial_captures"
IMU_TK = """
[columns]
time_s = { from = 1 }
accel_x = { from = 2 }
accel_y = { from = 3 }
accel_z = { from = 4 }
"""


def capture(path: Path) -> Path:
    """Write text output of a unit at 100 Hz with 20 lost samples and a truncated line at each end."""
    lines = [novatel_line(100.0 + k / 100.0) for k in range(500) if not 100 <= k < 120]
    path.write_bytes("".join(lines).encode()[20:-30])
    return path


def test_capture_is_imported_as_a_log(calstation: Run, tmp_path: Path) -> None:
    raw, log = capture(tmp_path / "x.raw"), tmp_path / "x.h5"
    done = calstation("import", raw, "--imu", "novatel_rawimu", "-o", log)
    assert done.code == 0, done.err
    assert "478 samples, 1 gap, 0 packets with a wrong check" in done.err
    found = calstation("check", log, "--json", "-").json
    assert (found["serial"], found["sample_rate_hz"], found["missing"]) == ("x", 100.0, 20)
    (tmp_path / "x.toml").write_text(f'{META.split("[imu]")[0]}[imu]\nserial = "SPAN-7"\n')
    assert calstation("import", raw, "--imu", "novatel_rawimu", "-o", tmp_path / "y.h5").code == 0
    assert calstation("check", tmp_path / "y.h5", "--json", "-").json["serial"] == "SPAN-7"


@pytest.mark.skipif(not CAPTURES.is_dir(), reason=f"no recordings at {CAPTURES}")
@pytest.mark.parametrize(
    ("name", "file", "samples"),
    [
        ("microstrain_mip", "microstrain_mip/mip_data.bin", 4473),
        ("xsens_mtdata2", "xsens_mtdata2/1/output.bin", 96),
        ("stim300", "stim300_one_datagram/datagram_full.bin", 1),
    ],
)
def test_real_captures_are_imported_without_loss(
    calstation: Run, tmp_path: Path, name: str, file: str, samples: int
) -> None:
    done = calstation("import", CAPTURES / file, "--imu", name, "-o", tmp_path / "x.h5")
    assert done.code == 0, done.err
    counted = f"{samples} {'sample' if samples == 1 else 'samples'}, 0 gaps, 0 packets with a wrong check"
    assert f"{counted}, 0 bytes skipped" in done.err


def test_a_capture_of_another_unit_is_refused(calstation: Run, tmp_path: Path) -> None:
    done = calstation("import", capture(tmp_path / "x.raw"), "--imu", "stim300", "-o", tmp_path / "x.h5")
    assert done.code == 2
    assert "No sample frame of the profile 'STIM300" in done.err
    assert not (tmp_path / "x.h5").exists()


def test_six_position_log_is_checked(calstation: Run, tmp_path: Path) -> None:
    found = calstation("check", write_log(tmp_path, six_position_rows()), "--json", "-").json
    assert found["methods"] == {"six_position": {"solvable": True, "reason": None}}
    assert found["channels"] == ["accel", "encoders", "gyro"]
    assert found["rate_hz"] == pytest.approx(50.0)
    done = calstation("check", write_log(tmp_path, six_position_rows()[:900]))
    assert done.code == 2
    assert "six_position" in done.out
    assert "Include all six faces." in done.out


def without_gyros(columns: str = "") -> tuple[list[str], str, str]:
    """Return rows, header and TOML of a six-position log in mg with semicolons and decimal commas."""
    rows = ["t;ax;ay;az"]
    random = np.random.default_rng(4)
    for k, row in enumerate(six_position_rows()):
        force = np.array([float(cell) for cell in row.split(",")[5:8]]) * 1e-6 / 9.80665e-3
        force += 1000.0 * random.normal(size=3) if k % 400 < 50 else 0.0
        rows.append(";".join(f"{v:.3f}".replace(".", ",") for v in (20.0 * k, *force)))
    map_ = '\n[columns]\ntime_s = { from = "t", unit = "ms" }\n'
    map_ += "".join(f'accel_{a} = {{ from = "a{a}", unit = "mg" }}\n' for a in "xyz")
    meta = META.replace("[imu]", "gravity_mps2 = 9.7969\n[imu]")
    for entry in ("gyro_lsb = 1e-7\n", "gyro_arw = 1e-5\n", "accel_lsb = 1e-6\n"):
        meta = meta.replace(entry, "")
    return rows[1:], rows[0], meta + map_ + columns


@pytest.mark.parametrize("method", ["six_position", "multi_position"])
def test_accelerometers_alone_are_calibrated(calstation: Run, tmp_path: Path, method: str) -> None:
    path = write_log(tmp_path, *without_gyros(f'stage = {{ value = "{method}" }}\n'))
    done = calstation("resolve", path, "--json", "-")
    assert done.code == 0, done.err
    found = done.json["parameters"]
    assert not any(name.startswith("gyro") for name in found)
    for name in ("accel_scale_x", "accel_scale_y", "accel_scale_z"):
        assert abs(found[name]["value"]) < 4.0 * found[name]["sigma"]
        # six faces are not redundant, so multi_position assumes the scatter of a unit that is turned by hand
        assert found[name]["sigma"] < (1e-5 if method == "six_position" else 1e-3)


def test_methods_that_require_gyros_report_their_absence(calstation: Run, tmp_path: Path) -> None:
    path = write_log(tmp_path, *without_gyros('stage = { value = "excitation" }\n'))
    done = calstation("resolve", path)
    assert done.code == 2
    assert "The method needs gyros, but the recording contains only accelerometers." in done.err
    assert "needs gyros" in calstation("check", path).out


@pytest.mark.long
@pytest.mark.skipif(not real.IMU_TK.exists(), reason="the real recordings are not beside the project")
def test_accelerometer_parameters_of_the_xsens_recording_agree_with_its_authors(
    calstation: Run, tmp_path: Path
) -> None:
    path, meta = tmp_path / "acc.txt", real.IMU_TK_META
    path.write_bytes(gzip.decompress((real.IMU_TK / "xsens_acc.txt.gz").read_bytes()))
    zero = 32768 * real.IMU_TK_ACCEL_LSB
    for axis in "xyz":
        meta = meta.replace(f"accel_bias_{axis} = {{", f"accel_bias_{axis} = {{ value = {zero!r},")
    path.with_suffix(".toml").write_text(meta + IMU_TK)
    done = calstation("resolve", path, "--stages", "multi_position", "--json", "-")
    assert done.code == 0, done.err
    published, found = real.imu_tk_published(), done.json["parameters"]
    value = parameter_vector({name: row["value"] for name, row in found.items()})
    matrix = np.eye(3) + group_matrix(value, "accel_scale", "accel_misalign")
    assert matrix == pytest.approx(published["accel_matrix"], abs=3e-4)
    assert group_vector(value, "accel_bias") - zero == pytest.approx(published["accel_bias"], abs=2e-3)


FIELD_TOML = """[site]
latitude_deg = 34.25
longitude_deg = 108.9
height_m = 400.0
[imu]
serial = "H7"
sample_rate_hz = 50.0
gyro_arw = 4.4e-5
accel_vrw = 5.9e-4
"""


def test_look_shows_what_was_understood_and_writes_nothing(calstation: Run, tmp_path: Path) -> None:
    values = np.random.default_rng(0).normal([0, 0, 0, 0, 0, 1], 0.01, (400, 6))
    lines = [f"{0.02 * k:.2f}," + ",".join(f"{v:.4f}" for v in row) for k, row in enumerate(values)]
    lines.insert(100, lines[100])
    lines[200] = "0.1,3"
    header = "time_s,gyro_x [deg/s],gyro_y [deg/s],gyro_z [deg/s],accel_x [m/s2],accel_y [m/s2],accel_z [m/s2]"
    (tmp_path / "rec.csv").write_text("\n".join([header, *lines]))
    (tmp_path / "rec.toml").write_text(FIELD_TOML)
    done = calstation("import", tmp_path / "rec.csv", "--look")
    assert "gyro_x from 'gyro_x [deg/s]', deg/s" in done.out
    assert "1 repeated row left out" in done.out
    assert "1 damaged row" in done.out
    assert "g instead of m/s" in done.out.replace("\n", " ")
    assert not list(tmp_path.glob("*.h5"))
    done = calstation("import", tmp_path / "rec.csv")
    assert (done.code, "-o LOG" in done.err) == (2, True)
    done = calstation("import", tmp_path / "rec.csv", "-o", tmp_path / "rec.h5")
    assert done.code == 0
    assert "1 damaged row lost (samples 199…199), 1 repeated row left out" in done.err.replace("\n", " ")
