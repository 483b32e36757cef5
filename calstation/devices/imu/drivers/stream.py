"""Driver of IMUs without commands."""

from collections.abc import Callable, Mapping

from calstation.devices.imu.streamed_imu import StreamedImu
from calstation.devices.interfaces import ImuIdentity


class StreamOnlyImu(StreamedImu):
    """Driver of an IMU that only streams, accepts no commands, has no registers and cannot be identified."""

    def start(self, *, corrected: bool = False) -> None:
        """Do nothing, because the unit streams all the time."""

    def wake(self, check_cancelled: Callable[[], None], *, corrected: bool = False) -> None:
        """Reset the noise count; a unit that has restarted resumes its stream automatically."""
        self._reset_noise_count()

    def identify(self) -> ImuIdentity:
        """Return the profile's model and the serial number that the operator entered."""
        return ImuIdentity(self._profile.model, self._serial, "")

    def read_registers(self) -> dict[str, float]:
        """Return an empty dictionary, because the unit has no registers."""
        return {}

    def write_registers(self, values: Mapping[str, float]) -> None:
        """Do nothing."""

    def commit(self) -> None:
        """Do nothing."""

    reset = commit


DRIVER = StreamOnlyImu
