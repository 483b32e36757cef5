"""The output of a unit on the table: truth, vibration, noise and counts, continued from call to call."""

import numpy as np

from calstation.bench.truth.effects import Changes
from calstation.bench.truth.imu import Digitiser, ImuTruth, StreamOutput, true_increments
from calstation.bench.truth.kinematics import JointProfile
from calstation.bench.truth.noise import Vibration
from calstation.bench.truth.table import TableTruth
from calstation.physics import FloatArray


class SensorStream:
    """Samples of one unit on one table; they do not depend on the sizes of the requests.

    `interval` is the true duration of a sample, s, which differs from the nominal one if the unit's clock is wrong. The
    table's motion is given in the time of another unit, which runs `rate` times as fast as this unit's time and equals
    `begin`, s, when this unit's time is 0; gravity and the rotation of the earth are per second of this unit.
    """

    def __init__(
        self,
        imu: ImuTruth,
        table: TableTruth,
        seed: int | np.random.SeedSequence,
        *,
        rate: float = 1.0,
        begin: float = 0.0,
    ) -> None:
        self.interval = imu.interval
        self.produced = 0
        root = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
        self._random = np.random.Generator(np.random.PCG64(root))
        self._imu = imu
        self._changes = Changes(imu.effects, self.interval, np.random.default_rng(root.spawn(1)[0]))
        self._model = imu.error_model()
        self._chain = table.chain()
        self._field = np.array([table.up_force_n, table.earth_rate_n]) / rate
        self._table_interval, self._begin = self.interval * rate, begin
        drifts = imu.gyro_bias_instability != 0.0 or imu.accel_bias_instability != 0.0
        self._digitiser = Digitiser(imu, instability=drifts)
        if drifts:
            self._digitiser.start_drift(self._random)
        self._vibration = Vibration(table.velocity_sigma, self.interval, self._random)
        self._columns = self._digitiser.columns + (6 if self._vibration.active else 0)

    @property
    def time(self) -> float:
        """End of the last sample produced, s."""
        return self.produced * self.interval

    def produce(self, count: int, outer: JointProfile, inner: JointProfile) -> StreamOutput:
        """Return the next `count` samples while the joints follow these profiles."""
        normals = self._random.standard_normal((count, self._columns))
        vibration = self._vibration
        velocity = vibration.velocities(normals[:, -6:]) if vibration.active else np.zeros((count + 1, 3))
        outer, inner = _later(outer, -self._begin), _later(inner, -self._begin)
        increments = self._increments(velocity, outer, inner)
        if delay := self._imu.effects.accel_delay:
            increments[:, 3:] = self._increments(velocity, _later(outer, delay), _later(inner, delay))[:, 3:]
        if self._imu.effects.changing:
            self._changes.apply(increments, self.produced)
        self.produced += count
        return self._digitiser.digitise(increments, normals)

    @property
    def parameters(self) -> FloatArray:
        """The unit's 30 parameters at the end of the last sample produced, SI, shape (30,)."""
        return self._changes.parameters(self._imu.parameters, self.time)

    def _increments(self, velocity: FloatArray, outer: JointProfile, inner: JointProfile) -> FloatArray:
        joints = (outer.segments, outer.still, inner.segments, inner.still)
        samples = self.produced, self._table_interval, velocity
        return true_increments(self._model, self._chain, self._field, *joints, *samples)


def _later(profile: JointProfile, seconds: float) -> JointProfile:
    """Return the same motion `seconds` later."""
    later = np.array([seconds, 0.0, 0.0, 0.0, 0.0, 0.0])
    return JointProfile(profile.segments + later) if seconds else profile
