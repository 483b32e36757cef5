"""Stream frames, command frames and the checksum of the bench IMU.

All values are little-endian. The checksum is CRC-16/CCITT-FALSE (polynomial 0x1021, start 0xFFFF, not reflected).

    stream   55 AA | counter u16 | gyro x y z, accel x y z i32 | temperature i16, 0.01 °C | status u16 | CRC
    command  55 A5 | op u8 | n u8 | payload, n bytes | CRC of op to payload
    reply    55 5A | op u8 | n u8 | payload, n bytes | CRC of op to payload
"""

from dataclasses import dataclass, field

import numpy as np
from fastcrc import crc16 as checks

from calstation.physics import FloatArray, IntArray

STREAM = np.dtype(
    [
        ("sync", "<u2"),
        ("counter", "<u2"),
        ("channels", "<i4", 6),
        ("temperature", "<i2"),
        ("status", "<u2"),
        ("crc", "<u2"),
    ]
)
STREAM_SYNC = 0xAA55  # 55 AA on the wire
COMMAND_SYNC = b"\x55\xa5"
REPLY_SYNC = b"\x55\x5a"

READY, SATURATED = 1, 2


def crc16(data: bytes) -> int:
    """Return the CRC-16/CCITT-FALSE of `data`."""
    return int(checks.ibm_3740(data))


def stream_frames(counter: IntArray, counts: FloatArray, temperature: float, status: IntArray) -> bytes:
    """Build the frames of consecutive samples.

    Only the low 16 bits of the counter are sent; NaN is sent as the lowest number.
    """
    frames = np.zeros(len(counter), dtype=STREAM)
    frames["sync"] = STREAM_SYNC
    frames["counter"] = counter & 0xFFFF
    frames["channels"] = np.clip(np.nan_to_num(counts, nan=-(2.0**31)), -(2**31), 2**31 - 1)
    frames["temperature"] = round(temperature * 100.0)
    frames["status"] = status
    frames["crc"] = [crc16(frame.tobytes()[2:-2]) for frame in frames]
    return frames.tobytes()


def pack(sync: bytes, op: int, payload: bytes = b"") -> bytes:
    """Build the frame of a command or a reply."""
    body = bytes([op, len(payload)]) + payload
    return sync + body + crc16(body).to_bytes(2, "little")


@dataclass
class CommandParser:
    """Finds command frames in the received bytes, regardless of how they are split, and skips all other bytes."""

    _pending: bytearray = field(default_factory=bytearray)

    def feed(self, data: bytes) -> list[tuple[int, bytes]]:
        """Return the complete commands (op, payload) with a correct checksum, in order."""
        self._pending += data
        commands: list[tuple[int, bytes]] = []
        while True:
            start = self._pending.find(COMMAND_SYNC)
            if start < 0:
                del self._pending[: max(0, len(self._pending) - 1)]
                return commands
            del self._pending[:start]
            if len(self._pending) < 4 or len(self._pending) < self._pending[3] + 6:
                return commands
            length = self._pending[3] + 6
            frame = bytes(self._pending[:length])
            if crc16(frame[2:-2]) == int.from_bytes(frame[-2:], "little"):
                commands.append((frame[2], frame[4:-2]))
                del self._pending[:length]
            else:
                del self._pending[:2]
