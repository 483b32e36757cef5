"""Samples and configuration shared by the tests of records."""

from pathlib import Path

import numpy as np

from calstation.estimation.common import SampleBlock, snap_angles
from calstation.records import LogMeta

META = {
    "site": {"latitude_deg": 34.25, "longitude_deg": 108.9, "height_m": 400, "azimuth_deg": 12.5},
    "imu": {
        "serial": "SN-7",
        "sample_rate_hz": 100.0,
        "output": "increment",
        "gyro_lsb": 4.84813681109536e-08,
        "accel_lsb": 1e-06,
        "gyro_arw": 2.908882086657216e-07,
        "accel_vrw": 4.9e-05,
    },
    "table": {"encoder_sigma_deg": 0.03},
    "prior": {"gyro_bias_x": {"value": 1e-7, "sigma": 1e-5}},
    "product": {"name": "unit", "limits": {"gyro_bias": {"within": 1e-4, "sigma_below": 1e-7}}},
    "run": {
        "stages": ["rate", "excitation"],
        "station": "here",
        "software": "0.1",
        "started_utc": "2026-11-21T10:00:00Z",
    },
    "schedule": {"rate": {"turns": 2, "names": ["a", "b"], "rate_dps": 20.0}},
    "profiles": {"imu": 'name = "äöü"\nmulti = """x\n"""\n'},
    "registers": {"gyro_bias_x": 0.1 + 0.2},
}


def make_block(stage: str, first: int, count: int, seed: int = 0, step: int = 0) -> SampleBlock:
    random = np.random.default_rng([seed, first])
    seq = np.arange(first, first + count, dtype=np.int64)
    angles = snap_angles(random.uniform(-20, 20, (count, 2)))
    angles[random.random(count) < 0.5] = np.nan
    temperature = random.uniform(20, 40, count)
    temperature[::3] = np.nan
    return SampleBlock(
        stage,
        seq,
        (seq + 1) / 100.0,
        random.integers(-(2**27), 2**27, (count, 6)).astype(np.float64),
        angles,
        np.full(count, step, np.int64),
        random.random(count) < 0.9,
        temperature,
    )


def joined(parts: list[SampleBlock]) -> dict[str, np.ndarray]:
    """Return the columns of consecutive blocks, including stage names."""
    columns = {
        name: np.concatenate([getattr(b, name) for b in parts])
        for name in ("seq", "time", "counts", "angles", "step", "valid", "temperature")
    }
    columns["stage"] = np.array([b.stage for b in parts for _ in range(len(b))])
    return columns


def assert_same(left: list[SampleBlock], right: list[SampleBlock]) -> None:
    """Assert bit-identical samples, however the blocks are split."""
    a, b = joined(left), joined(right)
    for name in a:
        np.testing.assert_array_equal(a[name], b[name], err_msg=name)


CSV_HEADER = "seq,time_s,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z,outer_deg,inner_deg,stage,step"


def write_csv_log(folder: Path, rows: list[str], header: str = CSV_HEADER, rate: float = 100.0) -> Path:
    """Write a CSV log with its TOML file."""
    path = folder / "log.csv"
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    meta = LogMeta.model_validate(
        {"site": META["site"], "imu": {**META["imu"], "sample_rate_hz": rate}}  # type: ignore[dict-item]
    )
    (folder / "log.toml").write_text(meta.to_toml(), encoding="utf-8")
    return path


def csv_rows(count: int, first: int = 0) -> list[str]:
    """Return rows of a unit at rest at 100 Hz."""
    return [f"{first + i},{(first + i + 1) / 100:.4f},1,-2,3,4,5,98000,0.5,,rate,0" for i in range(count)]
