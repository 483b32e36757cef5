"""A scripted device that expects requests in order: an IMU driver's link, on a pseudo-terminal or on a TCP socket."""

import queue
import struct
import threading
import time
from collections.abc import Sequence

from calstation.errors import DeviceFaultError


class ScriptedDevice:
    """A device that sends a reply to each expected request, None or b"" for silence, and records all other requests.

    Attributes
    ----------
    pairs : expected requests and their replies; unexpected : other received bytes
    connections : number of connections to its server
    failure : error raised when the link is read; closed : set once the link is closed
    """

    port = "SCRIPT"
    received_at = property(lambda link: time.monotonic())

    def __init__(self, pairs: Sequence[tuple[bytes, bytes | None]]) -> None:
        self.pairs = list(pairs)
        self.unexpected: list[bytes] = []
        self.connections = 0
        self.failure: DeviceFaultError | None = None
        self.closed = threading.Event()
        self._received = b""
        self._bytes: queue.SimpleQueue[bytes] = queue.SimpleQueue()

    @property
    def finished(self) -> bool:
        """Whether exactly the expected requests have arrived."""
        return not self.pairs and not self.unexpected

    def answer(self, data: bytes) -> bytes:
        """Return the replies to received bytes."""
        self._received += data
        replies = b""
        while self.pairs and self._received.startswith(self.pairs[0][0]):
            request, reply = self.pairs.pop(0)
            self._received = self._received[len(request) :]
            replies += reply or b""
        if self._received and not (self.pairs and self.pairs[0][0].startswith(self._received)):
            self.unexpected.append(self._received)
            self._received = b""
        return replies

    def answer_modbus(self, data: bytes) -> bytes:
        """Return the reply to a Modbus TCP request; an unexpected one closes the connection."""
        reply = self.answer(data[7:])
        if self.unexpected:
            raise ConnectionError
        return data[:4] + struct.pack(">H", len(reply) + 1) + data[6:7] + reply if reply else b""

    def connected(self) -> None:
        """Count a connection."""
        self.connections += 1

    def send(self, data: bytes) -> None:
        """Send bytes without a request."""
        self._bytes.put(data)

    def read(self, wait: float) -> bytes:
        """Return bytes that the device has sent, as a link does."""
        if self.failure is not None:
            raise self.failure
        try:
            return self._bytes.get(timeout=wait)
        except queue.Empty:
            return b""

    def write(self, data: bytes) -> None:
        """Pass a request to the device, as a link does."""
        if reply := self.answer(data):
            self.send(reply)

    def close(self) -> None:
        """Close the link."""
        self.closed.set()
