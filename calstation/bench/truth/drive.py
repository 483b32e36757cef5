"""The motion of the two joints, and their encoders with errors."""

from dataclasses import dataclass

import numpy as np

from calstation.bench.truth.kinematics import SETTLED_AMPLITUDE, JointProfile
from calstation.physics import FloatArray


@dataclass(frozen=True)
class EncoderTruth:
    """Errors of the joints' encoders, rad.

    `stop_sigma` is the sigma of the stopping error, which is drawn for each move of a joint and reached at its end.
    `periodic` and `phase` describe an error with one period per turn. `white_sigma` is the noise of each reading.
    """

    stop_sigma: float = np.deg2rad(0.05)
    periodic: float = np.deg2rad(0.005)
    phase: tuple[float, float] = (0.0, 0.0)
    white_sigma: float = np.deg2rad(0.0005)


class TableDrive:
    """Motion and encoders of both joints, with true `angles` at power-on, rad, and a `seed` of the encoder errors."""

    def __init__(
        self, encoder: EncoderTruth, angles: tuple[float, float] = (0.0, 0.0), seed: int | np.random.SeedSequence = 0
    ) -> None:
        self._encoder = encoder
        self._random = np.random.default_rng(seed)
        # The joints are at rest before time 0, because a table is settled when it is switched on.
        self.profiles = [JointProfile.rest(angle, -1.0) for angle in angles]
        offsets = encoder.stop_sigma * self._random.standard_normal(2)
        # For each joint, the angles between which the stopping error changes, and the errors at these angles, rad.
        self._stop_errors = [(angle, angle, float(e), float(e)) for angle, e in zip(angles, offsets, strict=True)]

    @property
    def end(self) -> float:
        """Time at which both commands have reached their targets, s."""
        return max(profile.end for profile in self.profiles)

    @property
    def settled(self) -> float:
        """Time from which both joints are settled, s."""
        return max(profile.settling_time(SETTLED_AMPLITUDE) for profile in self.profiles)

    def move(
        self, time: float, targets: tuple[float, float], rates: tuple[float, float], accelerations: tuple[float, float]
    ) -> None:
        """Start moving both joints at `time`, each with its own trapezoidal profile; s, rad, rad/s, rad/s²."""
        for joint, target in enumerate(targets):
            self.move_joint(time, joint, target, rates[joint], accelerations[joint])

    def move_joint(self, time: float, joint: int, target: float, rate: float, acceleration: float) -> None:
        """Start moving one joint independently of the other.

        Parameters
        ----------
        time : s
        joint : 0 for the outer, 1 for the inner
        target, rate, acceleration : absolute angle, rad, and limits of the profile, rad/s, rad/s²
        """
        profile = self.profiles[joint]
        next_profile = profile.move(time, target, rate, acceleration)
        if next_profile is not profile:
            start = profile.target
            error = float(self._repeatability(joint, np.array([start]))[0])
            stop_error = self._encoder.stop_sigma * float(self._random.standard_normal())
            self._stop_errors[joint] = (start, target, error, stop_error)
            self.profiles[joint] = next_profile

    def stop(self, time: float, decelerations: tuple[float, float]) -> None:
        """Decelerate both joints to rest from `time`, s; `decelerations` are in rad/s²."""
        for joint, profile in enumerate(self.profiles):
            self.profiles[joint] = profile.stop(time, decelerations[joint])

    def states(self, time: float) -> FloatArray:
        """Return the true angle, rate and acceleration of outer and inner joint at `time`, s, shape (2, 3)."""
        return np.array([profile.states(np.array([time]))[0] for profile in self.profiles])

    def readings(self, times: FloatArray) -> FloatArray:
        """Return encoder angles at `times` (s, shape (n,)), rad, shape (n, 2); noise is drawn for each reading."""
        times = np.asarray(times, dtype=np.float64)
        angles = np.column_stack([profile.states(times)[:, 0] for profile in self.profiles])
        noise = self._encoder.white_sigma * self._random.standard_normal(angles.shape)
        periodic = self._encoder.periodic * np.sin(angles + np.asarray(self._encoder.phase))
        stops = np.column_stack([self._repeatability(joint, angles[:, joint]) for joint in (0, 1)])
        return np.asarray(angles + noise + periodic + stops)

    def _repeatability(self, joint: int, angles: FloatArray) -> FloatArray:
        start, end, before, after = self._stop_errors[joint]
        if start == end:
            return np.full(len(angles), after)
        return np.asarray(before + (after - before) * np.clip((angles - start) / (end - start), 0.0, 1.0))
