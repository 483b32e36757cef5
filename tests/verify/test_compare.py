"""The second opinion agrees with calstation on simulated logs of all grades, stages, schedules and simulators."""

from dataclasses import replace
from pathlib import Path

import pytest

from tests.verify.compare import Case, cases, cases_over_temperature, compare

#: Largest difference of a value, in sigmas, and of a sigma, relative to it; in a ramp, differences of 65 points add up.
VALUE, OF_RAMP, SIGMA = 0.02, 0.05, 0.005
LOGS = {case.number: case for case in cases(200)}
OVER_TEMPERATURE = {case.number: case for case in cases_over_temperature(8)}
SHORT = Case(11, "mems", "designed", "bench", True, 0.5, "estimated", 30.0, gap=False)
SHORT_OVER_TEMPERATURE = replace(SHORT, kind="soaks")


def check(case: Case, folder: Path) -> None:
    """Check that both results of a log agree."""
    compared = compare(case, folder)
    assert compared.findings == ()
    assert compared.largest < (OF_RAMP if case.kind == "ramp" else VALUE), compared.parameter
    assert abs(compared.sigma_ratio - 1.0) < SIGMA


@pytest.mark.parametrize("lever", ["estimated", "fixed"])
def test_a_short_log_agrees(tmp_path: Path, lever: str) -> None:
    """With a fixed lever arm, both offsets of the table's axes are uncertain."""
    check(replace(SHORT, outer_lever=lever), tmp_path)


@pytest.mark.exhaustive
def test_a_short_log_over_temperature_agrees(tmp_path: Path) -> None:
    check(SHORT_OVER_TEMPERATURE, tmp_path)


@pytest.mark.exhaustive
@pytest.mark.parametrize("number", OVER_TEMPERATURE)
def test_a_log_over_temperature_agrees(tmp_path: Path, number: int) -> None:
    check(OVER_TEMPERATURE[number], tmp_path)


@pytest.mark.exhaustive
@pytest.mark.parametrize("number", LOGS)
def test_a_log_agrees(tmp_path: Path, number: int) -> None:
    check(LOGS[number], tmp_path)
