"""Protocol "framed": requests and replies in frames on the line of the stream."""

from typing import TYPE_CHECKING, ClassVar

from pydantic import Field, field_validator

from calstation.devices.codecs import CRC_WIDTHS, check_code
from calstation.devices.profiles.entries import SyncText, hex_bytes
from calstation.devices.profiles.imu_protocols.base import ImuProtocol
from calstation.schema import EntryError, entry, near_miss

if TYPE_CHECKING:
    from calstation.devices.profiles.imu import ImuProfile

#: Op codes of the framed link and their usual numbers; `..._words` are for systems with their own indexing unit.
OPS = {
    "identify": 1,
    "read": 2,
    "write": 3,
    "commit": 4,
    "reset": 5,
    "stream": 6,
    "read_words": 7,
    "write_words": 8,
    "error": 255,
}

#: The usual error code of the framed link for "flash busy".
FLASH_BUSY = 3


class FramedProtocol(ImuProtocol):
    """`[commands]`: request and reply frames, sync | op u8 | n u8 | n bytes | checksum over op to payload.

    ops : numbers of the ops that differ from `OPS`; errors : meanings of the codes in an error reply
    busy : error codes of a unit that is busy; by default 3, or none if `errors` is given
    """

    section: ClassVar[str] = "commands"

    request_sync: SyncText
    reply_sync: SyncText
    crc: str
    ops: dict[str, int] = Field(default_factory=dict)
    errors: dict[str, str] = Field(default_factory=dict)
    busy: list[int] | None = None

    @field_validator("ops")
    @classmethod
    def _ops(cls, ops: dict[str, int]) -> dict[str, int]:
        for name, op in ops.items():
            if name not in OPS:
                raise EntryError("entry.unknown", name, remedy=near_miss(name, OPS))
            if not 0 <= op <= 255:
                raise EntryError("entry.out_of_range", name, value=op, low=0, high=255)
        every = {**OPS, **ops}
        if len(set(every.values())) < len(every):
            raise EntryError("profile.same_op_twice")
        return ops

    @field_validator("errors")
    @classmethod
    def _errors(cls, errors: dict[str, str]) -> dict[str, str]:
        for code in errors:
            with entry(code):
                check_code(code)
                if int(code) > 0xFF:
                    raise EntryError("entry.out_of_range", value=code, low=0, high=255)
        return errors

    @field_validator("crc")
    @classmethod
    def _known(cls, kind: str) -> str:
        if kind not in CRC_WIDTHS:
            raise EntryError("profile.unknown_check", value=kind, names=list(CRC_WIDTHS))
        return kind

    @property
    def busy_codes(self) -> tuple[int, ...]:
        return tuple(self.busy) if self.busy is not None else () if self.errors else (FLASH_BUSY,)

    @property
    def raw_stream(self) -> tuple[int, ...]:
        return 0, 1

    def check_profile(self, profile: "ImuProfile") -> None:
        """Check that frames can be distinguished from replies, and that a stream is selected by one byte."""
        reply_sync = hex_bytes(self.reply_sync)
        for key_path, frame in profile.frames.items():
            sync = frame.sync_bytes
            if sync.startswith(reply_sync) or reply_sync.startswith(sync):
                raise EntryError("profile.sync_of_replies", *key_path, "sync")
        stream = profile.corrected.stream if profile.corrected is not None else None
        if stream is not None and stream > 0xFF:
            raise EntryError("entry.out_of_range", "corrected", "stream", value=stream, low=2, high=255)


PROTOCOL = FramedProtocol
