"""Joint solution of rests and motions without table angles, and checks of and guidance for such recordings."""

from calstation.estimation.positions.evidence import (
    Evidence,
    MotionEvidence,
    RestEvidence,
    angle_errors,
    gather,
    gravity_errors,
    turn_between,
)
from calstation.estimation.positions.fit import MAX_ITERATIONS, PositionFit, fit_positions
from calstation.estimation.positions.guidance import Guidance, PositionGuide
from calstation.estimation.positions.recording_faults import frozen_columns, require_changing, valid_links
from calstation.estimation.positions.rows import (
    GYRO_COLUMNS,
    Position,
    Scatter,
    gyro_derivative,
    integrate_rotation,
    positions,
    square_root,
)
from calstation.estimation.positions.table_fit import (
    TABLE_QUANTITIES,
    TableQuantity,
    TableRests,
    table_axes,
    table_rests,
)
