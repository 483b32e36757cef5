"""The protocol "framed", which uses request and reply frames on the serial line of the sample stream."""

from typing import Annotated, Any, ClassVar

from pydantic import Field

from calstation.devices.codecs import CRC_WIDTHS, is_code
from calstation.devices.profiles.entries import Rules, SyncText, each_item, hex_bytes, one_of
from calstation.devices.profiles.imu_protocols.base import ImuProtocol
from calstation.schema import EntryError, near_miss

#: Operations of the framed link and their usual op codes; `..._words` access the axes of a built-in indexing unit.
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


def _not_a_byte(value: int | str) -> EntryError:
    return EntryError("entry.out_of_range", value=value, low=0, high=255)


class FramedProtocol(ImuProtocol):
    """`[commands]`: request and reply frames, sync | op u8 | n u8 | n bytes | checksum over op to payload."""

    section: ClassVar[str] = "commands"

    request_sync: SyncText
    reply_sync: SyncText
    crc: Annotated[str, one_of(CRC_WIDTHS)]
    ops: dict[str, int] = Field(default_factory=dict)
    errors: dict[str, str] = Field(default_factory=dict)
    busy: list[int] | None = None

    rules: ClassVar[Rules["FramedProtocol"]] = (
        each_item(
            "ops", lambda s, name, op: name not in OPS and EntryError("entry.unknown", remedy=near_miss(name, OPS))
        ),
        each_item("ops", lambda s, name, op: not 0 <= op <= 255 and _not_a_byte(op)),
        lambda s: len({*(OPS | s.ops).values()}) < len(OPS) and EntryError("profile.same_op_twice", "ops"),
        each_item("errors", lambda s, code, meaning: not is_code(code) and EntryError("profile.not_a_code")),
        each_item("errors", lambda s, code, meaning: int(code) > 255 and _not_a_byte(code)),
    )
    profile_rules: ClassVar[Rules[Any]] = (
        lambda p: (
            EntryError("profile.sync_of_replies", *key_path, "sync")
            for reply_sync in [hex_bytes(p.commands.reply_sync)]
            for key_path, frame in p.frames.items()
            if frame.sync_bytes.startswith(reply_sync) or reply_sync.startswith(frame.sync_bytes)
        ),
        # The byte after the op selects a stream.
        lambda p: (
            p.corrected is not None
            and (stream := p.corrected.stream or 0) > 255
            and EntryError("entry.out_of_range", "corrected", "stream", value=stream, low=2, high=255)
        ),
    )

    @property
    def busy_codes(self) -> tuple[int, ...]:
        """Error codes with which the unit reports that it is busy."""
        return tuple(self.busy) if self.busy is not None else () if self.errors else (FLASH_BUSY,)

    @property
    def raw_stream(self) -> tuple[int, ...]:
        """Values of the byte that switch the raw stream off and on."""
        return 0, 1


PROTOCOL = FramedProtocol
