"""Several IMUs on one body: a primary and secondaries, each with its place, its errors and its clock."""

from dataclasses import dataclass, replace

import numpy as np

from calstation.bench.truth.free_motion import FreeMotion
from calstation.bench.truth.free_unit import Field, Place, sampled
from calstation.bench.truth.imu import ImuTruth
from calstation.physics.arrays import FloatArray
from calstation.physics.parameters import group_matrix, group_vector

AT_POINT = Place(np.eye(3), np.zeros(3))


@dataclass(frozen=True)
class SecondaryTruth:
    """A further IMU: the unit, where it sits, and what is added to its time to get the primary's, s."""

    imu: ImuTruth
    place: Place
    offset: float = 0.0


def record_pair(
    primary: ImuTruth,
    secondaries: list[SecondaryTruth],
    motion: FreeMotion,
    duration: float,
    field: Field,
    seed: int | np.random.SeedSequence,
) -> tuple[FloatArray, FloatArray]:
    """Counts of the primary at the body's point, shape (n, 6), and of the others in the same rows, shape (n, k, 6).

    What shakes the body shakes all: that is the motion's; the field's vibration, drawn unit by unit, is left out.
    """
    field = replace(field, velocity_sigma=0.0)
    root = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
    count = int(duration * primary.sample_rate)
    seeds = root.spawn(1 + len(secondaries))
    counts, _ = sampled(primary, motion, AT_POINT, field, count, seeds[0])
    others = [
        sampled(s.imu, motion, s.place, field, count, own, begin=s.offset)[0]
        for s, own in zip(secondaries, seeds[1:], strict=True)
    ]
    return counts, np.stack(others, axis=1) if others else np.empty((count, 0, 6))


def pair_truth(primary: ImuTruth, secondary: SecondaryTruth) -> dict[str, FloatArray]:
    """What cross-calibration is to find: C and b of both sensors, the lever, the offset.

    Measured by the primary y = M₁ x + b₁, by the secondary M₂ Tᵀ x + b₂ with T from its frame to the body's, so
    C = M₂ Tᵀ M₁⁻¹ and b = b₂ − C b₁.
    """
    found: dict[str, FloatArray] = {"lever": secondary.place.arm, "clock_offset": np.array(secondary.offset)}
    for sensor in ("gyro", "accel"):
        first, second = (
            np.eye(3) + group_matrix(imu.parameters, f"{sensor}_scale", f"{sensor}_misalign")
            for imu in (primary, secondary.imu)
        )
        C = second @ secondary.place.turn.T @ np.linalg.inv(first)
        found[f"{sensor}_matrix"] = C
        found[f"{sensor}_bias"] = group_vector(secondary.imu.parameters, f"{sensor}_bias") - C @ group_vector(
            primary.parameters, f"{sensor}_bias"
        )
    return found
