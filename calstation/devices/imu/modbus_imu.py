"""Driver of an IMU whose registers are asked over Modbus RTU on the same serial line that carries its stream."""

import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager

from calstation.devices.codecs.numbers import ByteOrder, WordOrder, number
from calstation.devices.codecs.packets import Reply
from calstation.devices.imu.registered_imu import POLL, RegisteredImu
from calstation.devices.imu.streamed_imu import ImuBusyError, ImuRefusalError, Question
from calstation.devices.interfaces import ImuIdentity
from calstation.devices.links.modbus_link import ACKNOWLEDGED, MEANINGS, NOT_YET
from calstation.devices.links.modbus_rtu import REFUSED, RtuReply, RtuRequest
from calstation.devices.links.serial_link import SerialLink
from calstation.devices.profiles.imu import ImuProfile
from calstation.devices.profiles.imu_sections import TextRegisters, WordCommand
from calstation.devices.profiles.registers import RegisterEntry
from calstation.errors import DeviceFaultError

_ATTEMPTS = 3
#: Registers in one transfer.
_MOST = 120

#: What to do about Modbus exceptions of a unit, by their codes.
MENDS = {
    1: "compare [modbus] of the IMU profile with the unit's manual",
    **dict.fromkeys(
        (2, 3),
        "look at its supply (a unit that restarts forgets its page), then check the registers in the IMU profile",
    ),
    4: "switch the unit off and on, then start again",
    **dict.fromkeys(NOT_YET, "wait until it is done, then start again"),
    8: "switch the unit off and on, replace it where that does not help",
    **dict.fromkeys((10, 11), "check the gateway and modbus.unit of the IMU profile"),
}


class ModbusImu(RegisteredImu):
    """The IMU of a profile on a link.

    Parameters
    ----------
    link : open port
    profile : what the bytes mean
    """

    def __init__(self, link: SerialLink, profile: ImuProfile) -> None:
        assert profile.modbus is not None
        section = self._section = profile.modbus
        self._texts = [text for text in (section.model, section.serial, section.firmware) if text is not None]
        self._word = 0
        super().__init__(
            link,
            profile,
            RtuReply(section.unit),
            commit_timeout=section.commit_timeout_s,
            reset_timeout=section.reset_timeout_s,
        )

    def _switch_on(self, *, corrected: bool) -> None:
        stream, section = self._section.stream, self._profile.corrected if corrected else None
        if stream is not None:
            self._word = stream.on if section is None or section.stream is None else section.stream
            self._write(stream.address, [self._word])

    def _ask_identity(self, attempts: int = _ATTEMPTS) -> ImuIdentity:
        section = self._section
        return ImuIdentity(
            self._text(section.model, attempts),
            self._text(section.serial, attempts),
            self._text(section.firmware, attempts) if section.firmware else "",
        )

    def _burn(self) -> None:
        self._order(self._section.commit, "commit", self._commit_timeout)

    def _burning(self) -> bool:
        return not self._done(self._section.commit)

    def _check_idle(self) -> None:
        if self._section.commit.done is not None:
            self._read(self._section.commit.address, 1)

    def _restart(self) -> None:
        self._order(self._section.reset, "reset", self._section.timeout_s)

    def _read_entry(self, entry: RegisterEntry) -> list[float]:
        self._turn_to(entry.page)
        kind = number(entry.type)
        words: list[int] = []
        total = entry.end - entry.address
        for begin in range(0, total, _MOST):
            words += self._read(entry.address + begin, min(_MOST, total - begin))
        data = struct.pack(f">{len(words)}H", *words)
        return [
            kind.unpack(data[k : k + kind.width], *self._orders(entry))
            for k in range(0, len(data), kind.width)
        ]

    def _write_entry(self, entry: RegisterEntry, numbers: list[float]) -> None:
        self._turn_to(entry.page)
        kind = number(entry.type)
        data = b"".join(kind.pack(value, *self._orders(entry)) for value in numbers)
        words = list(struct.unpack(f">{len(data) // 2}H", data))
        for begin in range(0, len(words), _MOST):
            self._write(entry.address + begin, words[begin : begin + _MOST])

    def _orders(self, entry: RegisterEntry) -> tuple[ByteOrder, WordOrder | None]:
        return entry.byte_order or self._section.byte_order, entry.word_order or self._section.word_order

    def _turn_to(self, page: int) -> None:
        if self._section.page is not None:
            self._write(self._section.page, [page])

    def _text(self, place: TextRegisters, attempts: int) -> str:
        words = self._read(place.address, place.words, attempts)
        raw = b"".join(word.to_bytes(2, "big") for word in words)
        return raw.split(b"\0")[0].decode("ascii", errors="replace").strip()

    def _order(self, command: WordCommand, what: str, timeout: float) -> None:
        """Write a command's value, once, and wait until it is done."""
        deadline = time.monotonic() + self._commit_timeout
        try:
            self._write(command.address, [command.value], attempts=1, timeout=timeout)
        except ModbusBusyError as exc:
            if exc.exception != ACKNOWLEDGED:
                raise
        else:
            if command.done is None:
                return
        while not self._done(command):
            if time.monotonic() > deadline:
                raise DeviceFaultError(
                    f"IMU: the {what} was not done within {self._commit_timeout:g} s; leave its power on until it is,"
                    " then start again"
                )
            time.sleep(POLL)

    def _done(self, command: WordCommand) -> bool:
        """Whether a unit that carries a command out has done it; it may be busy, or silent, until then."""
        place = command.address if command.done is not None else self._section.model.address
        try:
            return self._read(place, 1, attempts=1)[0] == command.done or command.done is None
        except ImuRefusalError as exc:
            if not isinstance(exc, ImuBusyError):
                raise
        except DeviceFaultError:
            if self.lost:
                raise
        return False

    @contextmanager
    def _quiet(self) -> Iterator[None]:
        """The stream is off meanwhile, where the unit needs that."""
        stream = self._section.stream
        if stream is None or stream.off is None:
            yield
            return
        self._write(stream.address, [stream.off])
        try:
            yield
        finally:
            if self._streaming and not self.lost:
                self._write(stream.address, [self._word])

    def _read(self, address: int, count: int, attempts: int = _ATTEMPTS) -> list[int]:
        data = self._ask(RtuRequest.read(self._section.unit, address, count), attempts)
        return list(struct.unpack(f">{count}H", data[1 : 1 + 2 * count]))

    def _write(
        self, address: int, values: list[int], attempts: int = _ATTEMPTS, timeout: float | None = None
    ) -> None:
        self._ask(RtuRequest.write(self._section.unit, address, values), attempts, timeout)

    def _other_questions(self) -> Iterator[Question[bytes]]:
        """Texts, whole and in part: they stand on no page."""
        longest = max(self._texts, key=lambda text: text.words)
        for words in (*(text.words for text in self._texts), *range(1, longest.words)):
            address = next((text.address for text in self._texts if text.words == words), longest.address)
            yield _question(RtuRequest.read(self._section.unit, address, words))

    def _ask(self, request: RtuRequest, attempts: int, timeout: float | None = None) -> bytes:
        timeout = timeout or self._section.timeout_s
        return self.exchange(_question(request), timeout=timeout, attempts=attempts)


class ModbusBusyError(ImuBusyError):
    """Modbus exception 5 or 6; `exception` is its number."""

    def __init__(self, text: str, reason: str, code: int) -> None:
        super().__init__(text, reason)
        self.exception = code


def _question(request: RtuRequest) -> Question[bytes]:
    """A request whose answer's data are wanted."""

    def take(reply: Reply) -> bytes | None:
        if reply.op == request.function | REFUSED:
            code = reply.payload[0]
            reason = f"{MEANINGS.get(code, f'exception {code}')} (Modbus exception {code})"
            mend = MENDS.get(code, "look this exception up in the unit's manual")
            text = f"IMU: register {request.address} is refused: {reason}; {mend}"
            raise ModbusBusyError(text, reason, code) if code in NOT_YET else ImuRefusalError(text, reason)
        mine = reply.op == request.function and reply.payload.startswith(request.begins)
        return reply.payload if mine else None

    return Question(request.frame, request.look, take)
