"""Driver of VectorNav's IMUs (VN-100): a binary or text stream, and commands in lines $VN...*check."""

from collections.abc import Iterator

from calstation.devices import ImuIdentity
from calstation.devices.codecs import CHECK_WIDTHS, Reply, check_function, number
from calstation.devices.imu.registered_imu import RegisteredImu
from calstation.devices.imu.streamed_imu import ImuRefusalError, Question
from calstation.devices.imu.text_frames import TextLine
from calstation.devices.links import SerialLink
from calstation.devices.profiles import CrcSection, FrameSection, ImuProfile, RegisterEntry, VectorNavSection
from calstation.errors import DeviceFaultError
from calstation.messages import Text

_ATTEMPTS = 3
#: Largest size of a reply in bytes.
_LONGEST = 512
#: Registers of the identity.
_MODEL, _SERIAL, _FIRMWARE = 1, 3, 4
#: Errors by their codes (VN-100 User Manual UM001, section 3.8).
_ERRORS = {
    0x01: Text("imu.vectornav_1"),
    0x02: Text("imu.vectornav_2"),
    0x03: Text("imu.vectornav_3"),
    0x04: Text("imu.vectornav_4"),
    0x05: Text("imu.vectornav_5"),
    0x06: Text("imu.vectornav_6"),
    0x07: Text("imu.vectornav_7"),
    0x08: Text("imu.vectornav_8"),
    0x09: Text("imu.vectornav_9"),
    0x0A: Text("imu.vectornav_10"),
    0x0B: Text("imu.vectornav_11"),
    0x0C: Text("imu.vectornav_12"),
    0xFF: Text("imu.vectornav_255"),
}


class LineReply:
    """Lines that answer commands; meets `packets.ReplyKind`.

    Parameters
    ----------
    section : the profile's
    """

    sync = b"$VN"

    def __init__(self, section: VectorNavSection) -> None:
        crc = CrcSection(kind=section.check, start=1)
        shape = FrameSection(format="text", sync="$VN", fields=[], crc=crc, max_size=_LONGEST)
        self._line = TextLine(self.sync, shape)

    def size(self, buffer: bytes, start: int) -> int | None:
        """See `packets.PacketKind`."""
        return self._line.size(buffer, start)

    def is_valid(self, packet: bytes) -> bool:
        """See `packets.PacketKind`."""
        return self._line.is_valid(packet)

    def reply(self, packet: bytes) -> Reply:
        """The line's words between $ and *."""
        return Reply(0, self._line.body(packet)[1:])


def line(words: str, check: str) -> bytes:
    """The bytes of a command."""
    value = check_function(check)(words.encode("ascii"))
    return f"${words}*{value:0{2 * CHECK_WIDTHS[check]}X}\r\n".encode("ascii")


class VectorNavImu(RegisteredImu):
    """The IMU of a profile on a link. A register entry is one register of the unit with all its fields.

    Parameters
    ----------
    link : open port
    profile : IMU profile
    """

    def __init__(self, link: SerialLink, profile: ImuProfile) -> None:
        assert profile.vectornav is not None
        self._section = profile.vectornav
        super().__init__(
            link,
            profile,
            LineReply(self._section),
            commit_timeout=self._section.commit_timeout_s,
            reset_timeout=self._section.reset_timeout_s,
        )

    def _switch_on(self, *, corrected: bool) -> None:
        section = self._profile.corrected if corrected else None
        for words in self._section.start if section is None else section.start:
            self._ask(words)

    def _ask_identity(self, attempts: int = _ATTEMPTS) -> ImuIdentity:
        words = [
            ",".join(self._ask(f"VNRRG,{register}", attempts=attempts)).strip()
            for register in (_MODEL, _SERIAL, _FIRMWARE)
        ]
        return ImuIdentity(*words)

    def _burn(self) -> None:
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
            raise DeviceFaultError(
                "imu.answer_numbers",
                address=entry.address,
                answer=",".join(fields),
                expected=len(entry.names),
            )
        return numbers

    def _write_entry(self, entry: RegisterEntry, numbers: list[float]) -> None:
        written = ",".join(f"{value:.{self._section.digits}G}" for value in numbers)
        self._ask(f"VNWRG,{entry.address},{written}")

    def _ask(self, words: str, *, timeout: float | None = None, attempts: int = _ATTEMPTS) -> list[str]:
        """Send a line and wait for the one that repeats its command and register; its further fields."""
        return self.exchange(self._question(words), timeout=timeout or self._section.timeout_s, attempts=attempts)

    def _other_questions(self) -> Iterator[Question[list[str]]]:
        """Questions for the content of its registers."""
        for register in (_MODEL, _SERIAL, _FIRMWARE, *(entry.address for entry in self._registers.entries)):
            yield self._question(f"VNRRG,{register}")

    def _question(self, words: str) -> Question[list[str]]:
        command, *rest = words.split(",")
        begins = [command, *(rest[:1] if command in ("VNRRG", "VNWRG") else [])]

        def take(reply: Reply) -> list[str] | None:
            fields = reply.payload.decode("ascii", "replace").split(",")
            if fields[0] == "VNERR":
                raise ImuRefusalError("imu.line_refused", line=words, reason=_meaning(fields[1:]))
            if fields[0] != begins[0] or not _same_register(fields[1:2], begins[1:]):
                return None
            return fields[len(begins) :]

        signature = (command, *(register.lstrip("0") for register in begins[1:]))
        return Question(line(words, self._section.check), signature, take)


def _same_register(found: list[str], asked: list[str]) -> bool:
    """Whether the register numbers are equal, leading zeros ignored."""
    return not asked or (bool(found) and found[0].lstrip("0") == asked[0].lstrip("0"))


def _meaning(fields: list[str]) -> Text:
    """What an error's hexadecimal code means."""
    code = fields[0] if fields else ""
    try:
        known = _ERRORS.get(int(code, 16))
    except ValueError:
        known = None
    return known or Text.of("imu.vectornav_other", number=code)
