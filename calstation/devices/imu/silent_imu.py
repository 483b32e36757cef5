"""Driver of an IMU that only streams: it takes no command, has no registers and cannot say who it is."""

from collections.abc import Callable, Mapping

from calstation.devices.imu.streamed_imu import StreamedImu
from calstation.devices.interfaces import ImuIdentity
from calstation.devices.links.serial_link import SerialLink
from calstation.devices.profiles.imu import ImuProfile


class SilentImu(StreamedImu):
    """The stream of a profile on a link.

    Parameters
    ----------
    link : open port
    profile : what the bytes mean
    serial : the unit's serial number, on the operator's word
    """

    def __init__(self, link: SerialLink, profile: ImuProfile, serial: str) -> None:
        super().__init__(link, profile, None)
        self._serial = serial

    def start(self, *, corrected: bool = False) -> None:
        """It streams by itself, and in one way."""

    def wake(self, check_cancelled: Callable[[], None], *, corrected: bool = False) -> None:
        """It cannot be asked; one that restarted streams again by itself."""
        self._forget_noise()

    def identify(self) -> ImuIdentity:
        """The profile's model and the operator's serial number."""
        return ImuIdentity(self._profile.model, self._serial, "")

    def read_registers(self) -> dict[str, float]:
        """It has none."""
        return {}

    def write_registers(self, values: Mapping[str, float]) -> None:
        """It has none, so nothing is written."""

    def commit(self) -> None:
        """It has nothing to make permanent."""

    def reset(self) -> None:
        """It cannot be restarted from here."""
