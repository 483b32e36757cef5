"""Listens on a port for an IMU's frames, without a word."""

import time

from calstation.devices.imu.frames import FrameDecoder
from calstation.devices.links.serial_link import SerialLink, SerialSettings
from calstation.devices.profiles.imu import ImuProfile
from calstation.errors import CalstationError

#: Host time to listen at one setting, s.
LISTEN = 0.4

_GLANCE = 0.02


def listen(link: SerialLink, seconds: float) -> bytes:
    """What comes within some host time. Raises PortLostError."""
    heard = b""
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0:
        heard += link.read(min(left, _GLANCE))
    return heard


def frames_come(port: str, settings: SerialSettings, profile: ImuProfile) -> bool:
    """Whether frames of the profile come on a port with these settings; not where it cannot be opened."""
    try:
        link = SerialLink(port, settings, "IMU")
    except CalstationError:
        return False  # settings that this port cannot do, or no such port
    try:
        return len(FrameDecoder(profile.frame, profile.commands).feed(listen(link, LISTEN)).frames) > 0
    except CalstationError:
        return False
    finally:
        link.close()
