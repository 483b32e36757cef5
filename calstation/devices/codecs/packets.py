"""Packets in a byte stream, replies to commands, and texts in registers and messages."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

#: Default maximum length of quoted bytes, characters.
QUOTE_LENGTH = 40


class PacketKind(Protocol):
    """A kind of packet in a stream, which begins with `sync`."""

    sync: bytes

    def size(self, buffer: bytes, start: int) -> int | None:
        """Return the size in bytes of the packet at `start`; None if more bytes are needed, 0 if there is no packet."""

    def is_valid(self, packet: bytes) -> bool:
        """Return whether a complete packet has a correct checksum."""


@dataclass(frozen=True)
class Reply:
    """Op code and payload of a reply; for a line of text, the op code is 0 and the payload is the line."""

    op: int
    payload: bytes


class ReplyKind(PacketKind, Protocol):
    """A kind of packet that replies to commands."""

    def reply(self, packet: bytes) -> Reply:
        """Return the content of a valid packet."""


def quote(data: bytes, length: int = QUOTE_LENGTH) -> str:
    r"""Quote the first characters of a byte string, unprintable ones as ``\x00``; "..." marks the omitted rest."""
    text = ""
    for byte in data:
        letter = chr(byte) if 0x20 <= byte < 0x7F and byte != 0x5C else f"\\x{byte:02x}"
        if len(text) + len(letter) > length:
            return f"{text}..."
        text += letter
    return text


def quote_text(text: str) -> str:
    """Quote the first characters of a text like `quote`; each character represents one byte."""
    return quote(text.encode("latin-1", "replace"))


def register_text(words: Iterable[int]) -> str:
    """Return the ASCII text in 16-bit registers, high byte first, up to its first zero byte."""
    raw = b"".join(word.to_bytes(2, "big") for word in words)
    return raw.split(b"\0")[0].decode("ascii", errors="replace").strip()
