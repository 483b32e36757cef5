"""The log of a unit in a batch contains its slot, the other units and the limits of its lever arm."""

import tomllib
from pathlib import Path

import pytest
import tomli_w

from calstation.config import (
    RunRequest,
)
from calstation.config.library import shipped_folder
from calstation.physics import ALIGNED, INDEX, orientation_matrix
from calstation.records import LogMeta, context_from_meta, prior_from_meta
from tests.prepared import prepare_batch


@pytest.fixture
def station(tmp_path: Path) -> Path:
    """The virtual station with two slots; the second is rotated and 0.3 m from the centre."""
    data = tomllib.loads((shipped_folder() / "stations" / "virtual_batch.toml").read_text(encoding="utf-8"))
    data["bench"]["units"] = 2
    data["slots"] = [
        {"name": "A1"},
        {"name": "A2", "orientation": "-y+z", "lever_m": [0.3, 0.0, -0.1]},
    ]
    path = tmp_path / "two.toml"
    path.write_text(tomli_w.dumps(data), encoding="utf-8")
    return path


def test_log_contains_the_slot_of_its_unit_and_the_other_units(station: Path, tmp_path: Path) -> None:
    request = RunRequest("SN-1", station, serials=("SN-1", "SN-2"), out=tmp_path)
    metas = [LogMeta.model_validate_json(setup.log_meta().to_json()) for setup in prepare_batch(request)]
    assert [meta.run.slot for meta in metas] == ["A1", "A2"]
    assert [meta.run.batch_units for meta in metas] == [["SN-1", "SN-2"]] * 2
    assert [context_from_meta(meta).table.orientation for meta in metas] == [ALIGNED, orientation_matrix("-y+z")]
    levers = [prior_from_meta(meta).mean[[INDEX[f"outer_lever_{axis}"] for axis in "xyz"]].tolist() for meta in metas]
    assert levers == [[0.0, 0.0, 0.0], [0.3, 0.0, -0.1]]


def test_lever_arm_limits_are_centred_on_the_lever_arm_of_the_slot(station: Path, tmp_path: Path) -> None:
    request = RunRequest("SN-1", station, serials=("SN-1", "SN-2"), out=tmp_path)
    first, second = (setup.log_meta().product.limits for setup in prepare_batch(request))
    permitted = first["outer_lever"].interval[1]
    assert "outer_lever_x" not in first
    assert second["outer_lever_x"].interval == (0.3 - permitted, 0.3 + permitted)
    assert second["outer_lever_z"].interval == (-0.1 - permitted, -0.1 + permitted)
    assert second["outer_lever_x"].sigma_below == first["outer_lever"].sigma_below


def test_log_of_a_single_unit_lists_no_other_units(tmp_path: Path) -> None:
    (setup,) = prepare_batch(RunRequest("SN-1", out=tmp_path))
    assert setup.log_meta().run.batch_units is None
