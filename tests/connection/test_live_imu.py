"""A result is applied to the live output of a unit, with its serial number checked and never corrected twice."""

from pathlib import Path

import numpy as np
import pytest

from calstation.config import library
from calstation.connection import OtherUnit, apply_to_unit
from calstation.physics import NAMES
from calstation.records import read_truth, truth_path
from calstation.results.plots import Applied
from calstation.simulation import record_on_bench
from tests.helpers import ignore_progress
from tests.site_folder import with_corrected_output

ZERO = np.zeros(len(NAMES))


@pytest.fixture
def recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A recording with a simulated operator, in a temporary site folder."""
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "home"))
    return record_on_bench(ignore_progress, "hand", tmp_path / "hand.h5", "tactical", 3)


def test_virtual_bench_simulates_the_recorded_unit(recording: Path) -> None:
    truth = read_truth(recording)
    found = np.array([truth[name] for name in NAMES])
    now = apply_to_unit(ignore_progress, recording, None, None, ZERO, found, seconds=4.0)
    assert isinstance(now, Applied)
    assert now.serial == "BENCH-tactical-3"
    assert now.named
    assert not now.corrected
    assert now.length_rms[1] < 1e-3
    assert now.rate_rms[1] == pytest.approx(now.earth, rel=0.05)


def test_invalid_product_of_the_site_is_skipped(recording: Path, tmp_path: Path) -> None:
    (tmp_path / "home" / "products").mkdir(parents=True)
    (tmp_path / "home" / "products" / "a_draft.toml").write_text('name = "a draft"', "utf-8")
    now = apply_to_unit(ignore_progress, recording, None, None, ZERO, ZERO, seconds=2.0)
    assert isinstance(now, Applied)
    assert now.serial == "BENCH-tactical-3"


def test_corrected_stream_is_not_corrected_again(recording: Path, tmp_path: Path) -> None:
    profile = library.find("imus", "bench_tactical").read_text("utf-8")
    (tmp_path / "home" / "imus").mkdir(parents=True)
    own = tmp_path / "home" / "imus" / "bench_tactical.toml"
    own.write_text(with_corrected_output(profile), "utf-8")
    now = apply_to_unit(ignore_progress, recording, None, None, ZERO, np.full(len(NAMES), 1e-3), seconds=2.0)
    assert isinstance(now, Applied)
    assert now.corrected
    assert now.length_rms[0] == now.length_rms[1]
    assert now.rate_rms[0] == now.rate_rms[1]


def test_another_unit_is_reported_and_the_result_not_applied(recording: Path) -> None:
    truth_path(recording).unlink()
    assert apply_to_unit(ignore_progress, recording, None, None, ZERO, ZERO) == OtherUnit("SN-000001")
