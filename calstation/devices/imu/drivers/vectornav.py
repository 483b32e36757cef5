"""Driver of VectorNav IMUs (VN-100) with a binary or text stream; commands are lines $VN...*checksum."""

from collections.abc import Iterator

from calstation.devices.codecs import CHECK_WIDTHS, Reply, ReplyKind, check_function, number
from calstation.devices.imu.registered_imu import ATTEMPTS, RegisteredImu
from calstation.devices.imu.streamed_imu import ImuRefusalError
from calstation.devices.imu.text_frames import TextLine
from calstation.devices.interfaces import ImuIdentity
from calstation.devices.links import Link, Transaction
from calstation.devices.profiles import CrcSection, FrameSection, ImuProfile, RegisterEntry
from calstation.devices.profiles.imu_protocols.vectornav import VectorNavProtocol
from calstation.errors import DeviceFaultError
from calstation.messages import Text, known

#: Largest size of a reply in bytes.
_MAX_REPLY_SIZE = 512
#: Registers of the model, the serial number and the firmware.
_IDENTITY = (1, 3, 4)


class LineReply(TextLine):
    """Lines of text that reply to commands."""

    def __init__(self, section: VectorNavProtocol) -> None:
        crc = CrcSection(kind=section.check, start=1)
        super().__init__(FrameSection(format="text", sync="$VN", fields=[], crc=crc, max_size=_MAX_REPLY_SIZE))

    def reply(self, packet: bytes) -> Reply:
        """Return the text of the line between $ and *."""
        return Reply(0, self.body(packet)[1:])


def line(words: str, check: str) -> bytes:
    """Return the bytes of a command line."""
    value = check_function(check)(words.encode("ascii"))
    return f"${words}*{value:0{2 * CHECK_WIDTHS[check]}X}\r\n".encode("ascii")


class VectorNavImu(RegisteredImu):
    """Driver of a VectorNav IMU. A register entry is one register of the unit with all its fields."""

    def __init__(self, link: Link, profile: ImuProfile, serial: str = "") -> None:
        self._section = profile.section_of(VectorNavProtocol)
        super().__init__(link, profile)

    @staticmethod
    def reply_kind(profile: ImuProfile) -> ReplyKind:
        """Return the kind of packets that reply to commands."""
        return LineReply(profile.section_of(VectorNavProtocol))

    def _start_stream(self, *, corrected: bool) -> None:
        section = self._profile.corrected if corrected else None
        for words in self._section.start if section is None else section.start:
            self._ask(words)

    def _ask_identity(self, attempts: int = ATTEMPTS) -> ImuIdentity:
        answers = [self._ask(f"VNRRG,{register}", attempts=attempts) for register in _IDENTITY]
        return ImuIdentity(*(",".join(fields).strip() for fields in answers))

    def _write_flash(self) -> None:
        self._ask("VNWNV", timeout=self._commit_timeout, attempts=1)

    def _restart(self) -> None:
        self._ask("VNRST", attempts=1)

    def _read_entry(self, entry: RegisterEntry) -> list[float]:
        fields = self._ask(f"VNRRG,{entry.address}")
        kind = number(entry.type)
        try:
            numbers = [kind.nearest(float(field)) for field in fields]
        except ValueError:
            numbers = []
        if len(numbers) != len(entry.names):
            values = {"answer": ",".join(fields), "expected": len(entry.names)}
            raise DeviceFaultError("imu.answer_numbers", address=entry.address, **values)
        return numbers

    def _write_entry(self, entry: RegisterEntry, numbers: list[float]) -> None:
        written = ",".join(f"{value:.{self._section.digits}G}" for value in numbers)
        self._ask(f"VNWRG,{entry.address},{written}")

    def _ask(self, words: str, *, timeout: float | None = None, attempts: int = ATTEMPTS) -> list[str]:
        """Send a line; return the fields of the reply that follow the repeated command and register number."""
        return self._send(self._transaction(words), attempts, timeout)

    def _other_transactions(self) -> Iterator[Transaction[list[str]]]:
        for register in (*_IDENTITY, *(entry.address for entry in self._registers.entries)):
            yield self._transaction(f"VNRRG,{register}")

    def _transaction(self, words: str) -> Transaction[list[str]]:
        command, *rest = words.split(",")
        begins = [command, *(rest[:1] if command in ("VNRRG", "VNWRG") else [])]

        def parse(reply: Reply) -> list[str] | None:
            fields = reply.payload.decode("ascii", "replace").split(",")
            if fields[0] == "VNERR":
                raise ImuRefusalError("imu.line_refused", line=words, reason=_meaning(fields[1:]))
            is_reply = (fields[0], *(field.lstrip("0") for field in fields[1 : len(begins)])) == signature
            return fields[len(begins) :] if is_reply else None

        signature = (command, *(register.lstrip("0") for register in begins[1:]))
        return Transaction(line(words, self._section.check), signature, parse)


def _meaning(fields: list[str]) -> Text:
    """Return the meaning of a hexadecimal error code (VN-100 User Manual UM001, section 3.8)."""
    code = fields[0] if fields else ""
    try:
        value = int(code, 16)
    except ValueError:
        value = -1
    kind = value if known(f"imu.vectornav_{value}") else "other"
    return Text.of(f"imu.vectornav_{kind}", number=code)


DRIVER = VectorNavImu
