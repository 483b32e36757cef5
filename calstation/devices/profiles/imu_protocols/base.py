"""Base class of the sections of command protocols."""

from typing import Any, ClassVar, Literal

from pydantic import Field

from calstation.devices.profiles.entries import ProfileSection, Rules


class ImuProtocol(ProfileSection):
    """The section of a command protocol in an IMU profile; timeouts are in host time, s."""

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
        """Return the default number of addresses of a `width`-byte number; 0 if all numbers have the same address."""
        return 1

    @property
    def has_pages(self) -> bool:
        """Whether registers are on pages, which must be selected before access."""
        return False

    @property
    def raw_stream(self) -> tuple[int, ...] | None:
        """Values that switch the raw stream on and off; None if no value switches the stream."""
        return None
