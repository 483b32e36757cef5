"""A Modbus RTU device on a pseudo-terminal that responds in order, each response with a configured delay."""

import os
import select
import struct
import threading
import time
from collections.abc import Iterable, Mapping

from fastcrc import crc16


def crc(data: bytes) -> bytes:
    return struct.pack("<H", crc16.modbus(data))


class RtuServer(threading.Thread):
    """Register n contains n unless `words` overrides it; response k is delayed by `late[k]` s, or omitted if None."""

    def __init__(self, late: Mapping[int, float | None] | None = None, words: Mapping[int, int] | None = None) -> None:
        import tty

        super().__init__(daemon=True)
        self._master, self._slave = os.openpty()
        tty.setraw(self._master)
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        self.late = dict(late or {})
        self.words = dict(words or {})
        self.requests: list[tuple[int, int, int]] = []
        self._closing = threading.Event()
        self.start()

    def close(self) -> None:
        """Disconnect the device."""
        self._closing.set()
        self.join(5.0)
        for end in (self._slave, self._master):
            os.close(end)

    def store(self, function: int, address: int, values: Iterable[int]) -> int:
        """Store a write; return the Modbus exception code, or 0 on success."""
        self.words |= {address + i: value for i, value in enumerate(values)}
        return 0

    def value_of(self, address: int) -> int | None:
        """Return the value of a register, or None to respond with exception 6."""
        return self.words.get(address, address)

    def run(self) -> None:
        buffer = b""
        while not self._closing.is_set():
            if not select.select([self._master], [], [], 0.02)[0]:
                continue
            buffer += os.read(self._master, 4096)
            while len(buffer) >= 8:
                size = 9 + buffer[6] if buffer[1] == 16 else 8
                if len(buffer) < size:
                    break
                frame, buffer = buffer[:size], buffer[size:]
                if crc(frame[:-2]) != frame[-2:]:
                    buffer = b""
                    break
                self._answer(frame)

    def _answer(self, frame: bytes) -> None:
        unit, function, address, second = struct.unpack(">BBHH", frame[:6])
        self.requests.append((function, address, second))
        refused = 0
        body = frame[:6]
        if function == 3:
            values = [self.value_of(address + i) for i in range(second)]
            words = [word for word in values if word is not None]
            refused = 6 if len(words) < second else 0
            body = frame[:2] + struct.pack(f">B{len(words)}H", 2 * len(words), *words)
        else:
            values = [second] if function == 6 else struct.unpack(f">{second}H", frame[7:-2])
            refused = self.store(function, address, values)
        if refused:
            body = bytes([unit, function | 0x80, refused])
        late = self.late.get(len(self.requests) - 1, 0.0)
        if late is None:
            return
        time.sleep(late)
        os.write(self._master, body + crc(body))
