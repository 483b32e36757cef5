"""Driver of VectorNav's IMUs (VN-100): a stream in binary or text, commands in lines $VN...*check between it."""

from collections.abc import Iterator

from calstation.devices.codecs.frame_checks import CHECK_WIDTHS, check_function
from calstation.devices.codecs.numbers import number
from calstation.devices.codecs.packets import Reply
from calstation.devices.imu.registered_imu import RegisteredImu
from calstation.devices.imu.streamed_imu import ImuRefusalError, Question
from calstation.devices.imu.text_frames import TextLine
from calstation.devices.interfaces import ImuIdentity
from calstation.devices.links.serial_link import SerialLink
from calstation.devices.profiles.frame import CrcSection, FrameSection
from calstation.devices.profiles.imu import ImuProfile
from calstation.devices.profiles.imu_sections import VectorNavSection
from calstation.devices.profiles.registers import RegisterEntry
from calstation.errors import DeviceFaultError

_ATTEMPTS = 3
#: Bytes of a reply.
_LONGEST = 512
#: Registers that tell who answers.
_MODEL, _SERIAL, _FIRMWARE = 1, 3, 4
#: VN-100 User Manual UM001, section 3.8.
ERRORS = {
    0x01: "hard fault, the unit restarts",
    0x02: "serial buffer overflow",
    0x03: "invalid checksum",
    0x04: "invalid command",
    0x05: "not enough parameters",
    0x06: "too many parameters",
    0x07: "invalid parameter",
    0x08: "invalid register",
    0x09: "unauthorized access",
    0x0A: "watchdog reset",
    0x0B: "output buffer overflow",
    0x0C: "insufficient baud rate",
    0xFF: "error buffer overflow",
}

#: What to do about them.
MENDS = {
    **dict.fromkeys(
        (0x01, 0x0A), "look at its supply, switch it off and on; replace it where that does not help"
    ),
    **dict.fromkeys((0x02, 0x0B, 0x0C, 0xFF), "raise its baud, or have it send less"),
    0x03: "check the cable, and vectornav.check of the IMU profile",
    **dict.fromkeys(
        range(0x04, 0x09), "compare this line with the unit's manual, and correct the IMU profile"
    ),
    0x09: "look at the unit's write protection",
}


class LineReply:
    """Lines that answer commands; meets `frames.ReplyKind`.

    Parameters
    ----------
    section : the profile's
    """

    sync = b"$VN"

    def __init__(self, section: VectorNavSection) -> None:
        crc = CrcSection(kind=section.check, start=1)
        shape = FrameSection(format="text", sync="$VN", fields=[], crc=crc, max_size=_LONGEST)
        self._line = TextLine(self.sync, shape)

    def size(self, buffer: bytes, place: int) -> int | None:
        """See `packets.PacketKind`."""
        return self._line.size(buffer, place)

    def is_valid(self, packet: bytes) -> bool:
        """See `packets.PacketKind`."""
        return self._line.is_valid(packet)

    def reply(self, packet: bytes) -> Reply:
        """The line's words between $ and *."""
        return Reply(0, self._line.body(packet)[1:])


def line(words: str, check: str) -> bytes:
    """A command as it goes out."""
    value = check_function(check)(words.encode("ascii"))
    return f"${words}*{value:0{2 * CHECK_WIDTHS[check]}X}\r\n".encode("ascii")


class VectorNavImu(RegisteredImu):
    """The unit of a profile on a link. A register entry is one register of the unit with all its fields.

    Parameters
    ----------
    link : open port
    profile : what the bytes mean
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
                f"IMU: register {entry.address} answers '{','.join(fields)}', not {len(entry.names)} numbers; compare"
                " it with the unit's manual, and correct address or parameters in the IMU profile"
            )
        return numbers

    def _write_entry(self, entry: RegisterEntry, numbers: list[float]) -> None:
        told = ",".join(f"{value:.{self._section.digits}G}" for value in numbers)
        self._ask(f"VNWRG,{entry.address},{told}")

    def _ask(self, words: str, *, timeout: float | None = None, attempts: int = _ATTEMPTS) -> list[str]:
        """Send a line and wait for the one that repeats its command and register; its further fields."""
        return self.exchange(
            self._question(words), timeout=timeout or self._section.timeout_s, attempts=attempts
        )

    def _other_questions(self) -> Iterator[Question[list[str]]]:
        """What stands in its registers."""
        for register in (_MODEL, _SERIAL, _FIRMWARE, *(entry.address for entry in self._registers.entries)):
            yield self._question(f"VNRRG,{register}")

    def _question(self, words: str) -> Question[list[str]]:
        command, *rest = words.split(",")
        begins = [command, *(rest[:1] if command in ("VNRRG", "VNWRG") else [])]

        def take(reply: Reply) -> list[str] | None:
            fields = reply.payload.decode("ascii", "replace").split(",")
            if fields[0] == "VNERR":
                reason, mend = _meaning(fields[1:])
                raise ImuRefusalError(f"IMU: '{words}' was refused: {reason}; {mend}", reason)
            if fields[0] != begins[0] or not _same_register(fields[1:2], begins[1:]):
                return None
            return fields[len(begins) :]

        look = (command, *(register.lstrip("0") for register in begins[1:]))
        return Question(line(words, self._section.check), look, take)


def _same_register(told: list[str], asked: list[str]) -> bool:
    """Registers alike, with or without zeros before them."""
    return not asked or (bool(told) and told[0].lstrip("0") == asked[0].lstrip("0"))


def _meaning(fields: list[str]) -> tuple[str, str]:
    """What an error's hexadecimal code says, and what to do about it."""
    text = fields[0] if fields else ""
    unknown = "look this error up in the unit's manual"
    try:
        code = int(text, 16)
    except ValueError:
        return f"code '{text}'", unknown
    return ERRORS.get(code, f"code {text}"), MENDS.get(code, unknown)
