"""What every IMU driver shares: one thread that owns the port, reads samples from it and sends commands."""

import queue
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from calstation.devices.frame_profile import FrameSection
from calstation.devices.frames import FrameDecoder, Reply, ReplyKind
from calstation.devices.imu_profile import CommandSection, ImuProfile
from calstation.devices.interfaces import ImuIdentity, LinkStats, SampleBatch
from calstation.devices.link import SerialLink
from calstation.devices.sample_count import SampleCount
from calstation.errors import DeviceFaultError
from calstation.physics.arrays import FloatArray, IntArray

_WAIT = 0.02
"""Host time the reader waits for bytes before it looks for commands to send, s."""
_NOISE_FRAMES = 40
"""Frames' worth of bytes without one sound frame that counts as a wrong setting of the link."""

T = TypeVar("T")


class ImuRefusalError(DeviceFaultError):
    """The unit understands and refuses a command."""


@dataclass(frozen=True)
class _Arrived:
    """Samples decoded from one read, and the host time of it."""

    counter: IntArray
    counts: FloatArray
    temperature: FloatArray
    status: IntArray
    time: float


class StreamedImu(ABC):
    """The port of an IMU: samples come out of `read`, commands go through `exchange`. Meets `interfaces.Imu`.

    Parameters
    ----------
    link : open port
    profile : what the bytes mean
    replies : packets that answer commands
    """

    def __init__(
        self, link: SerialLink, profile: ImuProfile, replies: CommandSection | ReplyKind | None
    ) -> None:
        self._link = link
        self._profile = profile
        self._kind, self._decoder_frame = replies, profile.frame
        self._decoder = FrameDecoder(profile.frame, replies)
        self._count = SampleCount(profile.frame)
        self._arrived: queue.SimpleQueue[_Arrived] = queue.SimpleQueue()
        self._replies: queue.SimpleQueue[Reply] = queue.SimpleQueue()
        self._outbox: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._asking = threading.Lock()
        self._closing = threading.Event()
        self._failure: DeviceFaultError | None = None
        self._frames = self._bytes = 0
        self._last_frame = time.monotonic()
        self._thread = threading.Thread(target=self._serve, name="imu-link", daemon=True)
        self._thread.start()

    @property
    def stats(self) -> LinkStats:
        """Counts since the link was opened."""
        d = self._decoder
        return LinkStats(self._frames, self._bytes, d.crc_errors, d.skipped, self._count.gaps)

    @property
    def received(self) -> int:
        """Bytes read and decoded since the link was opened."""
        return self._bytes

    @property
    def silence(self) -> float:
        """Host seconds since the last sound frame, or since the link was opened."""
        return time.monotonic() - self._last_frame

    def read(self) -> SampleBatch:
        """Samples since the last call. Raises DeviceFaultError where the link is lost or only noise comes."""
        parts = []
        while not self._arrived.empty():
            parts.append(self._arrived.get())
        if not parts:
            self._check()
            empty = np.empty(0)
            whole = np.empty(0, np.int64)
            return SampleBatch(whole, empty, np.empty((0, 6)), empty, whole, empty)
        counter = np.concatenate([p.counter for p in parts])
        taken = self._count.in_order(counter)
        seq = self._count.feed(counter[taken])
        return SampleBatch(
            seq,
            (seq + 1) / self._profile.stream.sample_rate_hz,
            np.concatenate([p.counts for p in parts])[taken],
            np.concatenate([p.temperature for p in parts])[taken],
            np.concatenate([p.status for p in parts])[taken],
            np.repeat([p.time for p in parts], [len(p.counter) for p in parts])[taken],
        )

    @abstractmethod
    def start(self, *, corrected: bool = False) -> None:
        """Begin to stream, see `interfaces.Imu`."""

    @abstractmethod
    def identify(self) -> ImuIdentity:
        """Model, serial number and firmware; raises OtherModelError where another model answers."""

    @abstractmethod
    def read_registers(self) -> dict[str, float]:
        """Calibration registers in SI by parameter."""

    @abstractmethod
    def write_registers(self, values: Mapping[str, float]) -> None:
        """Write calibration registers; parameters not named keep theirs."""

    @abstractmethod
    def commit(self) -> None:
        """Write the registers to flash, once: a lost answer is a fault, never a second flash cycle."""

    @abstractmethod
    def reset(self) -> None:
        """Restart the unit and wait until it answers again."""

    def close(self) -> None:
        """End the reader and close the port."""
        self._closing.set()
        self._thread.join(5.0)
        self._link.close()

    def exchange(
        self,
        request: bytes,
        take: Callable[[Reply], T | None],
        *,
        timeout: float,
        attempts: int,
    ) -> T:
        """Send a command and wait for the reply that `take` accepts.

        Parameters
        ----------
        take : what a reply says, None where it answers something else; may raise
        timeout : host time for each attempt, s

        Raises
        ------
        DeviceFaultError
            where nothing acceptable comes, or the link is lost.
        """
        with self._asking:
            while not self._replies.empty():
                self._replies.get()
            for _ in range(attempts):
                self._check()
                self._outbox.put(request)
                deadline = time.monotonic() + timeout
                while (left := deadline - time.monotonic()) > 0:
                    try:
                        reply = self._replies.get(timeout=min(left, 0.1))
                    except queue.Empty:
                        self._check()
                        continue
                    taken = take(reply)
                    if taken is not None:
                        return taken
        raise DeviceFaultError(self._unanswered(timeout))

    @property
    def lost(self) -> bool:
        """Whether the link has failed for good."""
        return self._failure is not None

    def _expect(self, frame: FrameSection) -> None:
        """Samples of another kind come from here on: forget what came before the last reply, read these frames."""
        if frame is not self._decoder_frame:
            before, decoder = self._decoder, FrameDecoder(frame, self._kind)
            decoder.crc_errors, decoder.skipped = before.crc_errors, before.skipped
            self._decoder, self._decoder_frame = decoder, frame
        while not self._arrived.empty():
            self._arrived.get()

    def _unanswered(self, timeout: float) -> str:
        where = f"IMU: no answer on {self._link.port} within {timeout:g} s"
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
                if data:
                    self._take(data, time.monotonic())
        except DeviceFaultError as exc:
            self._failure = exc
        except Exception as exc:  # noqa: BLE001 - a reader that dies silently would look like a unit without data
            failure = DeviceFaultError(f"IMU: reading {self._link.port} failed ({type(exc).__name__}: {exc})")
            failure.__cause__ = exc
            self._failure = failure

    def _take(self, data: bytes, now: float) -> None:
        decoder = self._decoder  # exchanged by the thread that asks
        decoded = decoder.feed(data)
        if len(decoded.frames):
            self._frames += len(decoded.frames)
            self._last_frame = now
            samples = decoder.samples(decoded.frames)
            if len(samples[0]):
                self._arrived.put(_Arrived(*samples, now))
        for reply in decoded.replies:
            self._replies.put(reply)
        self._bytes += len(data)
