"""Packets in a byte stream: the protocol of their kinds, replies to commands, and bytes quoted in messages."""

from dataclasses import dataclass
from typing import Protocol

#: Characters of quoted bytes, unless the caller asks for another length.
QUOTE_LENGTH = 40


class PacketKind(Protocol):
    """One kind of packet that a stream may carry; `sync` are the bytes that begin it."""

    sync: bytes

    def size(self, buffer: bytes, start: int) -> int | None:
        """Size in bytes of the packet that begins at `start`: None until more bytes have come, 0 if none begins."""

    def is_valid(self, packet: bytes) -> bool:
        """Whether a complete packet passes its check."""


@dataclass(frozen=True)
class Reply:
    """Op and payload of a reply; a line of text has op 0 and is the payload itself."""

    op: int
    payload: bytes


class ReplyKind(PacketKind, Protocol):
    """Packets that answer commands."""

    def reply(self, packet: bytes) -> Reply:
        """Content of a valid packet."""


def quoted(data: bytes, length: int = QUOTE_LENGTH) -> str:
    r"""The first characters of some bytes, unprintable ones as ``\x00``; "..." stands for what is left out."""
    text = ""
    for byte in data:
        letter = chr(byte) if 0x20 <= byte < 0x7F and byte != 0x5C else f"\\x{byte:02x}"
        if len(text) + len(letter) > length:
            return f"{text}..."
        text += letter
    return text


def quoted_text(text: str, length: int = QUOTE_LENGTH) -> str:
    """The same for text in which each letter is one byte."""
    return quoted(text.encode("latin-1", "replace"), length)
