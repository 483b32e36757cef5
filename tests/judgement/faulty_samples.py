"""Faults that are injected into the samples of a stage, or into the configuration with which they are read."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from calstation.estimation.common import ImuModel, SampleBlock

#: Change of the counts, shape (n, 6), and of the angles, shape (n, 2).
Change = Callable[[np.ndarray, np.ndarray], None]


def with_columns(block: SampleBlock, change: Change) -> SampleBlock:
    """Return the block with changed counts and angles."""
    counts, angles = block.counts.copy(), block.angles.copy()
    change(counts, angles)
    return replace(block, counts=counts, angles=angles)


def exchange_angles(counts: np.ndarray, angles: np.ndarray) -> None:
    """Exchange outer and inner angle."""
    angles[:] = angles[:, ::-1].copy()


def reverse_angle(joint: int) -> Change:
    """Reverse the angle of a joint."""

    def change(counts: np.ndarray, angles: np.ndarray) -> None:
        angles[:, joint] *= -1.0

    return change


def reverse(channel: int) -> Change:
    """Reverse a channel."""

    def change(counts: np.ndarray, angles: np.ndarray) -> None:
        counts[:, channel] *= -1.0

    return change


def exchange(a: int, b: int) -> Change:
    """Exchange two channels."""

    def change(counts: np.ndarray, angles: np.ndarray) -> None:
        counts[:, [a, b]] = counts[:, [b, a]]

    return change


def turn_unit(counts: np.ndarray, angles: np.ndarray) -> None:
    """Turn the unit by 90° about its z axis."""
    counts[:] = counts[:, [1, 0, 2, 4, 3, 5]] * np.array([-1.0, 1.0, 1.0, -1.0, 1.0, 1.0])


def offset(channel: int, counts_added: float) -> Change:
    """Add an offset to a channel."""

    def change(counts: np.ndarray, angles: np.ndarray) -> None:
        counts[:, channel] += counts_added

    return change


def modulo(counts: np.ndarray, angles: np.ndarray) -> None:
    """Record the angles at the rests and modulo a turn only."""
    moving = np.abs(np.gradient(angles, axis=0)).max(axis=1) > 1e-6
    angles[:] = (angles + 1e-9) % (2.0 * np.pi)
    angles[moving] = np.nan


def other_kind(imu: ImuModel) -> ImuModel:
    """Return the model with the other kind of output."""
    return replace(imu, output="rate" if imu.output == "increment" else "increment")


def rows(block: SampleBlock, chosen: np.ndarray) -> SampleBlock:
    """Return the chosen rows with a continuous counter and clock, as if nothing had been lost or added."""
    count = len(chosen)
    columns = ("counts", "angles", "step", "valid", "temperature", "others", "joints", "station")
    period = block.time[1] - block.time[0]
    return replace(
        block,
        seq=block.seq[0] + np.arange(count),
        time=block.time[0] + period * np.arange(count),
        **{name: getattr(block, name)[chosen] for name in columns},
    )


def lose(block: SampleBlock, at: list[int]) -> SampleBlock:
    """Lose samples without a gap in the counter."""
    return rows(block, np.delete(np.arange(len(block)), at))


def double(block: SampleBlock, at: list[int]) -> SampleBlock:
    """Record samples twice."""
    return rows(block, np.sort(np.concatenate([np.arange(len(block)), at])))


def repeat(block: SampleBlock, at: list[int]) -> SampleBlock:
    """Replace samples by the ones before."""

    def change(counts: np.ndarray, angles: np.ndarray) -> None:
        counts[at] = counts[np.array(at) - 1]

    return with_columns(block, change)


def spike(block: SampleBlock, channel: int, at: list[int], size: float) -> SampleBlock:
    """Add single spikes, counts."""

    def change(counts: np.ndarray, angles: np.ndarray) -> None:
        counts[at, channel] += np.rint(size)

    return with_columns(block, change)


def stick(block: SampleBlock, channel: int, at: int, count: int) -> SampleBlock:
    """Repeat one value of a channel."""

    def change(counts: np.ndarray, angles: np.ndarray) -> None:
        counts[at : at + count, channel] = counts[at, channel]

    return with_columns(block, change)


def wrap(block: SampleBlock, channel: int) -> SampleBlock:
    """Send a channel as a number of 16 bits."""

    def change(counts: np.ndarray, angles: np.ndarray) -> None:
        counts[:, channel] = (counts[:, channel] + 2.0**15) % 2.0**16 - 2.0**15

    return with_columns(block, change)


def dead_zone(block: SampleBlock, channel: int, width: float) -> SampleBlock:
    """Output 0 for values below `width`, counts."""

    def change(counts: np.ndarray, angles: np.ndarray) -> None:
        counts[np.abs(counts[:, channel]) < width, channel] = 0.0

    return with_columns(block, change)


def stiction(block: SampleBlock, channel: int, width: float) -> SampleBlock:
    """Keep the output of a channel until it has changed by `width`, counts."""

    def change(counts: np.ndarray, angles: np.ndarray) -> None:
        kept = counts[0, channel]
        for k in range(len(counts)):
            if abs(counts[k, channel] - kept) > width:
                kept = counts[k, channel]
            counts[k, channel] = kept

    return with_columns(block, change)


def clip(block: SampleBlock, channel: int, level: float) -> SampleBlock:
    """Clip a channel of increments at `level`, counts, and carry the remainder over to the next samples."""

    def change(counts: np.ndarray, angles: np.ndarray) -> None:
        remainder = 0.0
        for k in range(len(counts)):
            value = counts[k, channel] + remainder
            counts[k, channel] = min(max(value, -level), level)
            remainder = value - counts[k, channel]

    return with_columns(block, change)
