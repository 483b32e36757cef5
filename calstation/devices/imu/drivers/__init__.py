"""IMU drivers; each module has the name of its protocol in profiles and assigns its driver class to `DRIVER`.

The package `imu` contains the code common to all drivers; `docs/how-to/extend.md` explains how to add a driver.
"""

from functools import cache
from importlib import import_module

from calstation.devices.imu.drivers.framed import FramedImu
from calstation.devices.imu.frames import FrameDecoder
from calstation.devices.imu.streamed_imu import StreamedImu
from calstation.devices.links import Link
from calstation.devices.profiles import ImuProfile


@cache
def driver(protocol: str) -> type[StreamedImu]:
    """Return the driver class of a protocol."""
    kind: type[StreamedImu] = import_module(f"{__name__}.{protocol}").DRIVER
    return kind


def open_imu(link: Link, profile: ImuProfile, serial: str) -> StreamedImu:
    """Open the driver of an IMU without starting its stream; `serial` is for a unit that reports no serial number."""
    return driver(profile.protocol)(link, profile, serial)


def frame_decoder(profile: ImuProfile) -> FrameDecoder:
    """Return a decoder of the frames and replies of a unit."""
    return FrameDecoder(profile.frame, driver(profile.protocol).reply_kind(profile))
