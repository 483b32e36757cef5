"""The command that simulates many logs writes short, complete and reproducible logs."""

from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import pytest

from calstation.physics import NAMES
from calstation.records import open_log
from calstation.results import resolve
from synthetic.many_logs import GRAVITY_ERROR, STATIONS, WRONG_SINCE, WRONG_STATION, record_logs
from tests.cli.conftest import Done, calstation
from tests.helpers import ignore_progress

__all__ = ["calstation"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve logs."""
    folder = tmp_path_factory.mktemp("logs")
    record_logs(ignore_progress, folder, 12, seed=3)
    return folder


def test_simulated_log_gives_all_parameters_and_a_verdict(folder: Path) -> None:
    result = resolve(min(folder.glob("*.h5"))).result
    assert set(result.parameters) == set(NAMES)
    assert result.passed is not None
    assert not result.undetermined


def test_stations_alternate_and_one_has_wrong_gravity_since_march(folder: Path) -> None:
    metas = [open_log(path).meta for path in sorted(folder.glob("*.h5"))]
    assert len({meta.imu.serial for meta in metas}) == 12
    found = []
    for meta in metas:
        assert meta.run is not None
        assert meta.site.gravity_mps2 is not None
        wrong = meta.run.station == WRONG_STATION and datetime.fromisoformat(meta.run.started_utc) >= WRONG_SINCE
        gravity = STATIONS[meta.run.station or ""]["gravity_mps2"]
        assert meta.site.gravity_mps2 / gravity - 1.0 == pytest.approx(GRAVITY_ERROR if wrong else 0.0, abs=1e-8)
        found.append(meta.run.station)
    assert found == 4 * list(STATIONS)
    assert len({site["gravity_mps2"] for site in STATIONS.values()}) == len(STATIONS)


def test_equal_seeds_give_equal_logs(tmp_path: Path) -> None:
    (first, _), (again, other) = (
        sorted(record_logs(ignore_progress, tmp_path / name, 2, seed=3)) for name in ("one", "two")
    )
    digests = [open_log(path).facts().sha256 for path in (first, again, other)]
    assert digests[0] == digests[1] != digests[2]


def test_folder_with_files_is_refused(calstation: Callable[..., Done], folder: Path) -> None:
    assert calstation("record", "logs", "--count", 2, "-o", folder).code == 2
