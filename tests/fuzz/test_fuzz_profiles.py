"""A profile with arbitrary content is either loaded or refused by a one-line error."""

import copy
import tomllib
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calstation.devices.imu import RegisterMap, frame_decoder
from calstation.devices.profiles import ImuProfile, TableProfile, TextSection
from calstation.devices.table import RegisterTable
from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.schema import validate

DATA = Path(__file__).parents[2] / "data"
PROFILES = [*sorted((DATA / "imus").glob("*.toml")), *sorted((DATA / "tables").glob("*.toml"))]

WORDS = [
    "",
    "f32",
    "i24",
    "q4.5",
    "big",
    "5G",
    "AF",
    "little",
    "error",
    "gyro_matrix",
    "gyro_bias",
    "accel_offset",
    "crc",
]
WORDS += ["atl", "stream", "modbus", "{axis}", "{x}", "(?P<value>.*)", "(", "registers", "tcp://x:1"]
leaf = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(2**65), 2**65),
    st.floats(),
    st.sampled_from(WORDS),
    st.lists(st.sampled_from([*WORDS, "gyro_scale_x"]), max_size=4),
    st.dictionaries(st.sampled_from(["kind", "at", "value", "address", "send"]), st.integers(-3, 70000), max_size=3),
)


def places(data: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Yield the paths of all values in nested tables and lists."""
    found = [path] if path else []
    inside = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in inside:
        found += places(value, (*path, key))
    return found


@pytest.mark.parametrize("path", PROFILES, ids=lambda p: p.stem)
@given(data=st.data())
def test_profile_is_loaded_or_refused_with_the_invalid_entry(path: Path, data: st.DataObject) -> None:
    profile = tomllib.loads(path.read_text(encoding="utf-8"))
    for _ in range(data.draw(st.integers(1, 3))):
        *parents, last = data.draw(st.sampled_from(places(profile)))
        place: Any = profile
        for key in parents:
            place = place[key]
        if data.draw(st.booleans()):
            place[last] = data.draw(leaf)
        else:
            del place[last]
        profile = copy.deepcopy(profile)
    model: Any = ImuProfile if path.parent.name == "imus" else TableProfile
    message, loaded = "", None
    try:
        loaded = validate(model, profile, "profile.toml")
    except ConfigurationError as error:
        message = str(error)
    assert loaded is not None or message.startswith("profile.toml: ")
    assert "\n" not in message
    if isinstance(loaded, ImuProfile):
        frame_decoder(loaded).feed(loaded.frame.sync_bytes + bytes(200))
        entries = RegisterMap(tuple(loaded.registers))
        with suppress(DeviceFaultError):
            entries.rounded(dict.fromkeys(entries.parameters, 0.0))
    if isinstance(loaded, TableProfile) and loaded.registers:
        check_obeys(loaded)
    if isinstance(loaded, TableProfile) and loaded.text is not None:
        check_lines(loaded.text)


class Zeros:
    """Registers that read as zero and accept every write that fits a Modbus transfer."""

    received = b""

    def read(self, address: int, count: int, unit: int | None = None) -> list[int]:
        assert 0 <= address <= address + count <= 1 << 16
        return [0] * count

    def write(self, address: int, values: list[int], repeat: bool = True, unit: int | None = None) -> None:
        assert 0 <= address <= address + len(values) <= 1 << 16
        assert all(0 <= value <= 0xFFFF for value in values)

    def close(self) -> None:
        return


def check_obeys(profile: TableProfile) -> None:
    """Assert that a loaded profile supports all commands that it allows."""
    table = RegisterTable(Zeros(), profile)
    limits = profile.geometry().limits
    table.status()
    for command in (table.enable, table.home, table.stop, table.heartbeat, table.reset_fault, table.disable):
        command()
    for ends in (limits.low, limits.high, (0.0, 0.0)):
        table.move(*ends, min(limits.rate), min(limits.acceleration))
    with suppress(ConfigurationError):  # no such command, or nothing that stops it
        table.rate(-limits.rate[0], limits.rate[1], min(limits.acceleration))


def check_lines(text: TextSection) -> None:
    """Assert that every text command of a loaded profile can be formatted and sent."""
    values = {"angle": "1", "rate": "2", "acceleration": "3"}
    named = {f"{joint}_{name}": value for joint in ("outer", "inner") for name, value in values.items()}
    for name in type(text.commands).model_fields:
        for line in getattr(text.commands, name):
            assert line.format(axis="1", **values, **named).isascii()
    for query in text.queries.values():
        assert query.send.format(axis="1").isprintable()
