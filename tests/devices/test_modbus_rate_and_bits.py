"""Modbus table: continuous rotation only with a watchdog; bits 5, 9 and 11 of the statusword."""

import numpy as np
import pytest
from test_modbus_table import image, quick, read, table, two_words, write

from calstation.devices import UNKNOWN_FAULT
from calstation.devices.profiles import TableProfile
from calstation.errors import ConfigurationError
from tests.helpers import raises_code

RATE = 4


def polled(status: int = 0x1627, fault: int = 0, watchdog: int = 1500) -> tuple[bytes, bytes]:
    words = image(status, fault)
    words[20] = watchdog
    return read(17, words[17:64])


def test_rate_command_matches_the_protocol() -> None:
    pairs = [
        polled(),
        write(36, *two_words(100000), *two_words(200000)),
        write(56, *two_words(-55000), *two_words(200000)),
        write(22, RATE),
    ]
    with table(pairs) as (driver, _):
        driver.rate(*np.deg2rad([10.0, -5.5, 20.0]))


def test_continuous_rotation_is_refused_while_the_watchdog_is_disabled() -> None:
    with table([polled(watchdog=0)]) as (driver, _), raises_code(ConfigurationError, "table.would_not_stop"):
        driver.rate(0.1, 0.0, 0.1)


def test_stop_on_link_loss_replaces_the_watchdog() -> None:
    stated = quick().model_copy(update={"link_loss_stop_s": 0.5})
    pairs = [
        polled(watchdog=0),
        write(36, *two_words(0), *two_words(200000)),
        write(56, *two_words(0), *two_words(200000)),
        write(22, RATE),
    ]
    with table(pairs, stated) as (driver, _):
        driver.rate(0.0, 0.0, np.deg2rad(20.0))


@pytest.mark.parametrize(
    ("rates", "code"),
    [((130.0, 0.0, 10.0), "table.rate_above_limit"), ((1.0, 1.0, 0.0), "table.acceleration_outside_limits")],
)
def test_continuous_rotation_outside_the_profile_limits_is_refused(rates: tuple[float, ...], code: str) -> None:
    with table([polled()]) as (driver, _), raises_code(ConfigurationError, code):
        driver.rate(*np.deg2rad(rates))


def test_profile_without_a_rate_command_is_reported() -> None:
    profile = quick()
    without: TableProfile = profile.model_copy(update={"commands": profile.commands.model_copy(update={"rate": None})})
    with table([], without) as (driver, _), raises_code(ConfigurationError, "table.no_rate_command"):
        driver.rate(0.1, 0.0, 0.1)


@pytest.mark.parametrize(
    ("status", "fault", "expected"),
    [
        (0x1627, 0, None),
        (0x1427, 0, "local control"),
        (0x1E27, 0, "limit"),
        (0x1C27, 0, "local control"),
        (0x1628, 0, UNKNOWN_FAULT),
        (0x1E27, 4, "drive"),
    ],
)
def test_status_bits_are_decoded(status: int, fault: int, expected: str | None) -> None:
    with table([polled(status, fault)]) as (driver, _):
        assert driver.status().fault == expected


def test_quick_stop_is_a_fault_only_while_the_axes_should_be_enabled() -> None:
    enable = [write(16, word) for word in (0x06, 0x07, 0x0F)]
    stopped = polled(0x1607)
    pairs = [stopped, *enable, polled(0x1627), stopped, write(16, 0x06), stopped]
    with table(pairs) as (driver, _):
        assert driver.status().fault is None, "a drive that is off may show anything"
        driver.enable()
        assert driver.status().fault is None
        assert driver.status().fault == "quick stop"
        driver.disable()
        assert driver.status().fault is None


def test_bits_missing_from_the_profile_are_ignored() -> None:
    bits = quick().status_bits.model_copy(update=dict.fromkeys(("remote", "limit", "quick_stop")))
    with table([polled(0x1C07)], quick().model_copy(update={"status_bits": bits})) as (driver, _):
        assert driver.status().fault is None
