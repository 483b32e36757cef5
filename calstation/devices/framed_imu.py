"""Driver of an IMU whose samples and command replies come as binary frames on one serial link."""

import queue
import struct
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calstation.devices.frames import FrameDecoder, Frames, Reply, command_frame
from calstation.devices.imu_profile import ImuProfile
from calstation.devices.interfaces import ImuIdentity, LinkStats, OtherModelError, SampleBatch
from calstation.devices.link import SerialLink
from calstation.devices.registers import RegisterMap
from calstation.errors import DeviceFaultError
from calstation.estimation.sequence import unwrap_counter

OP_IDENTIFY, OP_READ, OP_WRITE, OP_COMMIT, OP_RESET, OP_STREAM, OP_ERROR = 1, 2, 3, 4, 5, 6, 0xFF
_ERRORS = {1: "unknown command", 2: "no such register", 3: "flash busy"}
_WAIT = 0.02
"""Host time the reader waits for bytes before it looks for commands to send, s."""
_ATTEMPTS = 3
_VALUES_PER_TRANSFER = 32
_NOISE_FRAMES = 40
"""Frames' worth of bytes without one sound frame that counts as a wrong setting of the link."""


class ImuRefusalError(DeviceFaultError):
    """The unit understands and refuses a command."""


@dataclass(frozen=True)
class _Arrived:
    """Frames decoded from one read, and the host time of it."""

    frames: Frames
    time: float


class FramedImu:
    """The IMU of a profile on a link; one thread owns the port, reads samples and sends commands.

    Parameters
    ----------
    link : open port
    profile : what the bytes mean
    """

    def __init__(self, link: SerialLink, profile: ImuProfile) -> None:
        self._link = link
        self._profile = profile
        self._registers = RegisterMap(tuple(profile.registers))
        self._decoder = FrameDecoder(profile.frame, profile.commands)
        counter = next(f for f in profile.frame.fields if f.name == "counter")
        self._counter_bits = int(counter.type[1:])
        self._arrived: queue.SimpleQueue[_Arrived] = queue.SimpleQueue()
        self._replies: queue.SimpleQueue[Reply] = queue.SimpleQueue()
        self._outbox: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._closing = threading.Event()
        self._failure: DeviceFaultError | None = None
        self._last_seq: int | None = None
        self._frames = self._bytes = self._gaps = 0
        self._last_frame = time.monotonic()
        self._thread = threading.Thread(target=self._serve, name="imu-link", daemon=True)
        self._thread.start()

    @property
    def stats(self) -> LinkStats:
        """Counts since the link was opened."""
        d = self._decoder
        return LinkStats(self._frames, self._bytes, d.crc_errors, d.skipped, self._gaps)

    @property
    def received(self) -> int:
        """Bytes read and decoded since the link was opened."""
        return self._bytes

    @property
    def silence(self) -> float:
        """Host seconds since the last sound frame, or since the link was opened."""
        return time.monotonic() - self._last_frame

    def start(self) -> None:
        """Switch the stream on."""
        self._ask(OP_STREAM, b"\x01")

    def read(self) -> SampleBatch:
        """Samples since the last call. Raises DeviceFaultError where the link is lost or only noise comes."""
        parts = []
        while not self._arrived.empty():
            parts.append(self._arrived.get())
        if not parts:
            self._check()
        frames = np.concatenate([p.frames for p in parts]) if parts else np.empty(0, self._decoder.dtype)
        arrival = np.repeat([p.time for p in parts], [len(p.frames) for p in parts])
        counter, counts, temperature, status = self._decoder.samples(frames)
        seq = unwrap_counter(counter, self._last_seq, self._counter_bits)
        if len(seq):
            if self._last_seq is not None and seq[0] != self._last_seq + 1:
                self._gaps += 1
            self._gaps += int(np.count_nonzero(np.diff(seq) != 1))
            self._last_seq = int(seq[-1])
        moment = (seq + 1) / self._profile.stream.sample_rate_hz
        return SampleBatch(seq, moment, counts, temperature, status, arrival)

    def identify(self) -> ImuIdentity:
        """Ask for model, serial number and firmware; raises OtherModelError where another model answers."""
        text = self._ask(OP_IDENTIFY, b"").decode("ascii", errors="replace")
        parts = [part.strip() for part in text.split(";")]
        if len(parts) != 3:
            raise OtherModelError(
                f"IMU: identity '{text}' is not 'model;serial;firmware'; choose another profile",
                text,
                "model;serial;firmware",
            )
        identity = ImuIdentity(*parts)
        if self._profile.model not in identity.model:
            raise OtherModelError(
                f"IMU: model '{identity.model}' answers, the profile is for '{self._profile.model}';"
                " choose the right IMU profile in the product file",
                identity.model,
                self._profile.model,
            )
        return identity

    def read_registers(self) -> dict[str, float]:
        """Calibration registers in SI by parameter."""
        return self._registers.decode(
            {e.address: self._read_values(e.address, len(e.parameters)) for e in self._registers.entries}
        )

    def write_registers(self, values: Mapping[str, float]) -> None:
        """Write calibration registers; parameters not named keep theirs."""
        missing = [name for name in self._registers.parameters if name not in values]
        present = self.read_registers() if missing else {}
        for address, row in self._registers.encode({**present, **values}).items():
            for k in range(0, len(row), _VALUES_PER_TRANSFER):
                part = row[k : k + _VALUES_PER_TRANSFER]
                head = struct.pack(self._format("HB"), address + k, len(part))
                answer = self._ask(OP_WRITE, head + struct.pack(self._format(f"{len(part)}f"), *part), head)
                if answer != head:
                    raise DeviceFaultError(
                        f"IMU: register {address + k} was not taken; nothing was committed"
                    )

    def commit(self) -> None:
        """Write the registers to flash, once: a lost answer is a fault, never a second flash cycle."""
        answer = self._ask(OP_COMMIT, b"", attempts=1)
        if answer[:1] != b"\x00":
            raise DeviceFaultError(
                "IMU: the unit refused to commit its registers; power it off and on, try again"
            )

    def reset(self) -> None:
        """Restart the unit and wait until it answers again."""
        self._ask(OP_RESET, b"", attempts=1)
        deadline = time.monotonic() + self._profile.commands.reset_timeout_s
        while True:
            try:
                self._ask(OP_IDENTIFY, b"", attempts=1)
                return
            except DeviceFaultError:
                if self._failure is not None or time.monotonic() > deadline:
                    raise

    def close(self) -> None:
        """End the reader and close the port."""
        self._closing.set()
        self._thread.join(5.0)
        self._link.close()

    def _read_values(self, address: int, count: int) -> list[float]:
        values: list[float] = []
        for k in range(0, count, _VALUES_PER_TRANSFER):
            n = min(_VALUES_PER_TRANSFER, count - k)
            head = struct.pack(self._format("HB"), address + k, n)
            answer = self._ask(OP_READ, head, head)
            if len(answer) != len(head) + 4 * n:
                raise DeviceFaultError(f"IMU: register {address + k} answers with a wrong length")
            values += struct.unpack(self._format(f"{n}f"), answer[len(head) :])
        return values

    def _format(self, codes: str) -> str:
        return ("<" if self._profile.frame.byte_order == "little" else ">") + codes

    def _ask(self, op: int, payload: bytes, begins: bytes = b"", attempts: int = _ATTEMPTS) -> bytes:
        """Send a command and wait for its reply, whose payload must begin with `begins`."""
        commands = self._profile.commands
        request = command_frame(commands, self._profile.frame, op, payload)
        while not self._replies.empty():
            self._replies.get()
        for _ in range(attempts):
            self._check()
            self._outbox.put(request)
            deadline = time.monotonic() + commands.timeout_s
            while (left := deadline - time.monotonic()) > 0:
                try:
                    reply = self._replies.get(timeout=min(left, 0.1))
                except queue.Empty:
                    self._check()
                    continue
                if reply.op == OP_ERROR:
                    code = reply.payload[0] if reply.payload else 0
                    raise ImuRefusalError(
                        f"IMU: command {op} was refused: {_ERRORS.get(code, f'code {code}')}"
                    )
                if reply.op == op and reply.payload.startswith(begins):
                    return reply.payload
        raise DeviceFaultError(self._unanswered())

    def _unanswered(self) -> str:
        where = f"IMU: no answer on {self._link.port} within {self._profile.commands.timeout_s:g} s"
        if self._bytes == 0:
            return f"{where}, not a byte came; check power, cable and port"
        if self._frames == 0:
            return f"{where}, the bytes that come are no frames; check baud, parity and the IMU profile"
        return f"{where} though samples come; check the transmit line and the IMU profile"

    def _check(self) -> None:
        if self._failure is not None:
            raise self._failure
        if self._decoder.since_frame > _NOISE_FRAMES * self._decoder.size:
            raise DeviceFaultError(
                f"IMU: bytes come on {self._link.port} but no frame is recognised;"
                " check baud, parity, stop bits and the IMU profile"
            )

    def _serve(self) -> None:
        """The port's one thread: read, decode, hand on, send."""
        try:
            while not self._closing.is_set():
                while not self._outbox.empty():
                    self._link.write(self._outbox.get())
                data = self._link.read(_WAIT)
                if not data:
                    continue
                now = time.monotonic()
                decoded = self._decoder.feed(data)
                if len(decoded.frames):
                    self._frames += len(decoded.frames)
                    self._last_frame = now
                    self._arrived.put(_Arrived(decoded.frames, now))
                for reply in decoded.replies:
                    self._replies.put(reply)
                self._bytes += len(data)
        except DeviceFaultError as exc:
            self._failure = exc
        except Exception as exc:  # noqa: BLE001 - a reader that dies silently would look like a unit without data
            failure = DeviceFaultError(f"IMU: reading {self._link.port} failed ({type(exc).__name__}: {exc})")
            failure.__cause__ = exc
            self._failure = failure
