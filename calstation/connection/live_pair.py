"""Live streams of the IMUs on one body, aligned in time even after restarts and lost links."""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np

from calstation.config import PairConfiguration, RunConfiguration
from calstation.connection.devices import endpoints, open_imu
from calstation.devices import OtherModelError, SampleBatch
from calstation.devices.profiles import StatusSection
from calstation.errors import CalstationError, ConfigurationError, DeviceFaultError, StoppedError
from calstation.estimation.common import SampleBlock
from calstation.estimation.pairs import Alignment, PairAligner
from calstation.results import PairSession
from calstation.sequencer import Clock

#: Time without samples after which a unit is woken up or its port is opened again, and interval between attempts, s.
_WAKE_TIMEOUT = 2.0
#: Number of polls from which the relation of host time to station time is determined.
_POLLS = 400
#: Time without samples of any unit after which the monitoring ends, s.
_SILENCE_TIMEOUT = 20.0

logger = logging.getLogger(__name__)


class _LiveImu:
    """An IMU at its port, which is woken up or opened again in a thread while other units are read."""

    def __init__(self, setup: RunConfiguration, port: str) -> None:
        self._setup, self._port = setup, port
        self.imu = open_imu(setup, port)
        self._closing = threading.Event()
        self._wake_thread: threading.Thread | None = None
        self._restarts, self._reopened = 0, False
        self._fault: str | None = None
        self._other_unit: DeviceFaultError | None = None
        self.has_sent = False  #: Whether the unit has sent samples.
        try:
            self.serial = self.imu.identify().serial
            self.imu.start()
        except BaseException:
            self.imu.close()
            raise
        self.last_data: float | None = None

    def read(self, now: float) -> SampleBatch | None:
        """Return new samples, or None if there are none; `now` is the station time, s.

        While the unit is being woken up, its samples are not returned until its identity is known. Raises
        DeviceFaultError if another unit replies.
        """
        self.last_data = now if self.last_data is None else self.last_data
        if self._wake_thread is not None and self._wake_thread.is_alive():
            return None
        if self._other_unit is not None:
            raise self._other_unit
        try:
            batch, fault = self.imu.read(), None
        except DeviceFaultError as error:
            batch, fault = None, str(error)
        if fault is not None and fault != self._fault:
            logger.warning("%s: %s", self._port, fault)
        self._fault = fault
        if batch is not None and len(batch):
            self.last_data, self.has_sent = now, True
            return batch
        if now - self.last_data > _WAKE_TIMEOUT and not self._closing.is_set():
            self.last_data = now
            self._wake_thread = threading.Thread(target=self._wake, name="imu-revival", daemon=True)
            self._wake_thread.start()
        return None

    def restarted(self) -> bool:
        """Return whether the unit has restarted or its port has been opened again since the last call."""
        before, self._restarts = self._restarts, self.imu.stats.restarts
        reopened, self._reopened = self._reopened, False
        return reopened or self._restarts > before

    def close(self) -> None:
        self._closing.set()
        if self._wake_thread is not None:
            self._wake_thread.join(10.0)
        self.imu.close()

    def _wake(self) -> None:
        try:
            if self.imu.lost:
                self.imu.close()
                self.imu = open_imu(self._setup, self._port)
                self._restarts, self._reopened = 0, True
            identity = self.imu.wake(self._check_closing)
            if identity is not None and identity.serial != self.serial:
                self._other_unit = DeviceFaultError("connection.other_imu", port=self._port, found=identity.serial)
        except OtherModelError as error:
            self._other_unit = error
        except CalstationError as error:
            logger.info("%s: %s", self._port, error)

    def _check_closing(self) -> None:
        if self._closing.is_set():
            raise StoppedError("cli.stopped")


class LivePair:
    """Open IMUs on one body, and the session that monitors them."""

    def __init__(
        self, session: PairSession, units: list[_LiveImu], statuses: list[StatusSection], clock: Clock
    ) -> None:
        self.session = session
        self._units, self._statuses, self._clock = units, statuses, clock
        context = session.context
        self._end = 0.0
        #: Host time and station time of the last polls, s: a virtual bench may be slower than its nominal speed.
        self._polls: deque[tuple[float, float]] = deque(maxlen=_POLLS)
        self._aligner = PairAligner(context.imu, [s.imu for s in context.secondaries])
        session.watch.unaligned = frozenset(s.number for s in context.secondaries)

    def alignments(self) -> dict[int, Alignment]:
        """Return the alignment of each secondary at the newest sample, by the number of the secondary."""
        secondaries = self.session.context.secondaries
        return {
            s.number: clock.alignment(self._end) for s, clock in zip(secondaries, self._aligner.clocks, strict=True)
        }

    def blocks(self, seconds: float | None, stopped: Callable[[], bool]) -> Iterator[SampleBlock]:
        """Yield aligned samples for `seconds` of the primary's time, or until `stopped` returns True.

        Raises DeviceFaultError if no unit sends samples, if a unit has sent no samples since the start, or if a unit
        was replaced.
        """
        begin: float | None = None
        start = last_data = self._clock.now()
        while not stopped():
            self._clock.sleep(self._clock.tick)
            now = self._clock.now()
            self._polls.append((time.monotonic(), now))
            for number, unit in enumerate(self._units):
                batch = unit.read(now)
                if batch is not None:
                    last_data = now
                    self._feed(number, unit, batch)
            if now - last_data > _SILENCE_TIMEOUT:
                raise DeviceFaultError("connection.all_silent", seconds=_SILENCE_TIMEOUT)
            if now - start > _SILENCE_TIMEOUT:
                for number, unit in enumerate(self._units, 1):
                    if not unit.has_sent:
                        raise DeviceFaultError("connection.imu_silent", number=number, seconds=_SILENCE_TIMEOUT)
            block, aligned = self._aligner.take(now)
            if not len(block):
                continue
            end = self._end = float(block.time[-1])
            yield block  # the block has been aligned with the previous offsets
            self._report_alignment(end, aligned)
            begin = float(block.time[0]) if begin is None else begin
            if seconds is not None and end - begin >= seconds:
                return

    def _report_alignment(self, time: float, aligned: list[int]) -> None:
        """Report to the session which secondaries have been aligned again, and which are no longer aligned."""
        watch = self.session.watch
        for index, secondary in enumerate(self.session.context.secondaries):
            number, clock = secondary.number, self._aligner.clocks[index]
            if index in aligned:
                watch.realigned(number, time, float(clock.offset(time)), clock.sigma(time))
            elif not clock.locked and number not in watch.unaligned:
                watch.lost_alignment(number, time)

    def _feed(self, number: int, unit: _LiveImu, batch: SampleBatch) -> None:
        status = self._statuses[number]
        usable = (batch.status & status.ready == status.ready) & (
            batch.status & (status.saturated | status.failed) == 0
        )
        counts = np.where(usable[:, None], batch.counts, np.nan)
        host, station = np.transpose(self._polls)
        # at full speed, the bench's time advances only between two polls
        arrival = np.interp(batch.arrival, host, station) if self._clock.speed else np.full(len(batch), station[-1])
        self._aligner.feed(number, batch.seq, counts, arrival, restarted=unit.restarted())


@contextmanager
def open_pair(
    setup: PairConfiguration, folder: Path, check_cancelled: Callable[[], None] = lambda: None
) -> Iterator[LivePair]:
    """Open and identify all IMUs of a station, read the registers of the primary, and close all ports on exit.

    Raises DeviceFaultError or ConfigurationError.

    Parameters
    ----------
    setup : configuration of the IMUs
    folder : stored calibrations of pairs
    check_cancelled : called while a bench starts; may raise
    """
    with ExitStack() as stack:
        ports = stack.enter_context(endpoints(setup, check_cancelled))
        units = []
        for unit, port in zip(setup.units, ports.imus, strict=True):
            check_cancelled()
            units.append(_LiveImu(unit, port))
            stack.callback(units[-1].close)
        serials = [unit.serial for unit in units]
        for number, serial in enumerate(serials, 1):
            if not serial:
                raise ConfigurationError("connection.pair_serial_missing", number=number)
        ports.clock.attach(lambda: {index: unit.imu.received for index, unit in enumerate(units)})
        primary = setup.primary.imu
        registers = units[0].imu.read_registers() if primary.registers else {}
        meta = setup.log_meta(serials, registers)
        executor = stack.enter_context(ThreadPoolExecutor(1, "fit"))
        session = PairSession(meta, folder, setup.primary.sources["station"].path, executor.submit)
        yield LivePair(session, units, [unit.imu.status for unit in setup.units], ports.clock)
