"""The profile of a simulated IMU, which solvers assume."""

from calstation.bench.truth import ImuTruth
from calstation.estimation.common import ImuModel


def imu_model(imu: ImuTruth, serial: str = "SIM") -> ImuModel:
    """Return output format and noise of a simulated IMU."""
    return ImuModel(
        serial,
        imu.sample_rate,
        imu.output,
        imu.gyro_lsb,
        imu.accel_lsb,
        imu.gyro_arw,
        imu.accel_vrw,
        imu.gyro_bias_instability,
        imu.accel_bias_instability,
    )
