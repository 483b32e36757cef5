"""A manual rig replaces a table without being driven, and its profile has no link."""

import math

import numpy as np
import pytest

from calstation.config import library
from calstation.devices.profiles import TableProfile, load_table_profile
from calstation.devices.table import ManualTable, open_table
from calstation.errors import ConfigurationError
from calstation.schema import read_toml, validate
from tests.helpers import error_code, raises_code

PATH = library.shipped_folder() / "tables" / "hand_rails.toml"


@pytest.fixture
def profile() -> TableProfile:
    return load_table_profile(PATH)


def test_a_manual_rig_is_at_rest_at_unknown_angles(profile: TableProfile) -> None:
    table = ManualTable(profile)
    assert table.identify().model == "hand-rails"
    for command in (table.enable, table.disable, table.home, table.stop, table.reset_fault, table.heartbeat):
        command()
        status = table.status()
        assert np.isnan(status.angles).all()
        assert np.isnan(status.rates).all()
        assert (status.enabled, status.homed, status.moving, status.settled) == (True, True, False, True)
        assert status.fault is None
        assert math.isinf(status.watchdog)
    table.close()


def test_motion_commands_to_a_manual_rig_are_refused(profile: TableProfile) -> None:
    table = ManualTable(profile)
    with raises_code(ConfigurationError, "table.rig_cannot_move"):
        table.move(0.1, 0.0, 1.0, 1.0)
    with raises_code(ConfigurationError, "table.rig_cannot_move"):
        table.rate(0.1, 0.0, 1.0)


def test_port_of_a_manual_rig_is_refused(profile: TableProfile) -> None:
    assert profile.by_hand
    with raises_code(ConfigurationError, "table.rig_without_port"):
        open_table("/dev/ttyS0", profile, None)


@pytest.mark.parametrize(
    ("section", "value"),
    [
        ("commands", {"move": 1, "stop": 2, "home": 3}),
        ("link_loss_stop_s", 1.0),
        ("modbus", {"unit": 1, "timeout_s": 1}),
    ],
)
def test_entries_of_a_motorised_table_are_refused(section: str, value: object) -> None:
    with pytest.raises(ConfigurationError) as caught:
        validate(TableProfile, {**read_toml(PATH), section: value}, "hand.toml")
    assert error_code(caught.value) == f"{section} profile.not_with"
