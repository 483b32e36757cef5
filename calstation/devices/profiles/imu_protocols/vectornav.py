"""The protocol "vectornav", which uses lines of text $VN...*checksum on the serial line of a VectorNav's stream."""

from typing import Any, ClassVar, Literal

from pydantic import Field

from calstation.devices.profiles.entries import CommandLine, Rules
from calstation.devices.profiles.imu_protocols.base import ImuProtocol
from calstation.schema import EntryError


class VectorNavProtocol(ImuProtocol):
    """`[vectornav]`: commands in the form of lines $VN...*checksum."""

    section: ClassVar[str] = "vectornav"
    corrected_entry: ClassVar[Literal["stream", "start"]] = "start"

    check: Literal["xor8", "crc16_xmodem"] = "xor8"
    start: list[CommandLine] = Field(default_factory=list)
    digits: int = Field(default=9, ge=9, le=17)
    commit_timeout_s: float = Field(default=3.0, gt=0, le=120)

    @staticmethod
    def address_span(width: int) -> int:
        """Return 0, because all numbers of a register have the same address."""
        return 0

    # The clock in nanoseconds must agree with the sample rate.
    profile_rules: ClassVar[Rules[Any]] = (
        lambda profile: (
            EntryError("profile.clock_rate", *at, value=counter.per_sample, rate=rate, expected=1e9 / rate)
            for rate in [profile.stream.sample_rate_hz]
            for key_path, frame in profile.frames.items()
            for counter in [frame.required_field("counter")]
            for at in [(*key_path, "fields", frame.fields.index(counter), "per_sample")]
            if counter.per_sample != 1.0 and abs(counter.per_sample * rate - 1e9) > 1e6
        ),
    )


PROTOCOL = VectorNavProtocol
