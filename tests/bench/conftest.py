"""A bench process, started as the station starts it, and its clients."""

import json
import socket
import subprocess
import sys
import threading
from contextlib import contextmanager

import lent
import pytest
import serial

from calstation.bench.imu.unit import crc16
from calstation.bench.imu.units.framed import COMMAND_SYNC, REPLY_SYNC, pack


class Bench:
    """A running bench with its clock connected."""

    def __init__(self, process):
        self.process = process
        self.endpoints = json.loads(process.stdout.readline())
        host, port = self.endpoints["clock"].split(":")
        self.clock = socket.create_connection((host, int(port)), timeout=20.0)
        self._lines = self.clock.makefile("rb")

    def ask(self, **request):
        self.clock.sendall(json.dumps(request).encode() + b"\n")
        return json.loads(self._lines.readline())

    def advance(self, seconds):
        return self.ask(advance=seconds)

    def close(self):
        self._lines.close()
        self.clock.close()
        self.process.stdin.close()
        code = self.process.wait(10.0)
        self.process.stdout.close()
        return code


class ImuClient:
    """Client that reads the unit's output in its own thread and extracts frames and replies."""

    def __init__(self, endpoint):
        self.port = serial.serial_for_url(endpoint, timeout=0.02)
        self.data = bytearray()
        self._open = True
        self._thread = threading.Thread(target=self._read)
        self._thread.start()

    def _read(self):
        while self._open:
            try:
                self.data += self.port.read(340)
            except (serial.SerialException, OSError):
                return

    def wait_for(self, size):
        for _ in range(2000):
            if len(self.data) >= size:
                return
            threading.Event().wait(0.005)
        raise AssertionError(f"{len(self.data)} of {size} bytes came")

    def wait_for_the_end(self):
        self._thread.join(10.0)
        assert not self._thread.is_alive(), "the port has gone"

    def command(self, op, payload=b""):
        """Send a command and return (op, payload) of its reply."""
        start = len(self.data)
        self.port.write(pack(COMMAND_SYNC, op, payload))
        for _ in range(2000):
            at = self.data.find(REPLY_SYNC, start)
            if at >= 0 and len(self.data) >= at + 4 and len(self.data) >= at + 6 + self.data[at + 3]:
                reply = bytes(self.data[at : at + 6 + self.data[at + 3]])
                assert crc16(reply[2:-2]) == int.from_bytes(reply[-2:], "little")
                return reply[2], reply[4:-2]
            threading.Event().wait(0.005)
        raise AssertionError("no reply")

    def close(self):
        self._open = False
        self._thread.join()
        self.port.close()


@contextmanager
def running(**config):
    command = [sys.executable, "-m", "calstation.bench", "--config", json.dumps(config)]
    process = lent.popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    bench = Bench(process)
    try:
        yield bench
    finally:
        bench.close()


@pytest.fixture
def start_bench():
    """A context manager that runs a bench: `with start_bench(**config) as bench`."""
    return running


@pytest.fixture
def imu_client():
    """A function that opens a client of an IMU endpoint; all clients are closed at the end."""
    clients = []

    def connect(endpoint):
        clients.append(ImuClient(endpoint))
        return clients[-1]

    yield connect
    for client in clients:
        client.close()
