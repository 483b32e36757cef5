"""Base class of IMU drivers with calibration registers, which commits registers and verifies restarts of the unit.

After a commit, the registers have the same values before and after a restart. If the unit replied to the reset without
restarting, or restarted later, its memory would be mistaken for its flash. Therefore a marker, which only a restart
removes, is written to the memory but not to flash.
"""

import time
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass
from typing import TypeVar

from calstation.devices.codecs import SENSORS, matrix_elements, number
from calstation.devices.imu.registers import RegisterMap, bitwise_equal
from calstation.devices.imu.streamed_imu import ImuBusyError, ImuRefusalError, StreamedImu
from calstation.devices.interfaces import ImuIdentity, OtherModelError
from calstation.devices.links import Link, Transaction
from calstation.devices.profiles import ImuProfile, ImuProtocol, RegisterEntry
from calstation.errors import DeviceFaultError

T = TypeVar("T")

#: Interval at which the driver checks whether a unit has executed a command, host time in s.
POLL_INTERVAL = 0.02

#: Maximum number of times that a request without a reply is sent.
ATTEMPTS = 3


class RegisteredImu(StreamedImu):
    """An IMU with registers, which are accessed by commands on its link; the protocol's section has the timeouts."""

    def __init__(self, link: Link, profile: ImuProfile, serial: str = "") -> None:
        super().__init__(link, profile, serial)
        times = profile.section_of(ImuProtocol)
        self._registers = RegisterMap(tuple(profile.registers))
        self._timeout, self._commit_timeout = times.timeout_s, times.commit_timeout_s
        self._reset_timeout = times.reset_timeout_s
        self._streaming = False
        self._commit_deadline = 0.0

    def start(self, *, corrected: bool = False) -> None:
        """Start the stream; see `Imu.start`."""
        self._start_stream(corrected=corrected)
        self._streaming = True
        section = self._profile.corrected
        frame = section.frame if section is not None and corrected else None
        self._decode_from(frame or self._profile.frame)

    def wake(self, check_cancelled: Callable[[], None], *, corrected: bool = False) -> ImuIdentity:
        """Identify the unit; see `Imu.wake`.

        Raises OtherModelError immediately, and any other DeviceFaultError only after `reset_timeout_s`.
        """
        deadline = time.monotonic() + self._reset_timeout
        while True:
            check_cancelled()
            self._reset_noise_count()
            try:
                self._ask_identity(attempts=1)
                identity = self.identify()
                self.start(corrected=corrected)
                return identity
            except OtherModelError:
                raise
            except DeviceFaultError:
                if self.lost or time.monotonic() > deadline:
                    raise
            time.sleep(POLL_INTERVAL)

    def identify(self) -> ImuIdentity:
        """Return the model, serial number and firmware. Raises OtherModelError if another model replies."""
        identity = self._ask_identity()
        if self._profile.model not in identity.model:
            raise OtherModelError("imu.other_model", found=identity.model, expected=self._profile.model)
        return identity

    def read_registers(self) -> dict[str, float]:
        """Return the calibration registers by parameter, SI."""
        with self._quiet():
            return self._registers.decode({e.key: self._read_entry(e) for e in self._registers.entries})

    def write_registers(self, values: Mapping[str, float]) -> None:
        """Write values by parameter name, SI, and keep all others. Raises DeviceFaultError for a value out of range."""
        missing = [name for name in self._registers.parameters if name not in values]
        present = self.read_registers() if missing else {}
        numbers = self._registers.encode({**present, **values})
        with self._quiet():
            for entry in self._registers.entries:
                self._write_entry(entry, numbers[entry.key])

    def commit(self) -> None:
        """Write the registers to flash exactly once, within `commit_timeout_s`; a lost reply is a fault."""
        self._commit_deadline = time.monotonic() + self._commit_timeout
        with self._quiet():
            self._write_flash()
        self._commit_deadline = 0.0

    def reset(self) -> None:
        """Restart the unit after any pending commit and resume the stream, within `reset_timeout_s`."""
        self._wait_for_commit()
        marker = self._write_marker()
        deadline = time.monotonic() + self._reset_timeout
        try:
            self._restart()
        except ImuRefusalError:
            raise
        except DeviceFaultError:  # a unit that restarts immediately has no time to reply
            if self.lost:
                raise
        while not self._restarted(marker, is_last=time.monotonic() > deadline):
            time.sleep(POLL_INTERVAL)
        if self._streaming:
            self.start()

    def _wait_for_commit(self) -> None:
        """Wait for an unconfirmed commit, because a restart during a commit could destroy old and new registers."""
        if not self._commit_deadline:
            return
        time.sleep(max(0.0, self._commit_deadline - time.monotonic()))
        if self._is_busy():
            raise ImuBusyError("imu.flash_busy", seconds=self._commit_timeout)
        self._commit_deadline = 0.0

    def _write_marker(self) -> "RestartMarker | None":
        """Write the marker once the flash is idle, and return it; None if the unit has no registers."""
        entry = marker_entry(self._registers.entries)
        if entry is None:
            return None
        with self._quiet():
            self._retry_while_busy(self._check_idle)
            before = self._retry_while_busy(lambda: self._read_entry(entry))
            self._retry_while_busy(lambda: self._write_entry(entry, marker_numbers(entry, before)))
            read_back = self._retry_while_busy(lambda: self._read_entry(entry))
        if bitwise_equal(before, read_back):
            raise DeviceFaultError("imu.not_writable", addresses=entry.label)
        return RestartMarker(entry, tuple(before), tuple(read_back))

    def _retry_while_busy(self, work: Callable[[], T]) -> T:
        """Repeat an operation while the busy unit refuses it, at most for the commit timeout."""
        deadline = time.monotonic() + self._commit_timeout
        while True:
            try:
                return work()
            except ImuBusyError:
                if time.monotonic() > deadline:
                    raise
            time.sleep(POLL_INTERVAL)

    def _restarted(self, marker: "RestartMarker | None", *, is_last: bool) -> bool:
        """Return whether the unit replies without the marker; raise DeviceFaultError instead of False if `is_last`."""
        try:
            self._ask_identity(attempts=1)
            if marker is None:
                return True
            with self._quiet():
                numbers = self._read_entry(marker.entry)
        except DeviceFaultError:
            if self.lost or is_last:
                raise
            return False
        if not bitwise_equal(marker.read_back, numbers):
            return True
        if is_last:
            with suppress(DeviceFaultError), self._quiet():
                self._write_entry(marker.entry, list(marker.before))
            raise DeviceFaultError("imu.not_restarted", seconds=self._reset_timeout)
        return False

    def _send(self, transaction: Transaction[T], attempts: int = ATTEMPTS, timeout: float | None = None) -> T:
        """Send a command and return the content of its reply; the default timeout is that of the protocol."""
        return self.exchange(transaction, timeout=timeout or self._timeout, attempts=attempts)

    def _quiet(self) -> AbstractContextManager[None]:
        """Return a context for register access, in which the stream is off if the unit requires it."""
        return nullcontext()

    @abstractmethod
    def _start_stream(self, *, corrected: bool) -> None:
        """Command the unit to start its stream."""

    @abstractmethod
    def _ask_identity(self, attempts: int = ATTEMPTS) -> ImuIdentity:
        """Query the unit's identity without checking its model."""

    @abstractmethod
    def _read_entry(self, entry: RegisterEntry) -> list[float]:
        """Read the numbers in an entry's registers."""

    @abstractmethod
    def _write_entry(self, entry: RegisterEntry, numbers: list[float]) -> None:
        """Write numbers to an entry's registers."""

    @abstractmethod
    def _write_flash(self) -> None:
        """Send a single command that writes the registers to flash, and wait until it is executed."""

    def _is_busy(self) -> bool:
        return False

    def _check_idle(self) -> None:
        """Raise ImuBusyError if the unit reports that its flash is busy."""

    @abstractmethod
    def _restart(self) -> None:
        """Send a single restart command to the unit."""


#: Candidates for the marker as fractions of a register's range; at least one differs from the current value.
_FRACTIONS = (0.381966, 0.618034)

_MATRIX = frozenset(element for sensor in SENSORS for element in matrix_elements(sensor))


@dataclass(frozen=True)
class RestartMarker:
    """A register entry written without a commit.

    before : numbers before the write
    read_back : numbers that are read back until the unit restarts
    """

    entry: RegisterEntry
    before: tuple[float, ...]
    read_back: tuple[float, ...]


def marker_entry(entries: Sequence[RegisterEntry]) -> RegisterEntry | None:
    """Return the entry for the marker, preferably one without matrix elements, because a unit might invert a matrix."""
    return min(entries, key=lambda entry: not _other_indices(entry), default=None)


def marker_numbers(entry: RegisterEntry, before: Sequence[float]) -> list[float]:
    """Return numbers in the range of an entry that differ from the current ones; in a matrix, change only the last."""
    free = _other_indices(entry) or [len(entry.names) - 1]
    kind = number(entry.type)
    numbers = list(before)
    for i in free:
        low, high = (edge / entry.scale for edge in entry.range)
        current = before[i] if before[i] == before[i] else low
        numbers[i] = kind.nearest(max((low + p * (high - low) for p in _FRACTIONS), key=lambda v: abs(v - current)))
    return numbers


def _other_indices(entry: RegisterEntry) -> list[int]:
    return [i for i, name in enumerate(entry.names) if name and name not in _MATRIX]
