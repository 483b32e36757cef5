"""Inspection of a recording whose samples do not fit in memory."""

import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from calstation.estimation.common import SampleBlock
from calstation.records import Log, LogMeta, open_log
from calstation.results import inspect_recording, inspection, recording_faults
from tests.cli.conftest import META, six_position_rows, write_log

BLOCK, BLOCKS = 4096, 50


def long_log(meta: LogMeta) -> Log:
    """Return a log of 205,000 samples at rest without stages."""

    def scan() -> Iterator[SampleBlock]:
        rng = np.random.default_rng(1)
        for k in range(BLOCKS):
            seq = np.arange(k * BLOCK, (k + 1) * BLOCK)
            counts = np.round(rng.normal(0.0, 30.0, (BLOCK, 6)))
            yield SampleBlock.without_table("", seq, (seq + 1) / meta.imu.sample_rate_hz, counts)

    return Log(Path("long.h5"), meta, scan)


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    return write_log(tmp_path, six_position_rows(), meta=META)


@pytest.mark.long
def test_memory_does_not_grow_with_the_length_of_a_recording(recording: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inspection, "MAX_TESTED", 5_000)
    log = long_log(open_log(recording).meta)
    monkeypatch.setattr(inspection, "open_log", lambda path: log)
    inspect_recording(recording)  # compiles
    tracemalloc.start()
    found = inspect_recording(recording)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found.facts.samples == BLOCK * BLOCKS
    assert found.rate == pytest.approx(log.meta.imu.sample_rate_hz, rel=1e-9)
    assert found.tested == 5_000
    assert peak < 10e6, peak


def test_the_start_of_every_stage_is_tested(recording: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log, sizes = open_log(recording), []
    samples = log.facts().samples
    original = inspection.data_faults

    def data_faults(block, context, prior):  # type: ignore[no-untyped-def]
        sizes.append((block.stage, len(block)))
        return original(block, context, prior)

    monkeypatch.setattr(inspection, "data_faults", data_faults)
    assert recording_faults(log) == ()
    assert inspect_recording(recording).tested is None
    monkeypatch.setattr(inspection, "MAX_TESTED", samples - 1)
    assert inspect_recording(recording).tested == samples - 1
    assert sizes == [("six_position", samples)] * 2 + [("six_position", samples - 1)]


def test_clipped_channel_is_said_before_a_solution(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    time = 0.02 * np.arange(3000)
    values = random.normal([0, 0, 0, 0, 0, 1], 0.02, (3000, 6))
    values[:, 0] = np.clip(values[:, 0] + 300.0 * np.sin(0.3 * time), -250.0, 250.0)
    rows = [f"{t:.2f},{','.join(f'{v:.5f}' for v in row)}" for t, row in zip(time, values, strict=True)]
    header = "time_s,gyro_x [deg/s],gyro_y [deg/s],gyro_z [deg/s],accel_x [g],accel_y [g],accel_z [g]"
    (path := tmp_path / "a.csv").write_text("\n".join([header, *rows]))
    path.with_suffix(".toml").write_text(
        "[site]\nlatitude_deg = 34.25\nlongitude_deg = 108.9\nheight_m = 400.0\n"
        '[imu]\nserial = "H7"\nsample_rate_hz = 50.0\ngyro_arw = 4.4e-5\naccel_vrw = 5.9e-4\n'
    )
    ((fault),) = recording_faults(open_log(path))
    assert "gyro x is clipped" in str(fault)
    assert "250 °/s" in str(fault)
