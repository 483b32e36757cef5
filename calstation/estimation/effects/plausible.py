"""Plausible changes of biases and scale factors within a run, from the stability of the unit.

Without this bound, an impossibly large change that hardly affects the data would explain them.
"""

from collections.abc import Mapping

import numpy as np

from calstation.estimation.common import ImuModel
from calstation.physics import COUNT, NAMES, STANDARD_GRAVITY, FloatArray, entry_of, group_indices

#: Prior sigma of a change within a run, relative to the change of a good unit from one power-up to the next.
_FAULTY = 100.0
#: Averaging time after which bias instability exceeds the random walk, s.
_AVERAGING = 100.0
#: Change of an accelerometer bias from one power-up to the next, in bias instabilities.
_ACCEL_REPEATABILITY = 3.0
#: Rate at which a change of the scale factor equals a change of the bias, rad/s.
_RATE = 0.1


def plausible_changes(imu: ImuModel, power_up: Mapping[str, float]) -> FloatArray:
    """Return the prior sigma of each parameter's change within a run, SI, shape (30,); 0 if it is not tested.

    Parameters
    ----------
    imu : noise of the unit, for parameters without a stated change
    power_up : stated change from one power-up to the next by parameter or group, SI
    """
    white = np.array([imu.gyro_arw, imu.accel_vrw]) / np.sqrt(_AVERAGING)
    gyro, accel = np.maximum(imu.bias_instability, white) * (1.0, _ACCEL_REPEATABILITY)
    default = {
        "gyro_bias": gyro,
        "gyro_scale": gyro / _RATE,
        "accel_bias": accel,
        "accel_scale": accel / STANDARD_GRAVITY,
    }
    changes = np.zeros(COUNT)
    for group, change in default.items():
        for i in group_indices(group):
            changes[i] = _FAULTY * (entry_of(power_up, NAMES[i]) or change)
    return changes
