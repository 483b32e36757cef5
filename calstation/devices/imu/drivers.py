"""Selection of an IMU's driver by its profile's protocol, and the driver of IMUs that only stream."""

from collections.abc import Callable, Mapping

from calstation.devices.imu.framed_imu import FramedImu
from calstation.devices.imu.modbus_imu import ModbusImu
from calstation.devices.imu.registered_imu import RegisteredImu
from calstation.devices.imu.streamed_imu import StreamedImu
from calstation.devices.imu.vectornav_imu import VectorNavImu
from calstation.devices.interfaces import ImuIdentity
from calstation.devices.links import SerialLink
from calstation.devices.profiles import ImuProfile


class SilentImu(StreamedImu):
    """An IMU that only streams: it accepts no commands, has no registers and cannot be identified."""

    def __init__(self, link: SerialLink, profile: ImuProfile, serial: str) -> None:
        super().__init__(link, profile, None)
        self._serial = serial

    def start(self, *, corrected: bool = False) -> None: ...

    def wake(self, check_cancelled: Callable[[], None], *, corrected: bool = False) -> None:
        """Reset only the noise count, because a unit that has restarted resumes its stream automatically."""
        self._forget_noise()

    def identify(self) -> ImuIdentity:
        return ImuIdentity(self._profile.model, self._serial, "")

    def read_registers(self) -> dict[str, float]:
        return {}

    def write_registers(self, values: Mapping[str, float]) -> None: ...

    def commit(self) -> None: ...

    def reset(self) -> None: ...


_DRIVERS: dict[str, Callable[[SerialLink, ImuProfile], RegisteredImu]] = {
    "framed": FramedImu,
    "modbus": ModbusImu,
    "vectornav": VectorNavImu,
}


def open_imu(link: SerialLink, profile: ImuProfile, serial: str) -> StreamedImu:
    """Return the driver of an IMU, not yet streaming; the operator's `serial` is used if the unit reports none."""
    if profile.protocol == "stream":
        return SilentImu(link, profile, serial)
    return _DRIVERS[profile.protocol](link, profile)
