"""A stored cross-calibration stays until the next one replaces it."""

from pathlib import Path

import pytest

from calstation.errors import ConfigurationError, InputError
from calstation.estimation.common import StoredCrossCalibration
from calstation.records import load_pair, pair_path, store_pair
from tests.helpers import raises_code

FIRST = StoredCrossCalibration({"secondary_gyro_bias_x": 0.1 + 0.2, "clock_offset": 1e-3}, 1e-3, 0.02)


def test_newest_calibration_replaces_the_previous_one(tmp_path: Path) -> None:
    folder = tmp_path / "pairs"
    assert load_pair(folder, "P 1", "S/2") == StoredCrossCalibration()
    path = store_pair(folder, "P 1", "S/2", FIRST)
    assert path == pair_path(folder, "P 1", "S/2")
    assert load_pair(folder, "P 1", "S/2") == FIRST
    second = StoredCrossCalibration({"secondary_gyro_bias_x": 2.0})
    store_pair(folder, "P 1", "S/2", second)
    assert load_pair(folder, "P 1", "S/2") == second
    assert load_pair(folder, "P 1", "S/3") == StoredCrossCalibration()


def test_damaged_file_and_uncreatable_folder_are_reported(tmp_path: Path) -> None:
    pair_path(tmp_path, "P", "S").write_text("values = { secondary_gyro_bais_x = 1.0 }\n")
    with pytest.raises(InputError, match="Did you mean 'secondary_gyro_bias_x'"):
        load_pair(tmp_path, "P", "S")
    (tmp_path / "file").write_text("")
    with raises_code(ConfigurationError, "log.pair_not_written"):
        store_pair(tmp_path / "file", "P", "S", FIRST)
