"""The second opinion finds errors that are planted in calstation itself."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calstation.errors import ConfigurationError, InputError
from calstation.physics import earth, imu_model
from calstation.records import LogMeta, PriorSection, RawLogWriter, open_log
from calstation.results import resolve_log, write_json
from calstation.verify import verify
from tests.helpers import sampled
from tests.verify.compare import Case, write_log

CASE = Case(1, "nav", "designed", "bench", True, 0.5, "estimated", 30.0, gap=False)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("planted") / "log.h5"
    write_log(CASE, path)
    return path


def scaled(section: str, field: str, factor: float) -> Callable[[LogMeta], LogMeta]:
    """Return a change of the configuration that calstation uses by an error of one entry."""

    def change(meta: LogMeta) -> LogMeta:
        part = getattr(meta, section)
        value = factor * getattr(part, field)
        return meta.model_copy(update={section: part.model_copy(update={field: value})})

    return change


def narrow_lever(meta: LogMeta) -> LogMeta:
    levers = {f"inner_lever_{axis}": PriorSection(value=0.0, sigma=4e-4) for axis in "xyz"}
    return meta.model_copy(update={"prior": {**meta.prior, **levers}})


#: Errors of constants and models of calstation.
WRONG_ENTRIES: dict[str, Callable[[LogMeta], LogMeta]] = {
    "gravity 20 ppm too large": scaled("site", "gravity_mps2", 1.0 + 20e-6),
    "size of an accelerometer count 10 ppm too large": scaled("imu", "accel_lsb", 1.0 + 10e-6),
    "size of a gyro count 100 ppm too large": scaled("imu", "gyro_lsb", 1.0 + 100e-6),
    "prior of the inner lever arms a hundred times as narrow": narrow_lever,
    "variance of the table's velocity doubled": scaled("table", "velocity_sigma", float(np.sqrt(2.0))),
    "angle random walk 1.5 times as large": scaled("imu", "gyro_arw", 1.5),
    "velocity random walk 1.5 times as large": scaled("imu", "accel_vrw", 1.5),
}


def found(log: Path, folder: Path, change: Callable[[LogMeta], LogMeta], solved: Path | None = None) -> Any:
    """Solve a log, or another one, by calstation with a changed configuration, and return the differing parameters."""
    opened = open_log(solved or log)
    result = folder / "result.json"
    write_json(result, resolve_log(opened, change(opened.meta)).result.to_json())
    report = verify.verify(result, log)
    return [row["subject"] for row in report["findings"] if row["code"] in ("value", "sigma")]


@pytest.mark.long
def test_without_an_error_nothing_is_found(log: Path, tmp_path: Path) -> None:
    assert found(log, tmp_path, lambda meta: meta) == []


@pytest.mark.long
@pytest.mark.parametrize("name", sampled(4, [*WRONG_ENTRIES]))
def test_a_wrong_entry_is_found(log: Path, tmp_path: Path, name: str) -> None:
    assert found(log, tmp_path, WRONG_ENTRIES[name])


@pytest.mark.long
def test_a_wrong_earth_rate_is_found(log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(earth, "RATE", 1.01 * earth.RATE)
    assert found(log, tmp_path, lambda meta: meta)


@pytest.mark.long
def test_gyros_that_are_one_sample_late_are_found(log: Path, tmp_path: Path) -> None:
    late, opened = tmp_path / "late.h5", open_log(log)
    writer = RawLogWriter(late, opened.meta)
    for block in opened.blocks():
        block.counts[1:, :3] = block.counts[:-1, :3].copy()
        writer.append(block)
    writer.close("stopped")
    assert found(log, tmp_path, lambda meta: meta, solved=late)


@pytest.mark.long
def test_calstation_does_not_solve_with_misalignments_of_the_wrong_sign(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its filter does not converge, and no result needs a second opinion."""

    def inverse(parameters: Any, *groups: str) -> Any:
        M = imu_model.group_matrix(parameters, *groups)
        return np.linalg.inv(np.eye(3) + 2.0 * np.diag(np.diag(M)) - M)

    monkeypatch.setattr(imu_model, "_inverse", inverse)
    with pytest.raises((InputError, ConfigurationError)):
        found(log, tmp_path, lambda meta: meta)
