"""Logs as others write them, by the contract's text alone."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calstation.errors import InputError
from calstation.estimation.method import BatchStage
from calstation.physics import PARAMETERS
from calstation.results import resolve
from tests.cli.conftest import HEADER, META, Done, six_position_rows, write_log

Run = Callable[..., Done]


def refusal(done: Done) -> str:
    """The one message of a refusal."""
    assert done.code == 2, done.err
    lines = [line for line in done.err.splitlines() if line.strip()]
    assert len(lines) <= 2
    return done.err


def test_units_are_spelled_as_in_the_contract() -> None:
    assert {p.unit for p in PARAMETERS} == {"rad/s", "1", "rad", "m/s²", "s²/m", "m"}


def test_columns_may_be_in_any_order_and_unknown_columns_are_ignored(tmp_path: Path) -> None:
    rows = six_position_rows()
    names = [*HEADER.split(","), "operator"]
    order = np.random.default_rng(1).permutation(len(names))
    shuffled = [",".join(np.array([*row.split(","), "Li"])[order]) for row in rows]
    (tmp_path / "b").mkdir()
    plain = write_log(tmp_path, rows)
    other = write_log(tmp_path / "b", shuffled, ",".join(np.array(names)[order]))
    first, second = resolve(plain).result.to_json(), resolve(other).result.to_json()
    assert first["parameters"] == second["parameters"]
    assert first["log"]["sha256"] == second["log"]["sha256"]


def test_error_for_an_unknown_stage_names_the_file_and_column(calstation: Run, tmp_path: Path) -> None:
    rows = [row.replace("six_position", "six_pos") for row in six_position_rows()]
    text = refusal(calstation("resolve", write_log(tmp_path, rows)))
    assert all(word in text for word in ("log.csv", "no stage 'six_pos", "Choose from"))


def test_empty_file_is_reported_as_empty(calstation: Run, tmp_path: Path) -> None:
    log = write_log(tmp_path, six_position_rows())
    log.write_text("", encoding="utf-8")
    assert "log.csv: The file is empty." in refusal(calstation("resolve", log))


def test_parallel_axes_are_refused(calstation: Run, tmp_path: Path) -> None:
    meta = META + "\n[table]\nouter_axis = [0, 0, 1]\ninner_axis = [0, 0, -1]\n"
    text = refusal(calstation("resolve", write_log(tmp_path, six_position_rows(), meta=meta)))
    assert "log.toml" in text
    assert "outer_axis and inner_axis" in text


def test_range_beyond_the_end_of_the_log_is_reported(calstation: Run, tmp_path: Path) -> None:
    text = refusal(calstation("resolve", write_log(tmp_path, six_position_rows()), "--from", 99999))
    assert "no sample from 99999 to the end, only from 0 to 2399" in text


def test_gap_during_a_rotation_is_reported_as_the_cause(calstation: Run, tmp_path: Path) -> None:
    rows = [row.replace("six_position", "rate") for row in six_position_rows()]
    text = refusal(calstation("resolve", write_log(tmp_path, rows[:500] + rows[520:])))
    assert "No whole turn about +x" in text
    assert "1 gap or invalid stretches" in text


def test_encoder_angles_survive_a_write_and_read(calstation: Run, tmp_path: Path) -> None:
    angles = np.random.default_rng(2).uniform(-800.0, 800.0, 2400)
    rows = six_position_rows()
    for k, angle in enumerate(angles):
        cells = rows[k].split(",")
        cells[8] = f"{angle:.5f}"
        rows[k] = ",".join(cells)
    log = write_log(tmp_path, rows)
    assert calstation("import", log, "-o", tmp_path / "a.h5").code == 0
    assert calstation("export", tmp_path / "a.h5", "-o", tmp_path / "a.csv").code == 0
    back = (tmp_path / "a.csv").read_text(encoding="utf-8").splitlines()[1:]
    assert [float(row.split(",")[8]) for row in back] == [float(row.split(",")[8]) for row in rows]


def test_diverged_solution_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def diverge(self: BatchStage, *_: object) -> None:
        raise np.linalg.LinAlgError("Matrix is singular to machine precision.")

    monkeypatch.setattr(BatchStage, "finish", diverge)
    with pytest.raises(InputError, match=r"log.csv: Stage Six positions: The solution diverged"):
        resolve(write_log(tmp_path, six_position_rows()))
