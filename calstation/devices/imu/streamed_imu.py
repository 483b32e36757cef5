"""What every IMU driver shares: one thread that owns the port, reads samples from it and sends commands."""

import queue
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from calstation.devices.codecs.packets import Reply, ReplyKind
from calstation.devices.imu.frames import FrameDecoder
from calstation.devices.imu.sample_count import SampleCount
from calstation.devices.interfaces import ImuIdentity, LinkStats, NoFramesError, SampleBatch
from calstation.devices.links.serial_link import SerialLink
from calstation.devices.links.unanswered import QUIET, Unanswered
from calstation.devices.profiles.frame import FrameSection
from calstation.devices.profiles.imu import ImuProfile
from calstation.devices.profiles.imu_sections import CommandSection
from calstation.errors import DeviceFaultError
from calstation.physics.arrays import FloatArray, IntArray

#: Host time the reader waits for bytes before it looks for commands to send, s.
_WAIT = 0.02
#: Frames' worth of bytes without one sound frame that count as a wrong setting of the link: of a link that has had no
#: sound frame yet, and of one that works, by the stream's rate, for which noise of a moment is none.
_NOISE_FRAMES, _NOISE_SECONDS = 40, 2.0

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)


class ImuRefusalError(DeviceFaultError):
    """The unit understands and refuses a command; `reason` is what it says, "" where that is all the message."""

    def __init__(self, text: str, reason: str = "") -> None:
        super().__init__(text)
        self.reason = reason


class ImuBusyError(ImuRefusalError):
    """The unit cannot do it yet: its flash is being burnt, or it still wakes up."""


@dataclass(frozen=True)
class Question(Generic[T_co]):
    """A command that is answered.

    Attributes
    ----------
    request : as it goes out
    look : what its answer has in common with those to other commands that could be taken for it
    take : what a reply says, None where it answers something else; raises ImuRefusalError
    """

    request: bytes
    look: Hashable
    take: Callable[[Reply], T_co | None]


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
        self._unanswered = Unanswered()
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
        count = self._count
        return LinkStats(self._frames, self._bytes, d.crc_errors, d.skipped, count.gaps, count.restarts)

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
    def wake(self, check_cancelled: Callable[[], None], *, corrected: bool = False) -> ImuIdentity | None:
        """Find a unit that may have restarted by itself, see `interfaces.Imu`."""

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

    def exchange(self, question: Question[T], *, timeout: float, attempts: int, urgent: bool = False) -> T:
        """Send a command and wait for its reply.

        A reply that came late would be taken for the next one's. So nothing is sent whose answer would look like one
        that may still come, before the unit has answered a question that looks otherwise.

        Parameters
        ----------
        timeout : host time for each attempt, s
        urgent : may be told twice and must not wait: it is sent at once in any case, and again where needed

        Raises
        ------
        DeviceFaultError
            where nothing acceptable comes, or the link is lost.
        """
        with self._asking:
            for attempt in range(attempts):
                if question.look in self._unanswered and not (urgent and attempt):
                    if urgent:
                        self._outbox.put(question.request)
                        self._unanswered.add(question.look)
                    self._listen_until_quiet(timeout)
                    if not self._between(timeout):
                        continue
                taken = self._attempt(question, timeout)
                if taken is not None:
                    return taken
        raise DeviceFaultError(self._unheard(timeout))

    def _other_questions(self) -> Iterator[Question[object]]:
        """Questions to any unit of this kind whose answers look differently from each other."""
        return iter(())

    def _between(self, timeout: float) -> bool:
        """Ask what looks like nothing that may still come; whether it is answered, and so all that was asked before."""
        while True:
            for question in self._other_questions():
                if question.look not in self._unanswered:
                    try:
                        return self._attempt(question, timeout) is not None
                    except ImuRefusalError:
                        return True
            if not self._unanswered:
                return True
            self._unanswered.forget_oldest()

    def _attempt(self, question: Question[T], timeout: float) -> T | None:
        """Send a command once; None where it is not answered in time."""
        self._check()
        while not self._replies.empty():
            self._replies.get()
        self._outbox.put(question.request)
        deadline = time.monotonic() + timeout
        while (left := deadline - time.monotonic()) > 0:
            try:
                reply = self._replies.get(timeout=min(left, 0.1))
            except queue.Empty:
                self._check()
                continue
            try:
                taken = question.take(reply)
            except ImuRefusalError:
                if set(self._unanswered) <= {question.look}:
                    self._unanswered.answered(question.look)
                    raise
                # It may be an older command's, and then none before that will be answered any more.
                self._unanswered.forget_oldest()
                continue
            if taken is not None:
                self._unanswered.answered(question.look)
                return taken
        self._unanswered.add(question.look)
        return None

    def _listen_until_quiet(self, timeout: float) -> None:
        """Wait until no reply comes any more, for as long as one may take: some units talk unasked."""
        deadline = time.monotonic() + timeout
        with suppress(queue.Empty):
            while time.monotonic() < deadline:
                self._replies.get(timeout=QUIET)

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

    def _forget_noise(self) -> None:
        """What came so far is no sign of a wrong setting: a unit that restarted may send what nobody asked for."""
        self._decoder.since_frame = 0

    def _unheard(self, timeout: float) -> str:
        where = f"IMU: no answer on {self._link.port} within {timeout:g} s"
        if self._bytes == 0:
            return f"{where}, not a byte came; check power, cable and port"
        if self._frames == 0:
            return f"{where}, the bytes that come are no frames; check baud, parity and the IMU profile"
        return f"{where} though samples come; check the transmit line and the IMU profile"

    def _check(self) -> None:
        if self._failure is not None:
            raise self._failure
        seconds = _NOISE_SECONDS if self._frames else 0.0
        frames = max(_NOISE_FRAMES, round(seconds * self._profile.stream.sample_rate_hz))
        if self._decoder.since_frame > frames * self._decoder.size:
            raise NoFramesError(
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
            failure = DeviceFaultError(
                f"IMU: reading {self._link.port} failed ({type(exc).__name__}: {exc}); start again, and send this text"
                " to whoever looks after calstation where it comes back"
            )
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
