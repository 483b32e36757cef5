"""Slices of the 39 error states: φ, δv, δp and the parameters, whose names and order are in `parameters.py`.

The states are φ, δv, δp and the errors of the parameters. A slice of a parameter group refers to a vector of the 30
parameters; in the states the parameters start at `PARAMETER_START`.
"""

from calstation.physics.parameters import COUNT, GROUPS, group_indices

#: Attitude error φ, velocity error δv and position error δp.
PHI, DV, DP = slice(0, 3), slice(3, 6), slice(6, 9)
#: φ, δv and δp.
NAVIGATION = slice(0, DP.stop)
PARAMETER_START = DP.stop
STATES = PARAMETER_START + COUNT
#: States of the parameters.
PARAMETER_STATES = slice(PARAMETER_START, STATES)

(
    GYRO_BIAS,
    GYRO_SCALE,
    GYRO_MISALIGN,
    ACCEL_BIAS,
    ACCEL_SCALE,
    ACCEL_MISALIGN,
    ACCEL_QUADRATIC,
    INNER_LEVER,
    OUTER_LEVER,
) = (slice(group_indices(group)[0], group_indices(group)[-1] + 1) for group in GROUPS)
#: Parameters of the gyros, on which alone the angular rate depends.
GYROS = slice(GYRO_BIAS.start, GYRO_MISALIGN.stop)
#: Parameters on which the specific force depends: all but the outer lever arm.
SENSORS = slice(GYRO_BIAS.start, INNER_LEVER.stop)
