"""Fixtures that run commands in this process on small logs."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calstation.cli.app import run_app

META = """
[site]
latitude_deg = 34.25
longitude_deg = 108.9
height_m = 400.0
azimuth_deg = 0.0

[imu]
serial = "SN-7"
sample_rate_hz = 50.0
output = "rate"
gyro_lsb = 1e-7
accel_lsb = 1e-6
gyro_arw = 1e-5
accel_vrw = 1e-4
"""
HEADER = "seq,time_s,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z,outer_deg,inner_deg,stage,step"
FACES = ((0, 0), (180, 0), (90, 0), (270, 0), (90, 90), (90, 270))


@dataclass
class Done:
    """Exit code, standard output and standard error of a command."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """Standard output as JSON."""
        return json.loads(self.out)


@pytest.fixture
def calstation(capsys: pytest.CaptureFixture[str]) -> Callable[..., Done]:
    """Run a command line."""

    def run(*arguments: object) -> Done:
        capsys.readouterr()
        code = run_app([str(argument) for argument in arguments])
        out, err = capsys.readouterr()
        return Done(code, out, err)

    return run


def six_position_rows(seconds: float = 8.0) -> list[str]:
    """Return rows of a six-position recording at 50 Hz without the moves between positions."""
    random = np.random.default_rng(3)
    rows = []
    for face, (outer, inner) in enumerate(FACES):
        a, b = np.deg2rad([outer, inner])
        up = np.array([np.sin(b) * np.sin(a), np.cos(b) * np.sin(a), np.cos(a)])
        for _ in range(int(seconds * 50)):
            k = len(rows)
            force = (9.7969 * up + random.normal(0.0, 1e-4 * 50**0.5, 3)) / 1e-6
            gyro = random.normal(0.0, 1e-5 * 50**0.5, 3) / 1e-7
            cells = ",".join(str(round(v)) for v in (*gyro, *force))
            rows.append(f"{k},{(k + 1) / 50:.2f},{cells},{outer},{inner},six_position,{face}")
    return rows


def write_log(folder: Path, rows: list[str], header: str = HEADER, meta: str = META) -> Path:
    """Write a CSV log with its TOML file."""
    path = folder / "log.csv"
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    path.with_suffix(".toml").write_text(meta, encoding="utf-8")
    return path
