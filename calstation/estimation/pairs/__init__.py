"""Cross-calibration of IMUs on one body: checks, fit and live monitoring."""

from calstation.estimation.pairs.alignment import Alignment, PairAligner
from calstation.estimation.pairs.calibration import (
    SENSORS,
    PairCalibration,
    PairResult,
    RestDeviation,
    SecondaryCorrection,
    StaticCheck,
    pair_vector,
)
from calstation.estimation.pairs.filtering import PairData, pair_data, signals
from calstation.estimation.pairs.fit import ACCEL_BIAS, ACCEL_MATRIX, GYRO_BIAS, GYRO_MATRIX, LEVER, OFFSET
from calstation.estimation.pairs.schedule import PairSchedule
from calstation.estimation.pairs.watch import PairWatch, Submit, Verdict, WatchEvent, call_now, check_values
