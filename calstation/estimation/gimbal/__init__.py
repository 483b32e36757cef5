"""Gyro misalignment from the joints of a stabilised gimbal."""

from calstation.estimation.gimbal.fit import GimbalFit, fit_gimbal
from calstation.estimation.gimbal.iteration import (
    BIAS_TIME,
    AxisTurns,
    GimbalIteration,
    contraction,
    drift_matrix,
    largest_gain,
    others,
    sign_of,
)
from calstation.estimation.gimbal.motions import TURNED, Motion, find_motions, turned_motion
