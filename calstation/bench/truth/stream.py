"""The output of a unit on the table: truth, vibration, noise and counts, continued from call to call."""

import numpy as np

from calstation.bench.truth.imu import Digitiser, ImuTruth, StreamOutput, true_increments
from calstation.bench.truth.kinematics import JointProfile
from calstation.bench.truth.noise import Vibration
from calstation.bench.truth.table import TableTruth


class SensorStream:
    """Samples of one unit on one table; they do not depend on the sizes of the requests."""

    def __init__(self, imu: ImuTruth, table: TableTruth, seed: int | np.random.SeedSequence) -> None:
        self.interval = 1.0 / imu.sample_rate
        self.produced = 0
        self._random = np.random.Generator(np.random.PCG64(seed))
        self._model = imu.error_model()
        self._chain = table.chain()
        self._field = np.array([table.up_force_n, table.earth_rate_n])
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
        joints = (outer.segments, outer.still, inner.segments, inner.still)
        increments = true_increments(
            self._model, self._chain, self._field, *joints, self.produced, self.interval, velocity
        )
        self.produced += count
        return self._digitiser.digitise(increments, normals)
