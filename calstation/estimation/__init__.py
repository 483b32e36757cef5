"""Calibration methods and solvers as pure functions of arrays.

They use no devices, files, threads or windows; the schedules are defined in `procedures`.
"""

from calstation.estimation.common import Diagnosis, ModelTest
from calstation.estimation.method import (
    BatchStage,
    Estimate,
    Innovations,
    Method,
    Progress,
    Ranking,
    RepeatedSchedule,
    Solution,
    StageSolver,
    stage_residuals,
)
