"""Base of the sections that describe how commands are sent to an IMU."""

from typing import Any, ClassVar, Literal

from pydantic import Field

from calstation.devices.profiles.entries import ProfileSection, Rules


class ImuProtocol(ProfileSection):
    """Section of an IMU profile for the commands of one protocol, with timeouts in host time, s."""

    #: Name of the section in a profile.
    section: ClassVar[str]

    #: Rules of a profile that depend on the protocol.
    profile_rules: ClassVar[Rules[Any]] = ()

    #: Entry of `[corrected]` that starts the corrected stream.
    corrected_entry: ClassVar[Literal["stream", "start"]] = "stream"

    timeout_s: float = Field(gt=0, le=60)
    commit_timeout_s: float = Field(default=5.0, gt=0, le=120)
    reset_timeout_s: float = Field(default=30.0, gt=0)

    @staticmethod
    def address_span(width: int) -> int:
        """Return the default number of addresses of a register number of `width` bytes, 0 if all have the same one."""
        return 1

    @property
    def has_pages(self) -> bool:
        """Whether registers are on pages that are selected before access."""
        return False

    @property
    def raw_stream(self) -> tuple[int, ...] | None:
        """Values that switch the raw stream on and off; None if no value switches the stream."""
        return None
