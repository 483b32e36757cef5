"""What IMU drivers with calibration registers share: the map entry by entry, a commit and a restart to be sure of."""

import time
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass
from typing import TypeVar

from calstation.devices.codecs.conventions import SENSORS, matrix_slots
from calstation.devices.codecs.numbers import number
from calstation.devices.codecs.packets import ReplyKind
from calstation.devices.imu.registers import RegisterMap, alike
from calstation.devices.imu.streamed_imu import ImuBusyError, ImuRefusalError, StreamedImu
from calstation.devices.interfaces import ImuIdentity, OtherModelError
from calstation.devices.links.serial_link import SerialLink
from calstation.devices.profiles.imu import ImuProfile
from calstation.devices.profiles.imu_sections import CommandSection
from calstation.devices.profiles.registers import RegisterEntry
from calstation.errors import DeviceFaultError

T = TypeVar("T")

#: Host time between two looks whether a unit has done what it was told, s.
POLL = 0.02


class RegisteredImu(StreamedImu):
    """An IMU whose link carries commands to its registers.

    Parameters
    ----------
    link : open port
    profile : what the bytes mean
    replies : packets that answer commands
    commit_timeout : host time that burning the flash may take, s
    reset_timeout : host time for the unit to answer again after a reset, s
    """

    def __init__(
        self,
        link: SerialLink,
        profile: ImuProfile,
        replies: CommandSection | ReplyKind,
        *,
        commit_timeout: float,
        reset_timeout: float,
    ) -> None:
        super().__init__(link, profile, replies)
        self._registers = RegisterMap(tuple(profile.registers))
        self._commit_timeout, self._reset_timeout = commit_timeout, reset_timeout
        self._streaming = False
        self._burns_until = 0.0

    def start(self, *, corrected: bool = False) -> None:
        """Switch the stream on, see `interfaces.Imu`."""
        self._switch_on(corrected=corrected)
        self._streaming = True
        section = self._profile.corrected
        own = section.frame if section is not None and corrected else None
        self._expect(own or self._profile.frame)

    def wake(self, check_cancelled: Callable[[], None], *, corrected: bool = False) -> ImuIdentity:
        """Find a unit that may have restarted by itself, see `interfaces.Imu`."""
        deadline = time.monotonic() + self._reset_timeout
        while True:
            check_cancelled()
            self._forget_noise()
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
            time.sleep(POLL)

    def identify(self) -> ImuIdentity:
        """Model, serial number and firmware; raises OtherModelError where another model answers."""
        identity = self._ask_identity()
        if self._profile.model not in identity.model:
            raise OtherModelError(
                f"IMU: model '{identity.model}' answers, the profile is for '{self._profile.model}';"
                " choose the right IMU profile in the product file",
                identity.model,
                self._profile.model,
            )
        return identity

    def read_registers(self) -> dict[str, float]:
        """Calibration registers in SI by parameter."""
        with self._quiet():
            return self._registers.decode({e.key: self._read_entry(e) for e in self._registers.entries})

    def write_registers(self, values: Mapping[str, float]) -> None:
        """Write calibration registers; parameters not named keep theirs."""
        missing = [name for name in self._registers.parameters if name not in values]
        present = self.read_registers() if missing else {}
        numbers = self._registers.encode({**present, **values})
        with self._quiet():
            for entry in self._registers.entries:
                self._write_entry(entry, numbers[entry.key])

    def commit(self) -> None:
        """Write the registers to flash, once: a lost answer is a fault, never a second flash cycle."""
        self._burns_until = time.monotonic() + self._commit_timeout
        with self._quiet():
            self._burn()
        self._burns_until = 0.0

    def reset(self) -> None:
        """Restart the unit, not before its flash is burnt, and wait until it has; a stream that was on is on again.

        Raises DeviceFaultError where it does not answer again, or shows that it has not restarted.
        """
        self._outlast_commit()
        mark = self._mark()
        deadline = time.monotonic() + self._reset_timeout
        try:
            self._restart()
        except ImuRefusalError:
            raise
        except DeviceFaultError:  # one that restarts at once has no time to answer
            if self.lost:
                raise
        while not self._restarted(mark, last=time.monotonic() > deadline):
            time.sleep(POLL)
        if self._streaming:
            self.start()

    def _outlast_commit(self) -> None:
        """A commit that was not seen to end may still burn: restarted now the unit would hold neither old nor new."""
        if not self._burns_until:
            return
        time.sleep(max(0.0, self._burns_until - time.monotonic()))
        if self._burning():
            raise ImuBusyError(
                f"IMU: the unit's flash is still busy {self._commit_timeout:g} s after its commit; leave its power on"
                " until it is done, then start again"
            )
        self._burns_until = 0.0

    def _mark(self) -> "RestartMarker | None":
        """Mark the unit's memory; waits until its flash takes no time any more. None where it has no registers."""
        entry = markable(self._registers.entries)
        if entry is None:
            return None
        with self._quiet():
            self._patiently(self._check_idle)
            before = self._patiently(lambda: self._read_entry(entry))
            self._patiently(lambda: self._write_entry(entry, marked(entry, before)))
            shown = self._patiently(lambda: self._read_entry(entry))
        if alike(before, shown):
            raise DeviceFaultError(
                f"IMU: {entry} takes no value, so a restart could not be told; look at the unit's write protection"
            )
        return RestartMarker(entry, tuple(before), tuple(shown))

    def _patiently(self, work: Callable[[], T]) -> T:
        """Do what a busy unit refuses, again and again for as long as its flash may take."""
        deadline = time.monotonic() + self._commit_timeout
        while True:
            try:
                return work()
            except ImuBusyError:
                if time.monotonic() > deadline:
                    raise
            time.sleep(POLL)

    def _restarted(self, mark: "RestartMarker | None", *, last: bool) -> bool:
        """Whether it answers and the mark is gone. Raises DeviceFaultError where not and it is the `last` look."""
        try:
            self._ask_identity(attempts=1)
            if mark is None:
                return True
            with self._quiet():
                found = self._read_entry(mark.entry)
        except DeviceFaultError:
            if self.lost or last:
                raise
            return False
        if not alike(mark.shown, found):
            return True
        if last:
            with suppress(DeviceFaultError), self._quiet():
                self._write_entry(mark.entry, list(mark.before))
            raise DeviceFaultError(
                f"IMU: the unit answers but has not restarted within {self._reset_timeout:g} s of its reset, so what"
                " its flash holds is not known; switch its power off and on, then start again"
            )
        return False

    def _quiet(self) -> AbstractContextManager[None]:
        """While registers are asked: the stream is off, where the unit needs that."""
        return nullcontext()

    @abstractmethod
    def _switch_on(self, *, corrected: bool) -> None:
        """Tell the unit to stream."""

    @abstractmethod
    def _ask_identity(self, attempts: int = 3) -> ImuIdentity:
        """Who answers."""

    @abstractmethod
    def _read_entry(self, entry: RegisterEntry) -> list[float]:
        """Numbers in an entry's registers."""

    @abstractmethod
    def _write_entry(self, entry: RegisterEntry, numbers: list[float]) -> None:
        """Write numbers to an entry's registers."""

    @abstractmethod
    def _burn(self) -> None:
        """Tell the unit, once, to burn its registers, and wait until it has."""

    def _burning(self) -> bool:
        """Whether the unit, told to commit, says that it has not done so yet."""
        return False

    def _check_idle(self) -> None:
        """Raises ImuBusyError where the unit says that its flash is being burnt, whoever told it to commit."""

    @abstractmethod
    def _restart(self) -> None:
        """Tell the unit to restart, once."""


#: Of a register's range: numbers that nobody writes, of which one always differs from what is there.
_PLACES = (0.381966, 0.618034)

_MATRIX = frozenset(slot for sensor in SENSORS for slot in matrix_slots(sensor))


@dataclass(frozen=True)
class RestartMarker:
    """An entry that was written without a commit, what it held before and what it shows as long as nothing restarts."""

    entry: RegisterEntry
    before: tuple[float, ...]
    shown: tuple[float, ...]


def markable(entries: Sequence[RegisterEntry]) -> RegisterEntry | None:
    """The entry to mark: one that holds no part of a matrix, which the unit might invert, where there is one."""
    return min(entries, key=lambda entry: not _free(entry), default=None)


def marked(entry: RegisterEntry, before: Sequence[float]) -> list[float]:
    """Numbers inside the entry's range that differ from what it holds; of a matrix only what stands behind it."""
    free = _free(entry) or [len(entry.names) - 1]
    kind = number(entry.type)
    numbers = list(before)
    for i in free:
        low, high = (edge / entry.scale for edge in entry.range)
        held = before[i] if before[i] == before[i] else low
        numbers[i] = kind.nearest(max((low + p * (high - low) for p in _PLACES), key=lambda v: abs(v - held)))
    return numbers


def _free(entry: RegisterEntry) -> list[int]:
    return [i for i, name in enumerate(entry.names) if name and name not in _MATRIX]
