"""Sound units on a table that sways, moves slowly, rocks or creeps pass, and no unit is blamed for it."""

from typing import Literal

import pytest

from tests.outside.cases import MOTIONS
from tests.outside.sweep import Case, run


@pytest.mark.parametrize("simulator", ["bench", pytest.param("plain", marks=pytest.mark.long)])
@pytest.mark.parametrize("motion", MOTIONS)
def test_sound_unit_passes_on_a_moving_table(motion: str, simulator: Literal["bench", "plain"]) -> None:
    case = Case(
        seed=5, grade="mems", simulator=simulator, settings={"table_motion": MOTIONS[motion]}, product="mems_c_fast"
    )
    outcome = run(case)
    assert outcome.passed, (outcome.failed, outcome.cause)
    assert outcome.worst < 4.5


def test_short_rests_of_a_rocking_table_do_not_spoil_the_test_of_motions() -> None:
    outcome = run(
        Case(seed=7018, settings={"table_motion": MOTIONS["rocking of 20 µrad at 3 Hz"]}, product="nav_a_fast")
    )
    assert outcome.passed, (outcome.failed, outcome.cause)


@pytest.mark.parametrize(
    "ratio", [1.03, *(pytest.param(ratio, marks=pytest.mark.long) for ratio in (1.1, 1.3, 2.0)), 2.9]
)
def test_table_noisier_than_its_profile_passes_up_to_three_times(ratio: float) -> None:
    outcome = run(Case("velocity_sigma", ratio * 1e-3, 7, "mems", product="mems_c_fast"))
    assert outcome.passed, (outcome.failed, outcome.cause)
    assert outcome.worst < 4.5
