"""Protocol "vectornav": lines $VN...*checksum on the line of a VectorNav's stream."""

from typing import TYPE_CHECKING, ClassVar, Literal

from pydantic import Field

from calstation.devices.profiles.imu_protocols.base import ImuProtocol
from calstation.devices.profiles.imu_sections import CommandLine
from calstation.schema import EntryError, KeyPath

if TYPE_CHECKING:
    from calstation.devices.profiles.imu import ImuProfile


class VectorNavProtocol(ImuProtocol):
    """`[vectornav]`: commands as lines $VN...*checksum.

    start : lines that configure and start the stream, without $ and checksum, e.g. "VNWRG,75,1,4,05,0001,001C"
    digits : number of significant digits of a written value
    commit_timeout_s : timeout of a commit, which takes about half a second
    """

    section: ClassVar[str] = "vectornav"
    corrected_entry: ClassVar[Literal["stream", "start"]] = "start"

    check: Literal["xor8", "crc16_xmodem"] = "xor8"
    start: list[CommandLine] = Field(default_factory=list)
    digits: int = Field(default=9, ge=9, le=17)
    commit_timeout_s: float = Field(default=3.0, gt=0, le=120)

    @staticmethod
    def address_span(width: int) -> int:
        return 0

    def check_profile(self, profile: "ImuProfile") -> None:
        """Check that the clock in nanoseconds agrees with the sample rate."""
        rate = profile.stream.sample_rate_hz
        expected = 1e9 / rate
        for key_path, frame in profile.frames.items():
            counter = frame.named("counter")
            if counter.per_sample != 1.0 and abs(counter.per_sample - expected) > 1e-3 * expected:
                at: KeyPath = (*key_path, "fields", frame.fields.index(counter), "per_sample")
                raise EntryError("profile.clock_rate", *at, value=counter.per_sample, rate=rate, expected=expected)


PROTOCOL = VectorNavProtocol
