"""Gyro misalignment from the joints of a stabilised gimbal."""

from calstation.estimation.gimbal.iteration import (
    BIAS_TIME,
    AxisTurns,
    GimbalIteration,
    contraction,
    correction_sign,
    drift_matrix,
    largest_gain,
    other_axes,
)
from calstation.estimation.gimbal.motions import MIN_JOINT_TURN, GimbalFit, Motion, find_motions, fit_gimbal, joint_turn
