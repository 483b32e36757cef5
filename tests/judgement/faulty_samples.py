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
