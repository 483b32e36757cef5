"""The IMU of a profile: the driver that speaks its protocol, on its open port."""

from collections.abc import Callable

from calstation.devices.imu.framed_imu import FramedImu
from calstation.devices.imu.modbus_imu import ModbusImu
from calstation.devices.imu.registered_imu import RegisteredImu
from calstation.devices.imu.silent_imu import SilentImu
from calstation.devices.imu.streamed_imu import StreamedImu
from calstation.devices.imu.vectornav_imu import VectorNavImu
from calstation.devices.links.serial_link import SerialLink
from calstation.devices.profiles.imu import ImuProfile


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
