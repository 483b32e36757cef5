"""Driver of IMUs that only stream."""

from collections.abc import Callable, Mapping

from calstation.devices.imu.streamed_imu import StreamedImu
from calstation.devices.interfaces import ImuIdentity


class SilentImu(StreamedImu):
    """An IMU that only streams: it accepts no commands, has no registers and cannot be identified."""

    def start(self, *, corrected: bool = False) -> None:
        """Do nothing: the unit always streams."""

    def wake(self, check_cancelled: Callable[[], None], *, corrected: bool = False) -> None:
        """Reset only the noise count, because a unit that has restarted resumes its stream automatically."""
        self._forget_noise()

    def identify(self) -> ImuIdentity:
        """Return the profile's model and the serial number given by the operator."""
        return ImuIdentity(self._profile.model, self._serial, "")

    def read_registers(self) -> dict[str, float]:
        """Return nothing: the unit has no registers."""
        return {}

    def write_registers(self, values: Mapping[str, float]) -> None:
        """Do nothing."""

    def commit(self) -> None:
        """Do nothing."""

    reset = commit


DRIVER = SilentImu
