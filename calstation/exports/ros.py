"""ROS 2 parameters with the intrinsics of an IMU, as Direct LiDAR-Inertial Odometry reads them (``dlio.yaml``).

The node corrects (`odom.cc`, `callbackImu`), with `sm` in row order:

    accel = sm measured - bias          the same as `applyCalib` of the package imu_calib with its SM and bias
    gyro  = measured - bias

The covariances are those of a sample, in row order as in a message ``sensor_msgs/Imu``.
"""

import numpy as np

from calstation.exports import block_yaml
from calstation.exports.source import Corrector, ExportFormat, ExportSource, Files
from calstation.physics import FloatArray

_INTRINSICS = "imu/intrinsics"
_COMMENT = """IMU of calstation, unit {serial}; SI units, matrices in row order.
accel = sm * measured - bias; gyro = measured - bias; imu/calibration must be false, so that the values are used."""


def _write(source: ExportSource) -> Files:
    inverse = np.linalg.inv(source.matrix("accel"))
    noise = {"angular_velocity": source.gyro_noise, "linear_acceleration": source.accel_noise}
    parameters = {
        "imu/calibration": False,
        f"{_INTRINSICS}/accel/sm": inverse.ravel().tolist(),
        f"{_INTRINSICS}/accel/bias": (inverse @ source.vector("accel_bias")).tolist(),
        f"{_INTRINSICS}/gyro/bias": source.vector("gyro_bias"),
        **{f"{name}_covariance": (n.sample**2 * np.eye(3)).ravel().tolist() for name, n in noise.items()},
    }
    return {"": block_yaml.dump({"/**": {"ros__parameters": parameters}}, _COMMENT.format(serial=source.serial))}


def _read(files: Files) -> Corrector:
    parameters = block_yaml.load(files[""])["/**"]["ros__parameters"]
    matrix = np.array(parameters[f"{_INTRINSICS}/accel/sm"]).reshape(3, 3)
    accel_bias = np.array(parameters[f"{_INTRINSICS}/accel/bias"])
    gyro_bias = np.array(parameters[f"{_INTRINSICS}/gyro/bias"])

    def correct(gyro: FloatArray, accel: FloatArray) -> tuple[FloatArray, FloatArray]:
        return gyro - gyro_bias, accel @ matrix.T - accel_bias

    return correct


FORMAT = ExportFormat(frozenset({"gyro_bias", "accel_bias", "accel_scale", "accel_misalign"}), _write, _read)
