"""Faults of the unit's samples and stream frames, injected on order for a time or a number of frames."""

import numpy as np

from calstation.bench.imu.frames import STREAM
from calstation.bench.truth import StreamOutput

#: Bytes of noise put before a frame.
_NOISE_BYTES = 7

_SATURATED = 2**31 - 1


class StreamFaults:
    """Modifies samples and frames according to the active faults.

    Counts of frames still to get a flipped bit (`corrupt`), to be omitted (`drop`), sent twice (`duplicate`), swapped
    with the next (`reorder`) or preceded by random bytes (`noise`). Device times, s, until which nothing is sent
    (`silent`), bytes are random (`garbled`), the first gyro channel saturates or is not a number (`invalid`), or
    channel number `frozen` repeats its last value.
    """

    def __init__(self, random: np.random.Generator) -> None:
        self._random = random
        self.frame_size = STREAM.itemsize
        self.corrupt = self.drop = self.duplicate = self.reorder = self.noise = 0
        self.silent_until = self.garbled_until = self.saturated_until = -np.inf
        self.invalid_until = self.frozen_until = -np.inf
        self.frozen = 0
        self._last: float | None = None

    def ends(self) -> tuple[float, ...]:
        """Device times at which timed faults end, s."""
        return (self.silent_until, self.garbled_until, self.saturated_until, self.invalid_until)

    def samples(self, output: StreamOutput, time: float) -> StreamOutput:
        """Samples around device time `time`, s, with the faults of the sensors."""
        counts, saturated = output.counts, output.saturated
        if time < self.saturated_until:
            counts, saturated = counts.copy(), np.ones_like(saturated)
            counts[:, 0] = _SATURATED
        if time < self.invalid_until:
            counts = counts.copy()
            counts[:, 0] = np.nan
        if time < self.frozen_until:
            counts = counts.copy()
            self._last = counts[0, self.frozen] if self._last is None else self._last
            counts[:, self.frozen] = self._last
        else:
            self._last = None
        return StreamOutput(counts, saturated)

    def frames(self, data: bytes, time: float) -> bytes:
        """Bytes that leave the line for frames sent around device time `time`, s."""
        if time < self.silent_until:
            return b""
        if time < self.garbled_until:
            return self._random.bytes(len(data))
        if not (self.corrupt or self.drop or self.duplicate or self.reorder or self.noise):
            return data
        size = self.frame_size
        frames = [data[i : i + size] for i in range(0, len(data), size)]
        dropped = min(self.drop, len(frames))
        self.drop -= dropped
        frames = frames[dropped:]
        sent: list[bytes] = []
        while frames:
            frame = frames.pop(0)
            if self.reorder and frames:
                self.reorder -= 1
                frame, frames[0] = frames[0], frame
            if self.noise:
                self.noise -= 1
                sent.append(self._random.bytes(_NOISE_BYTES))
            if self.corrupt:
                self.corrupt -= 1
                frame = self._flipped(frame)
            elif self.duplicate:
                self.duplicate -= 1
                sent.append(frame)
            sent.append(frame)
        return b"".join(sent)

    def _flipped(self, frame: bytes) -> bytes:
        spoilt = bytearray(frame)
        spoilt[int(self._random.integers(2, len(spoilt) - 2))] ^= 1 << int(self._random.integers(8))
        return bytes(spoilt)
