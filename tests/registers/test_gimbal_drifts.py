"""Verification on a gimbal: the expected drifts follow from the joint axes for any mounting of the unit."""

import numpy as np
import pytest

from calstation.estimation.common import ImuModel, Site, SolveContext, TableModel
from calstation.estimation.gimbal import drift_matrix
from calstation.physics import COUNT
from calstation.registers import AppliedRegisters, verify_output
from calstation.sequencer import JointDrift, VerificationData

NAMES = ("gyro_misalign_yx", "gyro_misalign_zx")
TRUE = 1e-3
CONTEXT = SolveContext(
    Site(0.6, 0.0, 0.0, None, 9.8),
    ImuModel("G", 100.0, "increment", 1e-9, 1e-6, 4e-5, 1e-3, 1e-5, 1e-4),
    TableModel(encoder_sigma=np.deg2rad(0.002)),
)


@pytest.mark.parametrize(("written", "remaining", "passed"), [(0.6e-3, 0.6e-3, True), (0.6e-3, 0.0, False)])
def test_expected_drift_follows_from_the_written_registers(written: float, remaining: float, passed: bool) -> None:
    J = drift_matrix("zxy", 0, np.deg2rad(30.0))
    drift = JointDrift(0, J, -J @ np.full(2, TRUE - remaining), 1.5, 3.0)
    mounted = np.eye(COUNT) * np.deg2rad(0.1) ** 2
    (check,) = verify_output(
        VerificationData((), 0.0, corrected=True, drifts=(drift,)),
        AppliedRegisters(dict.fromkeys(NAMES, written)),
        mounted,
        CONTEXT,
        0.0,
        {name: {"value": TRUE, "sigma": 5e-5} for name in NAMES},
    )
    assert check.passed is passed
