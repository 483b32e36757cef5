"""Base class of the IMU drivers, in which one thread owns the port, reads samples and sends commands."""

import queue
import threading
from collections.abc import Iterator
from typing import TypeVar, cast

import numpy as np

from calstation.devices.codecs import Reply, ReplyKind
from calstation.devices.imu.frames import FrameDecoder, Samples
from calstation.devices.imu.sample_count import SampleCount
from calstation.devices.interfaces import Imu, LinkStats, NoFramesError, SampleBatch
from calstation.devices.links import Dialogue, Link, Refusal, Transaction
from calstation.devices.profiles import FrameSection, ImuProfile
from calstation.errors import DeviceFaultError
from calstation.messages import Text

#: Host time for which the reader waits for bytes before it checks for commands to send, s.
_POLL_TIMEOUT = 0.02
#: Amount of data without a valid frame above which the link settings are considered wrong: a number of frames or, once
#: valid frames have arrived, a duration of the stream in s, so that a burst of noise does not suffice.
_NOISE_FRAMES, _NOISE_SECONDS = 40, 2.0

T = TypeVar("T")


class ImuRefusalError(DeviceFaultError, Refusal):
    """The unit refuses a command."""

    @property
    def reason(self) -> Text:
        """Meaning of the unit's error code."""
        return cast(Text, self.values["reason"])


class ImuBusyError(ImuRefusalError):
    """The unit cannot execute a command yet, because its flash is busy or it is still starting."""


class StreamedImu(Imu):
    """An IMU on a port, from which `read` returns samples and to which `exchange` sends commands.

    `serial` is the serial number entered by the operator, for a unit that does not report its own.
    """

    def __init__(self, link: Link, profile: ImuProfile, serial: str = "") -> None:
        self._link = link
        self._profile = profile
        self._serial = serial
        self._decoder_frame = profile.frame
        self._decoder = FrameDecoder(profile.frame, self.reply_kind(profile))
        self._count = SampleCount(profile.frame)
        self._samples: queue.SimpleQueue[tuple[Samples, float]] = queue.SimpleQueue()
        self._replies: queue.SimpleQueue[Reply] = queue.SimpleQueue()
        self._requests: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._dialogue = Dialogue(
            self._requests.put, self._receive, self._other_transactions, lambda reply, signature, refusal: refusal
        )
        self._exchange_lock = threading.Lock()
        self._closing = threading.Event()
        self._failure: DeviceFaultError | None = None
        self._frames = self._bytes = 0
        self._thread = threading.Thread(target=self._serve, name="imu-link", daemon=True)
        self._thread.start()

    @staticmethod
    def reply_kind(profile: ImuProfile) -> ReplyKind | None:
        """Return the kind of packets that reply to commands; None if the unit accepts no commands."""
        return None

    @property
    def stats(self) -> LinkStats:
        """Counts since the link was opened."""
        d, count = self._decoder, self._count
        return LinkStats(self._frames, self._bytes, d.crc_errors, d.skipped, count.gaps, count.restarts)

    @property
    def received(self) -> int:
        """Number of bytes read and decoded since the link was opened."""
        return self._bytes

    def read(self) -> SampleBatch:
        """Return the samples since the last call. Raises DeviceFaultError if the link is lost or only noise arrives."""
        parts = [self._samples.get() for _ in range(self._samples.qsize())]
        if not parts:
            self._check_link()
            nothing, whole = np.empty(0), np.empty(0, np.int64)
            return SampleBatch(whole, nothing, np.empty((0, 6)), nothing, whole, nothing)
        counter, counts, temperature, status = (
            np.concatenate(arrays) for arrays in zip(*(s for s, _ in parts), strict=True)
        )
        arrival = np.repeat([at for _, at in parts], [len(samples.counter) for samples, _ in parts])
        order = self._count.in_order(counter)
        seq = self._count.feed(counter[order])
        end = (seq + 1) / self._profile.stream.sample_rate_hz
        return SampleBatch(seq, end, counts[order], temperature[order], status[order], arrival[order])

    def close(self) -> None:
        """Stop the reader thread and close the port."""
        self._closing.set()
        self._thread.join(5.0)
        self._link.close()

    def exchange(self, transaction: Transaction[T], *, timeout: float, attempts: int, urgent: bool = False) -> T:
        """Send a command repeatedly until its reply arrives, and return the content of the reply.

        Raises DeviceFaultError if no acceptable reply arrives or the link is lost.

        Parameters
        ----------
        transaction : request and its expected reply
        timeout : host time for a reply, s
        attempts : maximum number of times that the request is sent
        urgent : whether the request is sent even if late replies may arrive
        """
        with self._exchange_lock:
            for attempt in range(attempts):
                self._check_link()
                content = self._dialogue.ask(transaction, timeout, urgent=urgent, again=urgent and attempt > 0)
                if content is not None:
                    return content
        raise self._no_answer(timeout)

    def _other_transactions(self) -> Iterator[Transaction[object]]:
        """Yield transactions with different signatures that every unit of this kind completes."""
        return iter(())

    def _receive(self, wait: float) -> list[Reply] | None:
        try:
            return [self._replies.get(wait > 0.0, min(wait, 0.1))]
        except queue.Empty:
            self._check_link()
            return None

    @property
    def lost(self) -> bool:
        """Whether the link has failed."""
        return self._failure is not None

    def _decode_from(self, frame: FrameSection) -> None:
        """Discard earlier samples and decode all later samples from frames of this kind."""
        if frame is not self._decoder_frame:
            before, decoder = self._decoder, FrameDecoder(frame, self.reply_kind(self._profile))
            decoder.crc_errors, decoder.skipped = before.crc_errors, before.skipped
            self._decoder, self._decoder_frame = decoder, frame
        while not self._samples.empty():
            self._samples.get()

    def _reset_noise_count(self) -> None:
        """Reset the count of bytes outside frames, because a unit that has restarted may send any bytes."""
        self._decoder.bytes_since_frame = 0

    def _no_answer(self, timeout: float) -> DeviceFaultError:
        if self._bytes == 0:
            code = "imu.silent"
        elif self._frames == 0:
            code = "imu.answer_not_framed"
        else:
            code = "imu.streams_without_answer"
        return DeviceFaultError(code, port=self._link.port, seconds=timeout)

    def _check_link(self) -> None:
        if self._failure is not None:
            raise self._failure
        seconds = _NOISE_SECONDS if self._frames else 0.0
        frames = max(_NOISE_FRAMES, round(seconds * self._profile.stream.sample_rate_hz))
        if self._decoder.bytes_since_frame > frames * self._decoder.size:
            raise NoFramesError("imu.no_frames", port=self._link.port)

    def _serve(self) -> None:
        try:
            while not self._closing.is_set():
                while not self._requests.empty():
                    self._link.write(self._requests.get())
                data = self._link.read(_POLL_TIMEOUT)
                if data:
                    self._decode(data, self._link.received_at)
        except DeviceFaultError as exc:
            self._failure = exc
        except Exception as exc:  # noqa: BLE001 - otherwise the unit would seem to send no data
            detail = f"{type(exc).__name__}: {exc}"
            self._failure = DeviceFaultError("imu.reader_failed", port=self._link.port, detail=detail)
            self._failure.__cause__ = exc

    def _decode(self, data: bytes, now: float) -> None:
        decoder = self._decoder  # the thread that sends commands may replace the attribute
        decoded = decoder.feed(data)
        if len(decoded.frames):
            samples = decoder.samples(decoded.frames)
            if len(samples.counter):
                self._samples.put((samples, now))
            self._frames += len(decoded.frames)
        for reply in decoded.replies:
            self._replies.put(reply)
        self._bytes += len(data)
