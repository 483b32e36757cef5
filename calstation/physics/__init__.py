"""Error model, earth, strapdown, table geometry, motion steps and units.

This package uses no filter, file or device.
"""

from calstation.physics.arrays import BoolArray, FloatArray, IntArray
from calstation.physics.coefficients import (
    MAX_POWER,
    TEMPERATURES,
    coefficient,
    highest_powers,
    is_over_temperature,
    values_at,
)
from calstation.physics.earth import RATE, normal_gravity, rotation_rate
from calstation.physics.effects import CHANGING_GROUPS, EFFECTS, OF_ACCELEROMETERS, Effect, Motion, OuterTurn, Term
from calstation.physics.further_parameters import (
    EFFECT_PARAMETERS,
    EFFECT_STATES,
    GROUP_BY_NAME,
    PAIR_PARAMETERS,
    EffectName,
    entry_of,
    further_parameter,
    group_of,
    pair_name,
)
from calstation.physics.imu_model import Compensation, compensate, compensation, compose, composition, parameter_vector
from calstation.physics.kernels import kernel
from calstation.physics.motion import (
    Dwell,
    GimbalTurn,
    GimbalZero,
    ManualMove,
    Move,
    Ramp,
    RoundEnd,
    Soak,
    Step,
    move_time,
)
from calstation.physics.parameters import (
    ACCEL_BIAS,
    ACCEL_MISALIGN,
    ACCEL_QUADRATIC,
    ACCEL_SCALE,
    AXES,
    CHANNELS,
    COUNT,
    DP,
    DV,
    GROUPS,
    GYRO_BIAS,
    GYRO_MISALIGN,
    GYRO_SCALE,
    GYROS,
    INDEX,
    INNER_LEVER,
    NAMES,
    NAVIGATION,
    OBSERVABLE,
    OUTER_LEVER,
    PARAMETER_START,
    PARAMETER_STATES,
    PARAMETERS,
    PHI,
    SENSORS,
    STATES,
    group_indices,
    group_matrix,
    group_vector,
    parameter_indices,
    targets_reached,
)
from calstation.physics.rotation import (
    axis_rotation,
    axis_rotations,
    level_attitude,
    rotate,
    rotation_matrix,
    rotation_vector,
    skew,
)
from calstation.physics.strapdown import (
    Increments,
    IntervalWork,
    body_rotation,
    dynamics,
    increments,
    interval_work,
    propagate,
    write_navigation_block,
)
from calstation.physics.table import (
    ALIGNED,
    AXIS_OFFSET_SIGMA,
    DEFAULT_ORIENTATION,
    INNER,
    JOINTS,
    ORIENTATIONS,
    OUTER,
    UP,
    GimbalJoints,
    JointLimits,
    Orientation,
    TableGeometry,
    orientation_matrix,
)
from calstation.physics.units import (
    ARCSECOND,
    DEGREE,
    DEGREE_PER_HOUR,
    DISPLAY,
    MICRO_G,
    NOISE_DISPLAY,
    STANDARD_GRAVITY,
    aligned,
    compared_number,
    display,
    display_by_unit,
    from_unit,
    in_unit,
    limit_number,
    limit_numbers,
    number,
    unit_of,
    unit_of_parameter,
)
