"""Joint trajectories in closed form: trapezoidal rate profiles filtered by the resonance of the drive.

The command u(t) has piecewise constant acceleration. The joint follows it like a load on a spring, y = u − d with
d'' + 2ζω d' + ω² d = u''; on each segment, d is a damped oscillation about a constant deflection.
"""

from dataclasses import dataclass

import numpy as np

from calstation.physics import FloatArray, kernel

#: Undamped frequency of the drive, rad/s, and its damping ratio.
DRIVE_FREQUENCY = 2.0 * np.pi * 12.0
DRIVE_DAMPING = 0.2
#: Oscillation amplitudes below which a joint is settled, and completely at rest, rad.
SETTLED_AMPLITUDE = 1e-6
REST_AMPLITUDE = 1e-12

_DECAY = DRIVE_DAMPING * DRIVE_FREQUENCY
_DAMPED = DRIVE_FREQUENCY * np.sqrt(1.0 - DRIVE_DAMPING**2)


@kernel
def joint_state(segments: FloatArray, rest_time: float, time: float) -> tuple[float, float, float]:
    """Return angle, rate and acceleration of a joint at one time; rad, rad/s, rad/s².

    Parameters
    ----------
    segments : start time of each segment, s, and at this time the angle, rad, rate, rad/s, and acceleration, rad/s², of
        the command, the deviation, rad, and its rate, rad/s, shape (k, 6)
    rest_time : time from which the joint is completely at rest at the last row's angle, s
    time : s
    """
    last = segments.shape[0] - 1
    if time >= rest_time:
        return segments[last, 1], 0.0, 0.0
    row = 0
    while row < last and time >= segments[row + 1, 0]:
        row += 1
    s = time - segments[row, 0]
    acceleration = segments[row, 3]
    deflection = acceleration / (DRIVE_FREQUENCY * DRIVE_FREQUENCY)
    cosine_part = segments[row, 4] - deflection
    sine_part = (segments[row, 5] + _DECAY * cosine_part) / _DAMPED
    envelope = np.exp(-_DECAY * s)
    c = np.cos(_DAMPED * s)
    n = np.sin(_DAMPED * s)
    deviation = deflection + envelope * (cosine_part * c + sine_part * n)
    deviation_rate = envelope * (
        (_DAMPED * sine_part - _DECAY * cosine_part) * c - (_DAMPED * cosine_part + _DECAY * sine_part) * n
    )
    return (
        segments[row, 1] + segments[row, 2] * s + 0.5 * acceleration * s * s - deviation,
        segments[row, 2] + acceleration * s - deviation_rate,
        DRIVE_FREQUENCY * DRIVE_FREQUENCY * deviation + 2.0 * _DECAY * deviation_rate,
    )


@kernel
def _joint_states(segments: FloatArray, rest_time: float, times: FloatArray) -> FloatArray:
    states = np.empty((times.shape[0], 3))
    for i in range(times.shape[0]):
        states[i, 0], states[i, 1], states[i, 2] = joint_state(segments, rest_time, times[i])
    return states


@dataclass(frozen=True)
class JointProfile:
    """The motion of one joint from a start time; `segments` are as in `joint_state`, with the last row at rest."""

    segments: FloatArray

    @classmethod
    def rest(cls, angle: float, time: float = 0.0) -> "JointProfile":
        """Create the profile of a joint at rest at `angle`, rad, from `time`, s."""
        return cls(np.array([[time, angle, 0.0, 0.0, 0.0, 0.0]]))

    @property
    def target(self) -> float:
        """Angle at which the joint comes to rest, rad."""
        return float(self.segments[-1, 1])

    @property
    def end(self) -> float:
        """Time at which the command reaches its target, s."""
        return float(self.segments[-1, 0])

    def settling_time(self, tolerance: float) -> float:
        """Return the time, s, from which the oscillation about the target stays below `tolerance`, rad."""
        start, deviation, deviation_rate = self.segments[-1, [0, 4, 5]]
        amplitude = np.hypot(deviation, (deviation_rate + _DECAY * deviation) / _DAMPED)
        return float(start + max(0.0, np.log(max(amplitude, 1e-300) / tolerance) / _DECAY))

    @property
    def rest_time(self) -> float:
        """Time from which the joint is completely at rest, s."""
        return self.settling_time(REST_AMPLITUDE)

    def states(self, times: FloatArray) -> FloatArray:
        """Return angle, rate and acceleration at `times` (s, shape (n,)); rad, rad/s, rad/s², shape (n, 3)."""
        return _joint_states(self.segments, self.rest_time, np.asarray(times, dtype=np.float64))

    def command(self, time: float) -> tuple[float, float]:
        """Return the commanded angle and rate at `time`, s; rad and rad/s."""
        row = max(int(np.searchsorted(self.segments[:, 0], time, side="right")) - 1, 0)
        start, angle, rate, acceleration = self.segments[row, :4]
        s = time - start
        return float(angle + rate * s + 0.5 * acceleration * s * s), float(rate + acceleration * s)

    def move(self, time: float, target: float, rate: float, acceleration: float) -> "JointProfile":
        """Return a trapezoidal profile to `target` (rad) with limits `rate` (rad/s) and `acceleration` (rad/s²).

        Raises ValueError if the joint's command is still moving at `time`, or if rate or acceleration is not positive.
        """
        if not (rate > 0.0 and acceleration > 0.0):
            raise ValueError("rate and acceleration must be positive")
        start, speed = self.command(time)
        if time < self.end or speed != 0.0:
            raise ValueError("the joint is moving")
        distance = abs(target - start)
        if distance == 0.0:
            return self
        sign = np.sign(target - start)
        peak = min(rate, np.sqrt(distance * acceleration))
        ramp = peak / acceleration
        cruise = max(distance / peak - ramp, 0.0)
        return self._continue(time, [(ramp, sign * acceleration), (cruise, 0.0), (ramp, -sign * acceleration)], target)

    def stop(self, time: float, deceleration: float) -> "JointProfile":
        """Return a profile that decelerates to rest from the commanded rate at `time`, s, by `deceleration`, rad/s²."""
        _, speed = self.command(time)
        if time >= self.end or speed == 0.0:
            return self
        return self._continue(time, [(abs(speed) / deceleration, -np.sign(speed) * deceleration)], None)

    def _continue(self, time: float, pieces: list[tuple[float, float]], target: float | None) -> "JointProfile":
        """Return a profile that continues at `time` with `pieces` (duration s, acceleration rad/s²) and then rests.

        The joint rests at `target`, or at the end of the pieces. The segment before `time` is kept.
        """
        angle, rate = self.command(time)
        state = self.states(np.array([time]))[0]
        deviation, deviation_rate = angle - state[0], rate - state[1]
        rows = [(time, angle, rate, pieces[0][1], deviation, deviation_rate)]
        for (duration, acceleration), following in zip(pieces, [*pieces[1:], (0.0, 0.0)], strict=True):
            angle += rate * duration + 0.5 * acceleration * duration**2
            rate += acceleration * duration
            alone = np.array([rows[-1]])
            reached = _joint_states(alone, np.inf, np.array([rows[-1][0] + duration]))[0]
            deviation, deviation_rate = angle - reached[0], rate - reached[1]
            rows.append((rows[-1][0] + duration, angle, rate, following[1], deviation, deviation_rate))
        running = max(int(np.searchsorted(self.segments[:, 0], time, side="right")) - 1, 0)
        final = np.vstack([self.segments[running], rows])
        final[-1, 1] = angle if target is None else target
        final[-1, 2] = 0.0
        return JointProfile(final)
