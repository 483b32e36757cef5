"""Driver of an IMU whose samples and command replies are binary frames on one serial link."""

import struct
from collections.abc import Iterator

from calstation.devices.codecs import CRC_WIDTHS, Reply, ReplyKind, check_bytes, number
from calstation.devices.imu.registered_imu import ATTEMPTS, RegisteredImu
from calstation.devices.imu.streamed_imu import ImuBusyError, ImuRefusalError
from calstation.devices.interfaces import ImuIdentity, OtherModelError
from calstation.devices.links import Link, Transaction
from calstation.devices.profiles import FrameSection, ImuProfile, RegisterEntry, hex_bytes
from calstation.devices.profiles.imu_protocols.framed import OPS, FramedProtocol
from calstation.errors import DeviceFaultError
from calstation.messages import Text, known

_REPLY_HEADER = 2  # op, payload length
_VALUES_PER_TRANSFER = 32
_MAX_PAYLOAD = 255


class CommandReply:
    """Replies of the framed link, of the form sync | op u8 | n u8 | n bytes | checksum over op to payload."""

    def __init__(self, commands: FramedProtocol, frame: FrameSection) -> None:
        self.sync = hex_bytes(commands.reply_sync)
        self._crc, self._width = commands.crc, CRC_WIDTHS[commands.crc]
        self._order = frame.byte_order

    def size(self, buffer: bytes, start: int) -> int | None:
        """Return the size of the reply at `start`; see `PacketKind`."""
        header = len(self.sync)
        if len(buffer) - start < header + _REPLY_HEADER:
            return None
        return header + _REPLY_HEADER + buffer[start + header + 1] + self._width

    def is_valid(self, packet: bytes) -> bool:
        """Return whether the checksum of a reply is correct."""
        body = packet[len(self.sync) : -self._width]
        return check_bytes(self._crc, body, self._order) == packet[-self._width :]

    def reply(self, packet: bytes) -> Reply:
        """Return the op code and payload of a reply."""
        body = packet[len(self.sync) : -self._width]
        return Reply(body[0], body[_REPLY_HEADER:])


def command_frame(commands: FramedProtocol, frame: FrameSection, op: int, payload: bytes) -> bytes:
    """Return the bytes of a request, which are sync, op, length, payload and checksum.

    Parameters
    ----------
    commands, frame : section of the protocol, and frame section with the byte order
    op, payload : op code and payload of the command
    """
    body = bytes([op, len(payload)]) + payload
    return hex_bytes(commands.request_sync) + body + check_bytes(commands.crc, body, frame.byte_order)


class FramedImu(RegisteredImu):
    """Driver of an IMU with framed commands.

    A register request consists of address u16, count u8 and, for a write, the numbers.
    """

    def __init__(self, link: Link, profile: ImuProfile, serial: str = "") -> None:
        self._commands = profile.section_of(FramedProtocol)
        super().__init__(link, profile)

    @staticmethod
    def reply_kind(profile: ImuProfile) -> ReplyKind:
        """Return the kind of packets that reply to commands."""
        return CommandReply(profile.section_of(FramedProtocol), profile.frame)

    def read_words(self, address: int, count: int) -> list[int]:
        """Read 16-bit registers of the axes of an inertial system. Raises DeviceFaultError."""
        head = struct.pack(self._format("HB"), address, count)
        answer = self._ask("read_words", head, head)
        if len(answer) != len(head) + 2 * count:
            raise DeviceFaultError("table.answer_length", address=address, last=address + count - 1)
        return list(struct.unpack(self._format(f"{count}H"), answer[len(head) :]))

    def write_words(self, address: int, values: list[int], repeat: bool) -> None:
        """Write 16-bit registers of the axes of an inertial system. Raises DeviceFaultError.

        Parameters
        ----------
        address, values : 0-based address of the first register, and unsigned 16-bit values
        repeat : whether the request is sent again after a lost reply
        """
        head = struct.pack(self._format("HB"), address, len(values))
        body = struct.pack(self._format(f"{len(values)}H"), *values)
        transaction = self._transaction("write_words", head + body, head)
        attempts = ATTEMPTS if repeat else 1
        self.exchange(transaction, timeout=self._timeout, attempts=attempts, urgent=repeat)

    def _start_stream(self, *, corrected: bool) -> None:
        section = self._profile.corrected if corrected else None
        kind = 1 if section is None or section.stream is None else section.stream
        self._ask("stream", bytes([kind]))

    def _ask_identity(self, attempts: int = ATTEMPTS) -> ImuIdentity:
        text = self._ask("identify", b"", attempts=attempts).decode("ascii", errors="replace")
        parts = [part.strip() for part in text.split(";")]
        if len(parts) != 3:
            raise OtherModelError("imu.identity_malformed", found=text, expected="model;serial;firmware")
        return ImuIdentity(*parts)

    def _write_flash(self) -> None:
        answer = self._ask("commit", b"", attempts=1, timeout=self._commit_timeout)
        if answer[:1] != b"\x00":
            raise DeviceFaultError("imu.commit_refused")

    def _restart(self) -> None:
        self._ask("reset", b"", attempts=1)

    def _read_entry(self, entry: RegisterEntry) -> list[float]:
        kind, order = number(entry.type), entry.byte_order or self._profile.frame.byte_order
        numbers: list[float] = []
        for address, _, count in self._transfers(entry):
            head = struct.pack(self._format("HB"), address, count)
            answer = self._ask("read", head, head)
            expected = len(head) + kind.width * count
            if len(answer) != expected:
                raise DeviceFaultError("imu.answer_size", address=address, size=len(answer), expected=expected)
            body = answer[len(head) :]
            parts = (body[k : k + kind.width] for k in range(0, len(body), kind.width))
            numbers += [kind.unpack(part, order, entry.word_order) for part in parts]
        return numbers

    def _write_entry(self, entry: RegisterEntry, numbers: list[float]) -> None:
        kind, order = number(entry.type), entry.byte_order or self._profile.frame.byte_order
        for address, begin, count in self._transfers(entry):
            head = struct.pack(self._format("HB"), address, count)
            part = numbers[begin : begin + count]
            body = b"".join(kind.pack(value, order, entry.word_order) for value in part)
            if self._ask("write", head + body, head) != head:
                raise DeviceFaultError("imu.not_taken", address=address)

    def _transfers(self, entry: RegisterEntry) -> list[tuple[int, int, int]]:
        """Return the address, the index of the first number and the count for each transfer of an entry."""
        max_count = min(_VALUES_PER_TRANSFER, (_MAX_PAYLOAD - 3) // number(entry.type).width)
        total = len(entry.names)
        return [(entry.address_of(begin), begin, min(max_count, total - begin)) for begin in range(0, total, max_count)]

    def _format(self, codes: str) -> str:
        return ("<" if self._profile.frame.byte_order == "little" else ">") + codes

    def _ask(
        self, name: str, payload: bytes, begins: bytes = b"", attempts: int = ATTEMPTS, timeout: float | None = None
    ) -> bytes:
        return self._send(self._transaction(name, payload, begins), attempts, timeout)

    def _other_transactions(self) -> Iterator[Transaction[bytes]]:
        """Yield the identity query, followed by register reads of decreasing length."""
        yield self._transaction("identify", b"", b"")
        transfers = [part for entry in self._registers.entries for part in self._transfers(entry)]
        for shorter in range(max((count for _, _, count in transfers), default=0)):
            for address, _, count in transfers:
                if count > shorter:
                    head = struct.pack(self._format("HB"), address, count - shorter)
                    yield self._transaction("read", head, head)

    def _transaction(self, name: str, payload: bytes, begins: bytes) -> Transaction[bytes]:
        ops = {**OPS, **self._commands.ops}
        op = ops[name]

        def parse(reply: Reply) -> bytes | None:
            if reply.op == ops["error"]:
                code = reply.payload[0] if reply.payload else 0
                error = ImuBusyError if code in self._commands.busy_codes else ImuRefusalError
                raise error("imu.command_refused", command=name, reason=self._meaning(code))
            return reply.payload if reply.op == op and reply.payload.startswith(begins) else None

        request = command_frame(self._commands, self._profile.frame, op, payload)
        return Transaction(request, (op, begins), parse)

    def _meaning(self, code: int) -> Text:
        meaning = self._commands.errors.get(str(code))
        if meaning is not None:
            busy = code in self._commands.busy_codes
            return Text.of("imu.framed_own_busy" if busy else "imu.framed_own", meaning=meaning)
        usual = not self._commands.errors and known(f"imu.framed_{code}")
        return Text.of(f"imu.framed_{code if usual else 'other'}", number=code)


DRIVER = FramedImu
