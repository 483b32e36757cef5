"""Fake table and IMU on a pseudo-terminal or a socket, with and without faults."""

import os
import select
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from calstation.bench.links.lines import open_raw
from calstation.config import StationConfig
from calstation.connection import LinkTestRequest
from calstation.devices.codecs import check_bytes
from calstation.messages import Finding, render
from calstation.schema import validate

#: Where nothing listens; of each process of tests another, for a port has one owner.
NOBODY = f"tcp://127.0.0.1:{1 + int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0')[2:])}"

SITE = {"latitude_deg": 34.25, "longitude_deg": 108.9, "height_m": 400.0}
Answer = Callable[[bytes], bytes]


def english_texts(finding: Finding) -> tuple[str, str]:
    """Return text and remedy of a finding as the window shows them in English."""
    shown = render(finding.message.code, finding.message.values, window=True)
    return shown.text, shown.remedy


def order(product: Path | None = None, **sections: dict[str, Any]) -> LinkTestRequest:
    """Request a test of a station with short timeouts; unnamed ports do not exist."""
    table = {"profile": "bench", "port": NOBODY, "timeout_s": 0.1}
    imu = {"port": "/dev/ttyNONE9", "timeout_s": 0.15}
    data: dict[str, Any] = {"name": "wires", "site": SITE}
    if "bench" in sections:
        data |= {"table": {"profile": "bench"}, "bench": sections["bench"]}
    else:
        data |= {"table": table | sections.get("table", {}), "imu": imu | sections.get("imu", {})}
    if "chamber" in sections:
        data["chamber"] = sections["chamber"]
    return LinkTestRequest(validate(StationConfig, data, "test"), product)


def silent(_: bytes) -> bytes:
    """A device that never responds."""
    return b""


@contextmanager
def terminal(answer: Answer, sends: Callable[[], bytes] = bytes) -> Iterator[str]:
    """A pseudo-terminal whose far end responds to requests and sends unsolicited data every 10 ms."""
    master, slave, name = open_raw()
    end = threading.Event()

    def serve() -> None:
        with suppress(OSError):
            while not end.is_set():
                ready, _, _ = select.select([master], [], [], 0.01)
                reply = answer(os.read(master, 4096)) if ready else sends()
                if reply:
                    os.write(master, reply)

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield name
    finally:
        end.set()
        thread.join(5.0)
        os.close(slave)
        os.close(master)


@contextmanager
def server(answer: Answer, connected: Callable[[], None] = lambda: None) -> Iterator[str]:
    """Run a TCP server that responds to requests; yield host:port. An OSError of `answer` closes the connection."""
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def serve(peer: socket.socket) -> None:
            with suppress(OSError), peer:
                while heard := peer.recv(4096):
                    peer.sendall(answer(heard))

        def accept() -> None:
            with suppress(OSError):
                while True:
                    peer, _ = listening.accept()
                    connected()
                    threading.Thread(target=serve, args=(peer,), daemon=True).start()

        threading.Thread(target=accept, daemon=True).start()
        yield f"127.0.0.1:{listening.getsockname()[1]}"
        with suppress(OSError):
            listening.shutdown(socket.SHUT_RDWR)  # wakes the accepting thread, which keeps the port open


def rtu(frame: bytes) -> bytes:
    """Return an RTU frame with its checksum."""
    return frame + check_bytes("crc16_modbus", frame, "little")


def tcp_pdu(heard: bytes, pdu: bytes) -> bytes:
    """Return a Modbus TCP response to a request."""
    return heard[:4] + struct.pack(">H", len(pdu) + 1) + heard[6:7] + pdu


class FakeTable:
    """The registers of the bench's table as a Modbus TCP server.

    Attributes
    ----------
    words : all registers; functions : received Modbus function codes in order
    """

    def __init__(self, raw: dict[int, float]) -> None:
        self.words = [0] * 64
        self.functions: list[int] = []
        self.words[0:8] = struct.unpack(">8H", b"bench-table".ljust(16, b"\0"))
        self.words[19:21] = [1, 1500]
        limits = {40: -1.08e8, 42: 1.08e8, 60: -1.08e8, 62: 1.08e8}
        for address, value in (limits | raw).items():
            self.words[address : address + 2] = struct.unpack(">HH", struct.pack(">i", round(value)))

    def answer(self, heard: bytes) -> bytes:
        """Return the response to a read request."""
        self.functions.append(heard[7])
        start, count = struct.unpack(">HH", heard[8:12])
        values = struct.pack(f">{count}H", *self.words[start : start + count])
        return tcp_pdu(heard, bytes([3, len(values)]) + values)


class FakeImu:
    """A fake IMU with the protocol of the bench's navigation profile.

    Attributes
    ----------
    counts : counts of every sample; rate : samples per second; skip : samples omitted after the hundredth
    stored : samples that are forwarded first, three for each that is due
    check : checksum type of the frames; mute : send no replies; model : reported model
    """

    def __init__(self, **changes: Any) -> None:
        self.counts = [0, 0, 0, 0, 0, 48_977]  # 9.795 m/s² at 200 Hz and 1 µm/s per count
        self.rate = 200.0
        self.skip = 0
        self.stored = 0
        self.check = "crc16_ccitt_false"
        self.mute = False
        self.model = "bench-imu"
        self.status = 1
        self.sent = 0
        self._next = time.monotonic()
        for name, value in changes.items():
            setattr(self, name, value)

    def sends(self) -> bytes:
        """Return the samples that are due."""
        now = time.monotonic()
        if now - self._next > 1.0:  # made long before it is plugged in: it has nothing to make up for
            self._next = now
        due = int((now - self._next) * self.rate)
        self._next += due / self.rate if due else 0.0
        more = min(self.stored, 3 * due)
        self.stored -= more
        return b"".join(self._frame() for _ in range(due + more))

    def _frame(self) -> bytes:
        if self.sent == 100:
            self.sent += self.skip
        body = struct.pack("<H6ihH", self.sent & 0xFFFF, *self.counts, 2300, self.status)
        self.sent += 1
        return b"\x55\xaa" + body + check_bytes(self.check, body, "little")

    def answer(self, heard: bytes) -> bytes:
        """Return the replies to received commands."""
        replies = b""
        while not self.mute and len(heard) >= 6 and heard.startswith(b"\x55\xa5"):
            op, size = heard[2], heard[3]
            payload, heard = heard[4 : 4 + size], heard[6 + size :]
            if op == 1:
                payload = f"{self.model};SN-000042;1.0".encode()
            elif op == 2:
                payload += bytes(4 * payload[2])
            body = bytes([op, len(payload)]) + payload
            replies += b"\x55\x5a" + body + check_bytes("crc16_ccitt_false", body, "little")
        return replies
