"""Every command protocol of IMUs has a section in profiles, a driver, a simulated unit, and its documents."""

from pathlib import Path
from pkgutil import iter_modules

import pytest

from calstation.bench.imu import UNITS
from calstation.devices.imu import drivers
from calstation.devices.profiles import PROTOCOLS
from tests.devices.powered_unit import shipped

REFERENCE = Path(__file__).parents[2] / "docs" / "reference"


def test_profiles_drivers_and_bench_have_the_same_protocols() -> None:
    assert {module.name for module in iter_modules(drivers.__path__)} == {*PROTOCOLS, "stream"}
    assert set(UNITS) == set(PROTOCOLS)
    sections = [protocol.section for protocol in PROTOCOLS.values()]
    assert len(set(sections)) == len(sections)


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_shipped_profile_describes_the_simulated_unit(protocol: str) -> None:
    profile = shipped(protocol)
    assert profile.protocol == protocol
    assert isinstance(profile.protocol_section, PROTOCOLS[protocol])
    assert profile.section_of(PROTOCOLS[protocol]) is profile.protocol_section
    with pytest.raises(TypeError, match=protocol):
        profile.section_of(type("Other", (PROTOCOLS[protocol],), {}))


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_protocol_is_documented(protocol: str) -> None:
    heading = f'### `"{protocol}"`: `[{PROTOCOLS[protocol].section}]`'
    assert heading in (REFERENCE / "profiles.md").read_text(encoding="utf-8")
    (row,) = [
        line for line in (REFERENCE / "bench.md").read_text(encoding="utf-8").splitlines() if "`imu_protocol`" in line
    ]
    assert f"`{protocol}`" in row
