"""The IMU of a profile: the driver that speaks its protocol, on its open port."""

from collections.abc import Callable

from calstation.devices.framed_imu import FramedImu
from calstation.devices.imu_profile import ImuProfile
from calstation.devices.link import SerialLink
from calstation.devices.modbus_imu import ModbusImu
from calstation.devices.registered_imu import RegisteredImu
from calstation.devices.silent_imu import SilentImu
from calstation.devices.streamed_imu import StreamedImu
from calstation.devices.vectornav_imu import VectorNavImu


def open_imu(link: SerialLink, profile: ImuProfile, serial: str) -> StreamedImu:
    """The driver, not streaming yet.

    Parameters
    ----------
    link : open port
    profile : what the bytes mean
    serial : the unit's serial number as the operator gives it, taken for that of a unit that cannot tell its own
    """
    if profile.protocol == "stream":
        return SilentImu(link, profile, serial)
    return _DRIVERS[profile.protocol](link, profile)


_DRIVERS: dict[str, Callable[[SerialLink, ImuProfile], RegisteredImu]] = {
    "framed": FramedImu,
    "modbus": ModbusImu,
    "vectornav": VectorNavImu,
}
