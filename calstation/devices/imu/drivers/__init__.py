"""Drivers of IMUs, one module with a class `DRIVER` per protocol, under its name in profiles.

What they have in common is in `imu`; `docs/how-to/extend.md` explains how to add one.
"""

from functools import cache
from importlib import import_module

from calstation.devices.imu.drivers.framed import FramedImu
from calstation.devices.imu.frames import FrameDecoder
from calstation.devices.imu.streamed_imu import StreamedImu
from calstation.devices.links import SerialLink
from calstation.devices.profiles import ImuProfile


@cache
def driver(protocol: str) -> type[StreamedImu]:
    """Return the driver class of a protocol."""
    kind: type[StreamedImu] = import_module(f"{__name__}.{protocol}").DRIVER
    return kind


def open_imu(link: SerialLink, profile: ImuProfile, serial: str) -> StreamedImu:
    """Return the driver of an IMU, not yet streaming; the operator's `serial` is used if the unit reports none."""
    return driver(profile.protocol)(link, profile, serial)


def frame_decoder(profile: ImuProfile) -> FrameDecoder:
    """Return a decoder of the frames and replies of a unit."""
    return FrameDecoder(profile.frame, driver(profile.protocol).reply_kind(profile))
