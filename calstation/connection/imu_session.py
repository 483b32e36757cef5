"""Session with the unit in the fixture without the table: opening, identification, and capture of output at rest."""

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from calstation.config import RunConfiguration
from calstation.connection.devices import endpoints, open_imu
from calstation.devices import Imu, ImuIdentity, NoFramesError, SampleBatch
from calstation.errors import DeviceFaultError
from calstation.jobs import ProgressCallback
from calstation.physics import FloatArray
from calstation.sequencer import NO_DATA, REST, Clock, Output, VerificationData, corrected_output, mean_at_rest

#: Timeout for capturing a rest without gaps, station time in s.
_REST_TIMEOUT = 60.0


@dataclass(frozen=True)
class ImuSession:
    """An open unit, its identity and the clock that its data refer to."""

    imu: Imu
    identity: ImuIdentity
    clock: Clock


@contextmanager
def open_imu_session(
    progress: ProgressCallback, setup: RunConfiguration, check_cancelled: Callable[[], None] = lambda: None
) -> Iterator[ImuSession]:
    """Open and identify the IMU alone, and close it on exit. Raises DeviceFaultError, ConfigurationError."""
    with endpoints((setup,), check_cancelled) as at:
        progress(0.1)
        with closing(open_imu(setup, at.imu)) as imu:
            at.clock.attach(lambda: {0: imu.received})
            identity = imu.identify()
            progress(0.4)
            yield ImuSession(imu, identity, at.clock)


def capture_rest(session: ImuSession, setup: RunConfiguration, check_cancelled: Callable[[], None]) -> VerificationData:
    """Capture the corrected output at rest, and the raw output if the unit provides both; it streams raw afterwards.

    Raises DeviceFaultError if no rest without a gap is captured in time.
    """
    raw = VerificationData((_rest(session, setup, check_cancelled, corrected=False),), REST)
    output = corrected_output(setup)
    if output is not Output.ASKED:
        return replace(raw, corrected=output is Output.ALWAYS)
    corrected_rest = _rest(session, setup, check_cancelled, corrected=True)
    session.imu.start()
    return VerificationData((corrected_rest,), REST, corrected=True, reference=raw)


def _rest(
    session: ImuSession, setup: RunConfiguration, check_cancelled: Callable[[], None], *, corrected: bool
) -> FloatArray:
    """Return the mean output over one rest, rad/s and m/s², shape (6,)."""
    model = setup.solve_context().imu
    count = round(REST * model.sample_rate)
    ready = setup.imu.status.ready
    parts = read_contiguous(session, ready, count, lambda taken: check_cancelled(), corrected=corrected)
    if parts is None:
        raise DeviceFaultError("connection.no_rest", seconds=_REST_TIMEOUT)
    return mean_at_rest(np.concatenate([part.counts for part in parts])) * model.count_size


def read_contiguous(
    session: ImuSession,
    ready: int,
    count: int,
    on_samples: Callable[[int], None] = lambda taken: None,
    *,
    corrected: bool = False,
) -> list[SampleBatch] | None:
    """Read at least `count` samples without a gap from a unit that is ready; None if they do not arrive in time.

    A unit that restarts during the capture returns to its raw output or to none, so its output is selected again.

    ready : mask of the status bits that are set when the unit is ready; 0 if there are none
    on_samples : called with the number of samples so far; may raise
    corrected : whether to select the output with the unit's registers applied
    """
    imu, clock = session.imu, session.clock
    imu.start(corrected=corrected)
    last_data = clock.now()
    deadline = last_data + _REST_TIMEOUT
    parts: list[SampleBatch] = []
    last, noisy = np.empty(0, np.int64), False
    while (taken := sum(map(len, parts))) < count:
        on_samples(taken)
        if clock.now() > deadline:
            return None
        clock.sleep(clock.tick)
        lost = clock.now() - last_data > NO_DATA
        try:
            batch = imu.read()
        except NoFramesError:
            if noisy:
                raise
            lost = noisy = True
        else:
            if len(batch):
                seq, last, last_data = np.concatenate([last, batch.seq]), batch.seq[-1:], clock.now()
                awake = not ready or bool((batch.status & ready).all())
                noisy, lost = False, bool((np.diff(seq) != 1).any()) or bool(parts and not awake)
                if awake and not lost:
                    parts.append(batch)
        if lost:
            parts.clear()
            imu.wake(partial(on_samples, 0), corrected=corrected)
            last, last_data = last[:0], clock.now()
    return parts
