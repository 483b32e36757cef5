"""Sessions with the unit in the fixture, without the table, to capture its output or apply a solution to it."""

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from calstation.config import RunConfiguration, RunRequest, load_bench, load_configuration
from calstation.connection.devices import StationBench, endpoints, open_imu
from calstation.devices import Imu, ImuIdentity, NoFramesError, SampleBatch
from calstation.errors import DeviceFaultError
from calstation.estimation.common import SampleBlock
from calstation.jobs import ProgressCallback
from calstation.physics import FloatArray
from calstation.records import open_log
from calstation.results.plots import Applied, ImuOutput
from calstation.sequencer import NO_DATA, REST, Clock, Output, VerificationData, corrected_output, mean_at_rest

#: Timeout for a capture without gaps, station time, s.
_REST_TIMEOUT = 60.0


#: Duration of the captured stream, s.
SECONDS = 10.0


@dataclass(frozen=True)
class ImuSession:
    """An open unit, its identity, and the clock of its data."""

    imu: Imu
    identity: ImuIdentity
    clock: Clock


@contextmanager
def open_imu_session(
    progress: ProgressCallback, setup: RunConfiguration, check_cancelled: Callable[[], None] = lambda: None
) -> Iterator[ImuSession]:
    """Open and identify only the IMU, and close it on exit. Raises DeviceFaultError or ConfigurationError."""
    with endpoints((setup,), check_cancelled) as ports:
        progress(0.1)
        with closing(open_imu(setup, ports.imu)) as imu:
            ports.clock.attach(lambda: {0: imu.received})
            identity = imu.identify()
            progress(0.4)
            yield ImuSession(imu, identity, ports.clock)


def capture_rest(session: ImuSession, setup: RunConfiguration, check_cancelled: Callable[[], None]) -> VerificationData:
    """Capture the output at rest, raw and, if the unit provides it, corrected; then select the raw output again.

    Raises DeviceFaultError if no rest without a gap is captured in time.
    """
    raw = _rest(session, setup, check_cancelled, corrected=False)
    output = corrected_output(setup)
    if output is not Output.ON_COMMAND:
        return replace(raw, corrected=output is Output.ALWAYS)
    corrected = _rest(session, setup, check_cancelled, corrected=True)
    session.imu.start()
    return replace(corrected, reference=raw)


def _rest(
    session: ImuSession, setup: RunConfiguration, check_cancelled: Callable[[], None], *, corrected: bool
) -> VerificationData:
    """Return the mean output and temperature over one rest."""
    model = setup.solve_context().imu
    count = round(REST * model.sample_rate)
    ready = setup.imu.status.ready
    parts = read_contiguous(session, ready, count, lambda taken: check_cancelled(), corrected=corrected)
    if parts is None:
        raise DeviceFaultError("connection.no_rest", seconds=_REST_TIMEOUT)
    mean = mean_at_rest(np.concatenate([part.counts for part in parts])) * model.count_size
    temperature = np.concatenate([part.temperature for part in parts])
    known = temperature[np.isfinite(temperature)]
    return VerificationData((mean,), REST, corrected=corrected, temperature=float(known.mean()) if len(known) else None)


def read_contiguous(
    session: ImuSession,
    ready: int,
    count: int,
    on_samples: Callable[[int], None] = lambda taken: None,
    *,
    corrected: bool = False,
) -> list[SampleBatch] | None:
    """Return at least `count` samples without a gap, or None if they do not arrive in time.

    If the unit restarts during the capture, its output is selected again.

    Parameters
    ----------
    session : session with the unit
    ready : mask of the status bits that are set when the unit is ready; 0 if there are none
    count : number of samples
    on_samples : called with the number of samples read; may raise
    corrected : whether the unit's registers are applied to the output
    """
    imu, clock = session.imu, session.clock
    imu.start(corrected=corrected)
    last_data = clock.now()
    deadline = last_data + _REST_TIMEOUT
    parts: list[SampleBatch] = []
    last, had_noise = np.empty(0, np.int64), False
    while (taken := sum(map(len, parts))) < count:
        on_samples(taken)
        if clock.now() > deadline:
            return None
        clock.sleep(clock.tick)
        is_interrupted = clock.now() - last_data > NO_DATA
        try:
            batch = imu.read()
        except NoFramesError:
            if had_noise:
                raise
            is_interrupted = had_noise = True
        else:
            if len(batch):
                seq, last, last_data = np.concatenate([last, batch.seq]), batch.seq[-1:], clock.now()
                is_ready = not ready or bool((batch.status & ready).all())
                had_noise, is_interrupted = False, bool((np.diff(seq) != 1).any()) or bool(parts and not is_ready)
                if is_ready and not is_interrupted:
                    parts.append(batch)
        if is_interrupted:
            parts.clear()
            imu.wake(partial(on_samples, 0), corrected=corrected)
            last, last_data = last[:0], clock.now()
    return parts


@dataclass(frozen=True)
class OtherUnit:
    """The serial number of a different unit in the fixture."""

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
    """Job: apply the solution of a recording to the current output of its unit.

    Raises InputError if the recording cannot be read, and the errors of `read_unit` and `ImuOutput.applied`.

    Parameters
    ----------
    progress : called with the progress
    path : recording that was solved
    station, product : files; None for the defaults
    before, after : parameters before and after the calibration, shape (30,), SI
    seconds : duration of the captured output, s
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
    """Read the output of the unit in the fixture; nothing moves, and nothing is written to the unit.

    Raises DeviceFaultError or ConfigurationError.

    Parameters
    ----------
    progress : called with the progress
    serial : serial number of the unit
    recording : recording whose unit a virtual bench then contains; None for the unit of the configuration
    station, product : files; None for the defaults
    seconds : duration of the captured output, s
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
        # the progress is 0.4 at the first sample and 0.95 at the last one
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
