"""The unit in the fixture without the table: open and named, its output at rest taken where that is asked for."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from calstation.config.resolved import ResolvedConfiguration
from calstation.connection.clock import BenchClock
from calstation.connection.devices import endpoints, open_imu
from calstation.devices.interfaces import Imu, ImuIdentity, NoFramesError, SampleBatch
from calstation.errors import DeviceFaultError
from calstation.jobs.queue import ProgressCallback
from calstation.physics.arrays import FloatArray
from calstation.sequencer.acquisition import to_si
from calstation.sequencer.capture import REST, VerificationData, mean_at_rest
from calstation.sequencer.context import Clock
from calstation.sequencer.control_loop import NO_DATA
from calstation.sequencer.task import Output

#: Told when the link is open, and the unit named.
_SHARES = (0.1, 0.4)

_WITHIN = 60.0
_TICK = 0.05


@dataclass(frozen=True)
class ImuSession:
    """An open unit, who it is, and the clock that it lives by."""

    imu: Imu
    identity: ImuIdentity
    clock: Clock


@contextmanager
def open_imu_session(
    tell: ProgressCallback, setup: ResolvedConfiguration, check_cancelled: Callable[[], None] = lambda: None
) -> Iterator[ImuSession]:
    """The IMU alone; closed on the way out. Raises DeviceFaultError, ConfigurationError.

    hear : called while a virtual bench comes up, may raise
    """
    with endpoints(setup, check_cancelled) as at:
        tell(_SHARES[0])
        imu = open_imu(setup, at.imu)
        try:
            if isinstance(at.clock, BenchClock):
                at.clock.attach(lambda: imu.received)
            identity = imu.identify()
            tell(_SHARES[1])
            yield ImuSession(imu, identity, at.clock)
        finally:
            imu.close()


def capture_rest(
    unit: ImuSession, setup: ResolvedConfiguration, check_cancelled: Callable[[], None]
) -> VerificationData:
    """Corrected output at rest of a unit that nobody turns, and its raw one where it shows both.

    Behind it the raw stream is on. Raises DeviceFaultError; `hear` may raise as well.
    """
    raw = VerificationData((_rest(unit, setup, check_cancelled, corrected=False),), REST)
    if setup.corrected is not Output.ASKED:
        return replace(raw, corrected=setup.corrected is Output.ALWAYS)
    own = VerificationData(
        (_rest(unit, setup, check_cancelled, corrected=True),), REST, corrected=True, reference=raw
    )
    unit.imu.start()
    return own


def _rest(
    unit: ImuSession, setup: ResolvedConfiguration, check_cancelled: Callable[[], None], *, corrected: bool
) -> FloatArray:
    """Mean of one rest, rad/s and m/s², shape (6,)."""
    model = setup.solve_context().imu
    count = round(REST * model.sample_rate)
    parts = read_contiguous(
        unit.imu,
        unit.clock,
        setup.imu.status.ready,
        count,
        lambda taken: check_cancelled(),
        corrected=corrected,
    )
    if parts is None:
        raise DeviceFaultError(
            f"IMU: no rest without a gap within {_WITHIN:g} s of its restart; check cable, power and port"
        )
    return mean_at_rest(np.concatenate([part.counts for part in parts])) * to_si(model)


def read_contiguous(
    imu: Imu,
    clock: Clock,
    ready: int,
    count: int,
    check_cancelled: Callable[[int], None] = lambda taken: None,
    *,
    corrected: bool = False,
) -> list[SampleBatch] | None:
    """`count` samples or a few more of a unit that is ready, none missing; None where they do not come within 60 s.

    One that restarts meanwhile has fallen back to its raw output, or to none, so it is told again.

    hear : told how many there are, from time to time
    corrected : with the unit's registers applied
    """
    imu.start(corrected=corrected)
    heard = clock.now()
    deadline = heard + _WITHIN
    parts: list[SampleBatch] = []
    last, noisy = np.empty(0, np.int64), False
    while (taken := sum(map(len, parts))) < count:
        check_cancelled(taken)
        if clock.now() > deadline:
            return None
        clock.sleep(_TICK)
        lost = clock.now() - heard > NO_DATA
        try:
            batch = imu.read()
        except NoFramesError:
            if noisy:
                raise
            lost = noisy = True
        else:
            if len(batch):
                seq, last, heard = np.concatenate([last, batch.seq]), batch.seq[-1:], clock.now()
                awake = not ready or bool((batch.status & ready).all())
                noisy, lost = False, bool((np.diff(seq) != 1).any()) or bool(parts and not awake)
                if awake and not lost:
                    parts.append(batch)
        if lost:
            parts.clear()
            imu.wake(partial(check_cancelled, 0), corrected=corrected)
            last, heard = last[:0], clock.now()
    return parts
