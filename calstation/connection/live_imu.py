"""Application of a solution to the live output of its unit, which is read for a few seconds."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calstation.config import RunRequest, load_bench, load_configuration
from calstation.connection.devices import StationBench
from calstation.connection.imu_session import open_imu_session, read_contiguous
from calstation.devices import SampleBatch
from calstation.errors import DeviceFaultError
from calstation.estimation.common import SampleBlock
from calstation.jobs import ProgressCallback
from calstation.physics import FloatArray
from calstation.records import open_log
from calstation.results.plots import Applied, ImuOutput

#: Duration of the captured stream, s.
SECONDS = 10.0


@dataclass(frozen=True)
class OtherUnit:
    """Result if the fixture contains a different unit with this serial number; the solution was not applied."""

    serial: str


def apply_to_unit(
    progress: ProgressCallback,
    path: Path,
    station: Path | None,
    product: Path | None,
    before: FloatArray,
    after: FloatArray,
    seconds: float = SECONDS,
) -> Applied | OtherUnit:
    """Job: apply the solution of the recording `path` to the output of its unit; see `read_unit`, `ImuOutput.applied`.

    Raises InputError if the recording cannot be read, and the errors of these functions.
    """
    progress(0.0)
    output = read_unit(progress, open_log(path).meta.imu.serial, path, station, product, seconds)
    return output if isinstance(output, OtherUnit) else output.applied(before, after)


def read_unit(
    progress: ProgressCallback,
    serial: str,
    recording: Path | None,
    station: Path | None,
    product: Path | None,
    seconds: float = SECONDS,
) -> ImuOutput | OtherUnit:
    """Read `seconds` of output of the unit `serial` in the fixture, without motion and without writing to it.

    On the virtual bench, the fixture contains the unit of the recording, if a recording identifies it. Raises
    DeviceFaultError or ConfigurationError if the unit cannot be read.
    """
    setup = load_configuration(RunRequest(serial, station, product))
    if setup.station.bench is not None and recording is not None:
        bench: StationBench = load_bench()
        setup = bench.with_recorded_unit(recording, setup)
    meta = setup.log_meta()
    count = round(seconds * meta.imu.sample_rate_hz)
    with open_imu_session(progress, setup) as unit:
        if unit.identity.serial != serial:
            return OtherUnit(unit.identity.serial)
        # progress is 0.4 at the first sample and 0.95 at the last
        parts = read_contiguous(
            unit, setup.imu.status.ready, count, lambda taken: progress(0.4 + (0.95 - 0.4) * taken / count)
        )
    if parts is None:
        raise DeviceFaultError("connection.samples_lost")
    return ImuOutput(meta, [_block(parts)], setup.after_registers, named=setup.imu.has_commands)


def _block(parts: list[SampleBatch]) -> SampleBlock:
    counts = np.concatenate([part.counts for part in parts])
    return SampleBlock(
        stage="",
        seq=np.concatenate([part.seq for part in parts]),
        time=np.concatenate([part.time for part in parts]),
        counts=counts,
        angles=np.full((len(counts), 2), np.nan),
        step=np.zeros(len(counts), np.int64),
        valid=np.isfinite(counts).all(axis=1),
        temperature=np.concatenate([part.temperature for part in parts]),
    )
