"""Gyro misalignment from the joints of a stabilised gimbal."""

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
from calstation.estimation.gimbal.motions import TURNED, GimbalFit, Motion, find_motions, fit_gimbal, turned_motion
