"""Parameters of MATLAB's `imuSensor` as JSON for its function `loadparams`, and correction matrices in a ``.mat`` file.

`imuSensor` simulates samples in rows (`IMUSensorSimulator.stepBulkModel`) as

    reading = true (AxesMisalignment / 100)' + ConstantBias          AxesMisalignment in percent

For accelerometers, `true` is gravity minus acceleration, the negative of specific force ("Obtain Total Acceleration"
among the algorithms of its documentation). ConstantBias therefore has the opposite sign of the accelerometer bias: the
negative of the readings is the output of the unit.

The standard deviation of its noise is NoiseDensity √bandwidth, where the bandwidth is the sample rate for the type
"single-sided". The ``.mat`` file contains A and b of each sensor as from `accelcal`, for corrected = measured A + b.
"""

import io
import json
from typing import Any

import numpy as np

from calstation.exports.source import Corrector, ExportFormat, ExportSource, Files
from calstation.physics import FloatArray

_SENSORS = {"gyro": "Gyroscope", "accel": "Accelerometer"}
#: Ending of the file with the matrices.
_MAT = ".mat"
_PERCENT = 100.0
#: Sign of the readings of `imuSensor` relative to the output of the unit.
_SIGNS = {"gyro": 1.0, "accel": -1.0}


def _write(source: ExportSource) -> Files:
    from scipy.io import savemat

    sensors: dict[str, dict[str, Any]] = {}
    matrices: dict[str, Any] = {}
    for name, noise in (("gyro", source.gyro_noise), ("accel", source.accel_noise)):
        bias = np.array(source.vector(f"{name}_bias"))
        sensors[_SENSORS[name]] = {
            "ConstantBias": (_SIGNS[name] * bias + 0.0).tolist(),
            "AxesMisalignment": (_PERCENT * source.matrix(name)).tolist(),
            "NoiseDensity": [noise.density] * 3,
            "BiasInstability": [noise.instability] * 3,
            "RandomWalk": [noise.random_walk] * 3,
            "NoiseType": "single-sided",
        }
        inverse = np.linalg.inv(source.matrix(name)).T
        matrices |= {f"{name}_A": inverse, f"{name}_b": -bias[None, :] @ inverse}
    mat: Any = io.BytesIO()  # SciPy's type stubs do not accept binary streams
    savemat(mat, {"serial": source.serial, "sample_rate": source.imu.sample_rate_hz, **matrices})
    return {"": json.dumps({source.serial: sensors}, indent=1).encode() + b"\n", _MAT: mat.getvalue()}


def _read(files: Files) -> Corrector:
    from scipy.io import loadmat

    (sensors,) = json.loads(files[""]).values()
    mat: Any = io.BytesIO(files[_MAT])
    matrices = loadmat(mat)

    def corrected(name: str, measured: FloatArray) -> FloatArray:
        """Invert the simulation; the result is NaN where the matrices in the ``.mat`` file give another result."""
        section = sensors[_SENSORS[name]]
        gain = np.array(section["AxesMisalignment"]) / _PERCENT
        readings = _SIGNS[name] * measured
        inverted = _SIGNS[name] * np.linalg.solve(gain, (readings - np.array(section["ConstantBias"])).T).T
        product = measured @ matrices[f"{name}_A"] + matrices[f"{name}_b"]
        tolerance = 1e-9 * np.nan_to_num(np.abs(inverted)).max(initial=0.0)
        return np.where(np.abs(inverted - product) <= tolerance, inverted, np.nan)

    def correct(gyro: FloatArray, accel: FloatArray) -> tuple[FloatArray, FloatArray]:
        return corrected("gyro", gyro), corrected("accel", accel)

    return correct


FORMAT = ExportFormat(
    frozenset({"gyro_bias", "gyro_scale", "gyro_misalign", "accel_bias", "accel_scale", "accel_misalign"}),
    _write,
    _read,
)
