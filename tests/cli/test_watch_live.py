"""`calstation watch` monitors IMUs on one body live through their serial lines."""

import json
import os
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from calstation.config import library
from calstation.records import load_pair
from tests.cli.conftest import Done

Run = Callable[..., Done]

#: Clocks of the two units, and the time of the secondary's power-on, s, as in the shipped station.
DRIFTS, POWER_ON = (20e-6, -35e-6), 0.3713
#: A unit counts its samples from the end of its start, s.
BOOT = 0.1


def station(
    folder: Path, primary: dict[str, Any] | None = None, secondary: dict[str, Any] | None = None, **more
) -> Path:
    """Write the shipped station at full speed over sockets, with changed settings of units and schedule."""
    values = tomllib.loads(library.find("stations", "virtual_pair").read_text())
    values["cross_calibration"] |= more
    bench = values["bench"]
    bench |= {"speed": 0.0, "imu_transport": "socket", **(primary or {})}
    bench["secondaries"][0] |= secondary or {}
    path = folder / "pair.toml"
    path.write_text(tomli_w.dumps(values))
    return path


def kinds(done: Done) -> list[str]:
    return [event["kind"] for event in done.json["events"]]


def test_station_without_a_second_imu_or_with_a_numbering_gap_is_refused(calstation: Run, tmp_path: Path) -> None:
    done = calstation("watch", "--station", "virtual_bench", "--seconds", 1)
    assert done.code == 2
    assert "Add a table [imu2]" in done.err
    path = station(tmp_path)
    path.write_text(path.read_text().replace("[imu2]", "[imu3]"))
    done = calstation("watch", "--station", path, "--seconds", 1)
    assert done.code == 2
    assert "no imu2" in done.err
    assert calstation("watch").code == 2


def test_no_run_is_started_at_a_station_whose_imus_are_on_one_body(calstation: Run, tmp_path: Path) -> None:
    for product in ([], ["--product", "mems_hand"]):
        done = calstation(
            "run", "--serial", "SN-000042", "--station", station(tmp_path), *product, "--out", tmp_path / "runs"
        )
        assert done.code == 2
        assert "Station “virtual pair” compares IMUs on one body" in done.err
    assert not (tmp_path / "runs").exists()


def test_product_over_temperature_is_refused_at_the_start(calstation: Run, tmp_path: Path) -> None:
    done = calstation("watch", "--station", station(tmp_path), "--product", "nav_a_thermal", "--seconds", 1)
    assert done.code == 2
    assert "is calibrated over temperature, but IMUs on one body are compared at one temperature" in done.err


def test_primary_accepts_only_a_fixed_threshold(calstation: Run, tmp_path: Path) -> None:
    path = station(tmp_path, primary_gyro={"fixed": 1e-4, "ratio": 2.0})
    done = calstation("watch", "--station", path, "--seconds", 1)
    assert done.code == 2
    assert "only a fixed threshold" in done.err


@pytest.mark.long
def test_a_secondary_out_of_tolerance_is_calibrated_live_and_aligned(calstation: Run, tmp_path: Path) -> None:
    pairs = tmp_path / "pairs"
    path = station(tmp_path, period_s=30.0)
    done = calstation("watch", "--station", path, "--seconds", 130, "--pairs", pairs, "--json", "-")
    assert done.code == 0, done.err
    assert "waiting for motion: " in done.err
    assert kinds(done)[:4] == ["triggered", "checked", "calibrating", "aligned"]
    assert "calibrated" in kinds(done)
    row = done.json["secondaries"][0]
    assert row["verdicts"] == {"gyro": "within", "accel": "within"}
    assert abs(row["stored"]["values"]["clock_offset"]) < 1e-4  # what alignment leaves
    assert len(load_pair(pairs, "SN-PAIR-1", "SN-PAIR-1-2").values) == 28
    clock = row["alignment"]
    drift = 1.0 - (1.0 + DRIFTS[1]) / (1.0 + DRIFTS[0])
    assert clock["drift"] == pytest.approx(drift, abs=2e-7)
    # 130 s of the primary's time and the first rows; the offset changes by 55 µs/s
    expected = POWER_ON * (1.0 + DRIFTS[1]) + (130.2 + BOOT) * drift
    assert clock["offset"] == pytest.approx(expected, abs=3e-5)


@pytest.mark.long
def test_nothing_is_calibrated_against_a_silent_or_out_of_tolerance_primary(calstation: Run, tmp_path: Path) -> None:
    primary = {"orders": [{"order": "silence_imu", "value": 5.0, "at": 20.0}], "gyro_steps": [[30.0, 0.05]]}
    path = station(tmp_path, primary, period_s=20.0)
    done = calstation("watch", "--station", path, "--seconds", 150, "--pairs", tmp_path, "--json", "-")
    assert done.code == 1
    assert {"primary_silent", "primary_resumed", "primary_off"} <= set(kinds(done))
    off = next(event for event in done.json["events"] if event["kind"] == "primary_off")
    assert off["sensors"] == ["gyro"]
    later = [event for event in done.json["events"] if event["time"] > off["time"] and event["kind"] == "calibrated"]
    assert all("gyro" not in event["sensors"] for event in later)
    check = done.json["secondaries"][0]["check"]
    assert not check["primary"]["gyro"]["within"]


@pytest.mark.long
def test_secondary_is_realigned_after_a_restart_or_link_loss(calstation: Run, tmp_path: Path) -> None:
    secondary = {"orders": [{"order": "reset_imu", "at": 25.0}, {"order": "hang_up_imu", "at": 100.0}]}
    path = station(tmp_path, None, secondary, period_s=30.0)
    done = calstation("watch", "--station", path, "--seconds", 200, "--pairs", tmp_path, "--json", "-")
    assert done.code == 0, done.err
    assert kinds(done).count("aligned") >= 3
    assert "primary_silent" not in kinds(done)
    clock = done.json["secondaries"][0]["alignment"]
    assert clock["measured"]
    assert clock["sigma"] < 1e-3


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals and signals")
def test_check_runs_on_request_and_ctrl_c_ends_the_watch_cleanly(tmp_path: Path) -> None:
    path = station(tmp_path, {"speed": 1.0, "imu_transport": "pty"}, trigger="command")
    command = [sys.executable, "-m", "calstation", "watch", "--station", str(path), "--pairs", str(tmp_path)]
    environment = {**os.environ, "CALSTATION_HOME": str(tmp_path)}
    keyboard, terminal = os.openpty()
    with subprocess.Popen(
        [*command, "--json", "-"],
        stdin=terminal,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    ) as process:
        assert process.stderr is not None
        time.sleep(8.0)
        os.write(keyboard, b"c\n")
        line = process.stderr.readline()
        assert "A check is due" in line
        time.sleep(3.0)
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=60.0)
    assert process.returncode == 4
    assert json.loads(out)["events"][0]["kind"] in ("triggered", "aligned")
