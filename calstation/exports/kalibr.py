"""Kalibr's IMU configuration (``imu.yaml``) with its intrinsics, model ``scale-misalignment-size-effect``.

Kalibr predicts the measurements from the motion (`IccSensors.py`, `IccScaledMisalignedSizeEffectImu`):

    accel  measured = M (f + Σ E_i (ω × (ω × r_i) + dω/dt × r_i)) + b     M lower triangular, E_i selects axis i
    gyro   measured = M C_gyro_i ω + A C_gyro_i f + b                     M lower triangular, C_gyro_i a rotation

It estimates biases itself and does not read them.
"""

from typing import Any

import numpy as np

from calstation.exports import block_yaml
from calstation.exports.source import Corrector, ExportFormat, ExportSource, Files
from calstation.physics import AXES, FloatArray

_COMMENT = """IMU of calstation, unit {serial}; SI units.
measured = M f for the accelerometers, M C_gyro_i w for the gyros; biases are estimated by Kalibr.
noise_density per sqrt(Hz); random_walk has the Allan deviation of the bias instability at 1000 s."""


def _write(source: ExportSource) -> Files:
    matrix, rotation = _lower_and_rotation(source.matrix("gyro"))
    arms = np.diag(source.vector("inner_lever"))
    content: dict[str, Any] = {
        "model": "scale-misalignment-size-effect",
        "rostopic": "/imu0",
        "update_rate": source.imu.sample_rate_hz,
        "time_offset": 0.0,
        "T_i_b": np.eye(4).tolist(),
        "accelerometer_noise_density": source.accel_noise.density,
        "accelerometer_random_walk": source.accel_noise.random_walk,
        "gyroscope_noise_density": source.gyro_noise.density,
        "gyroscope_random_walk": source.gyro_noise.random_walk,
        "accelerometers": {
            "M": source.matrix("accel").tolist(),
            **{f"r{axis}_i": arms[i].tolist() for i, axis in enumerate(AXES)},
        },
        "gyroscopes": {"M": matrix.tolist(), "A": np.zeros((3, 3)).tolist(), "C_gyro_i": rotation.tolist()},
    }
    return {"": block_yaml.dump({"imu0": content}, _COMMENT.format(serial=source.serial))}


def _lower_and_rotation(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Factor a matrix into a lower triangular matrix with a positive diagonal and a rotation, shape (3, 3) each."""
    orthogonal, upper = np.linalg.qr(matrix.T)
    signs = np.diag(np.sign(np.diag(upper)))
    return (signs @ upper).T, (orthogonal @ signs).T


def _read(files: Files) -> Corrector:
    imu = block_yaml.load(files[""])["imu0"]
    accelerometers, gyroscopes = imu["accelerometers"], imu["gyroscopes"]
    accel_matrix, gyro_matrix = np.array(accelerometers["M"]), np.array(gyroscopes["M"])
    force_sensitivity, rotation = np.array(gyroscopes["A"]), np.array(gyroscopes["C_gyro_i"])
    arms = [np.array(accelerometers[f"r{axis}_i"]) for axis in AXES]

    def correct(gyro: FloatArray, accel: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Invert the predictions, except for the angular acceleration, which has no effect along an axis."""
        sensed = np.linalg.solve(accel_matrix, accel.T).T
        rate = np.linalg.solve(gyro_matrix @ rotation, (gyro - sensed @ (force_sensitivity @ rotation).T).T).T
        turning = np.nan_to_num(rate)
        centripetal = [np.cross(turning, np.cross(turning, arm))[:, i] for i, arm in enumerate(arms)]
        return rate, sensed - np.stack(centripetal, axis=1)

    return correct


FORMAT = ExportFormat(
    frozenset({"gyro_scale", "gyro_misalign", "accel_scale", "accel_misalign", "inner_lever"}), _write, _read
)
