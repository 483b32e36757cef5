"""Faults of samples and stream frames, injected for a time or a number of frames."""

import numpy as np

from calstation.bench.truth import StreamOutput

#: Number of random bytes inserted before a frame.
_NOISE_BYTES = 7

_SATURATED = 2**31 - 1


class StreamFaults:
    """Modifies samples and frames according to the active faults.

    `counts` contains, by fault, the number of frames that are still to be corrupted by a flipped bit, omitted, sent
    twice, swapped with the next frame, or preceded by random bytes. `until` contains, by fault, the device time, s,
    until which nothing is sent, bytes are random, or the first gyro channel saturates or is NaN. Channel number
    `frozen` repeats its last value until `frozen_until`.
    """

    def __init__(self, random: np.random.Generator, frame_size: int) -> None:
        self._random, self._frame_size = random, frame_size
        self.counts = dict.fromkeys(
            ("corrupt_frames", "drop_frames", "duplicate_frames", "reorder_frames", "noise_bytes"), 0
        )
        self.until = dict.fromkeys(("silence_imu", "garble_imu", "saturate_imu", "invalid_imu"), -np.inf)
        self.frozen, self.frozen_until = 0, -np.inf
        self._last: float | None = None

    def samples(self, output: StreamOutput, time: float) -> StreamOutput:
        """Return the samples around device time `time`, s, with the active sensor faults."""
        counts, saturated = output.counts, output.saturated
        if time < self.until["saturate_imu"]:
            counts, saturated = counts.copy(), np.ones_like(saturated)
            counts[:, 0] = _SATURATED
        if time < self.until["invalid_imu"]:
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
        """Return the bytes transmitted for frames around device time `time`, s."""
        if time < self.until["silence_imu"]:
            return b""
        if time < self.until["garble_imu"]:
            return self._random.bytes(len(data))
        counts, size = self.counts, self._frame_size
        if not any(counts.values()):
            return data
        frames = [data[i : i + size] for i in range(0, len(data), size)]
        dropped = min(counts["drop_frames"], len(frames))
        counts["drop_frames"] -= dropped
        frames = frames[dropped:]
        sent: list[bytes] = []
        while frames:
            frame = frames.pop(0)
            if counts["reorder_frames"] and frames:
                counts["reorder_frames"] -= 1
                frame, frames[0] = frames[0], frame
            if counts["noise_bytes"]:
                counts["noise_bytes"] -= 1
                sent.append(self._random.bytes(_NOISE_BYTES))
            if counts["corrupt_frames"]:
                counts["corrupt_frames"] -= 1
                corrupted = bytearray(frame)
                corrupted[int(self._random.integers(2, len(corrupted) - 2))] ^= 1 << int(self._random.integers(8))
                frame = bytes(corrupted)
            elif counts["duplicate_frames"]:
                counts["duplicate_frames"] -= 1
                sent.append(frame)
            sent.append(frame)
        return b"".join(sent)
