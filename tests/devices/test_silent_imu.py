"""A unit that only streams is read without sending anything, and the operator enters its serial number."""

import time
from pathlib import Path

from calstation.devices.imu.drivers.stream import StreamOnlyImu
from calstation.devices.profiles import load_imu_profile
from tests.devices.scripted import ScriptedDevice

IMUS = Path(__file__).parents[2] / "data" / "imus"
DATAGRAM = bytes.fromhex(
    "AF000124FFFAD600035B00FFE7A6FFDD36081C5200FF7E70FEBA0C3FFA1D0023A023C023A0002319230A231C0023"
    "9523B6239500FFEF0200E101FAC64942C60D0A"
)


def test_stream_only_unit_is_read_without_sending_commands() -> None:
    link = ScriptedDevice([])
    imu = StreamOnlyImu(link, load_imu_profile(IMUS / "stim300.toml"), "SN-7")  # type: ignore[arg-type]
    try:
        imu.start()
        link.send(b"\x00\xaf" + DATAGRAM[:40])
        link.send(DATAGRAM[40:])
        deadline = time.monotonic() + 5.0
        while imu.stats.frames < 1 and time.monotonic() < deadline:
            time.sleep(0.001)
        batch = imu.read()
        assert batch.seq.tolist() == [225]
        assert batch.counts[0, :3].tolist() == [292, -1322, 859]
        identity = imu.identify()
        assert (identity.model, identity.serial) == ("STIM300", "SN-7")
        assert imu.read_registers() == {}
        imu.write_registers({})
        imu.commit()
        imu.reset()
    finally:
        imu.close()
    assert link.unexpected == []
